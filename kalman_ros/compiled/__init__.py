# SPDX-License-Identifier: Apache-2.0
"""Models and sensors with compiled arithmetic, from the formulas of their functions.

CasADi traces ``derivative`` and ``measure`` as they are, and differentiates them exactly. A C
compiler makes them as fast as code written by hand; without one CasADi evaluates them, and without
CasADi, or where a function cannot be traced, numpy computes as ever.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal, NamedTuple, TypeVar

from kalman_ros.core import Dynamics, Sensor, Space

from .untraceable import UntraceableError

T = TypeVar('T', Dynamics, Sensor)
#: What computes: C, the virtual machine of CasADi, or numpy.
Arithmetic = Literal['C', 'CasADi', 'numpy']


class Outcome(NamedTuple):
    """A model or a sensor with what computes it, and why that is not something faster.

    Parameters
    ----------
    result
        The object with compiled functions, or the original.
    arithmetic
        'C', 'CasADi' or 'numpy'.
    reason
        Why it is not compiled; empty if it is, or if nothing is gained by it.
    pending
        What a C compiler has yet to do, for `library.load`; empty if nothing.
    """

    result: Any
    arithmetic: Arithmetic
    reason: str = ''
    pending: str = ''


def is_available() -> bool:
    """Return whether CasADi is installed."""
    return find_spec('casadi') is not None


def compiled(original: T, state: Space | None = None) -> T:
    """Return a model or a sensor with compiled functions, or itself where that is impossible.

    The original stays as it is. The compiled one has the numbers that it has now.

    Parameters
    ----------
    original
        The model or sensor.
    state
        The space of the states that a sensor measures; by default its ``state``.

    Returns
    -------
    Model or Sensor
        Of the same class.
    """
    result: T = attempt(original, state).result
    return result


def attempt(
    original: Dynamics | Sensor,
    state: Space | None = None,
    *,
    wait: bool = True,
    one_of_many: bool = False,
) -> Outcome:
    """Return what `compiled` does, with the arithmetic and the reason for it.

    Without ``wait``, what no earlier start has compiled is left to CasADi. An object that is
    ``one_of_many`` stays as it is if others like it had to be traced again.
    """
    if not is_available():
        gains = not _is_linear(original)
        return Outcome(original, 'numpy', 'CasADi is not installed' if gains else '')
    from .derived import Derived

    if isinstance(original, Derived):
        return Outcome(original, original.arithmetic)
    if _is_linear(original):
        return _linear(original, state, wait, one_of_many)
    try:
        import_module('casadi')
    except Exception as error:
        return Outcome(original, 'numpy', f'CasADi cannot be used: {_in_a_line(error)}')
    try:
        return _verified(original, state, wait, one_of_many)
    except UntraceableError as error:
        return Outcome(original, 'numpy', str(error))
    except Exception as error:  # functions of a user, CasADi and compilers fail in any way
        return Outcome(original, 'numpy', _in_a_line(error))


def _is_linear(original: Dynamics | Sensor) -> bool:
    """Return whether functions are products with constant matrices."""
    if isinstance(original, Dynamics):
        return original.is_linear
    return original.linear and not original.output.rotations


def _linear(original: Any, state: Space | None, wait: bool, one_of_many: bool) -> Outcome:
    """Return a linear part whose beliefs, one at a time, are predicted and corrected in C."""
    from . import native_linear as native
    from .library import CompilerError

    try:
        if one_of_many:
            return Outcome(original, 'numpy')
        if isinstance(original, Sensor):
            return Outcome(native.numbered_sensor(original, state or original.state), 'numpy')
        if native.is_small(original):
            return Outcome(native.native_linear_system(original, wait=wait), 'C')
    except CompilerError as error:
        return Outcome(original, 'numpy', pending=error.pending)
    except Exception:
        pass  # a function of a user may fail in any way, which is reported where it is used
    return Outcome(original, 'numpy')


def _verified(original: Any, state: Space | None, wait: bool, one_of_many: bool) -> Outcome:
    """Return a compiled part that does what the original does."""
    from . import formulas, native_model
    from .free_parameters import Parameters

    if one_of_many and not Parameters(original).comparable:
        raise UntraceableError('it has attributes that cannot be compared')
    make = _model if isinstance(original, Dynamics) else _sensor
    space = state or original.state
    outcome = make(original, space, wait)
    try:
        formulas.verify(original, outcome.result, space, one_of_many=one_of_many)
    except UntraceableError:
        # what has the same attributes may compute by other formulas than before
        native_model.forget_formulas()
        outcome = make(original, space, wait)
        formulas.verify(original, outcome.result, space, one_of_many=one_of_many)
    return outcome


def _in_a_line(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'.partition('\n')[0]


def _model(original: Any, _: Space, wait: bool) -> Outcome:
    from .interpreted import interpreted_model
    from .native_model import native_model

    try:
        return Outcome(native_model(original, wait=wait), 'C')
    except Exception as error:
        if not original.is_discrete:
            return _slower(interpreted_model(original), 'CasADi', error)
        return _slower(original, 'numpy', error)


def _sensor(original: Any, state: Space, wait: bool) -> Outcome:
    from .interpreted import interpreted_sensor
    from .native_sensor import native_sensor

    try:
        return Outcome(native_sensor(original, state, wait=wait), 'C')
    except Exception as error:
        return _slower(interpreted_sensor(original, state), 'CasADi', error)


def _slower(part: Any, arithmetic: Arithmetic, error: Exception) -> Outcome:
    """Return what computes in the place of C, with the reason."""
    from .library import CompilerError

    if isinstance(error, CompilerError):
        return Outcome(part, arithmetic, str(error), error.pending)
    return Outcome(part, arithmetic, _in_a_line(error))
