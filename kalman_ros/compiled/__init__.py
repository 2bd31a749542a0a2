# SPDX-License-Identifier: Apache-2.0
"""Models and sensors with compiled arithmetic, from the formulas of their functions.

CasADi traces ``derivative`` and ``measure`` as they are, and differentiates them exactly. A C
compiler makes them as fast as code written by hand; without one CasADi evaluates them, and without
CasADi, or where a function cannot be traced, numpy computes as ever.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, Literal, NamedTuple, TypeVar

from kalman_ros.core import DiscreteModel, LinearSystem, Model, Sensor, Space

T = TypeVar('T', Model, Sensor)
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
    original: Model | Sensor,
    state: Space | None = None,
    *,
    wait: bool = True,
    one_of_many: bool = False,
) -> Outcome:
    """Return what `compiled` does, with the arithmetic and the reason for it.

    Without ``wait``, what no earlier start has compiled is left to CasADi. An object that is
    ``one_of_many`` stays as it is if others like it had to be traced again.
    """
    if isinstance(original, LinearSystem) or (
        isinstance(original, Sensor) and original.linear and not original.output.rotations
    ):
        return Outcome(original, 'numpy')  # nothing is gained
    if isinstance(original, DiscreteModel):
        return Outcome(original, 'numpy', 'it is in discrete time')
    if not is_available():
        return Outcome(original, 'numpy', 'CasADi is not installed')
    from .derived import Derived
    from .free_parameters import Parameters
    from .symbols import UntraceableError

    if isinstance(original, Derived):
        return Outcome(original, original.arithmetic)
    if one_of_many and not Parameters(original).comparable:
        return Outcome(original, 'numpy', 'it has attributes that cannot be compared')
    try:
        if isinstance(original, Model):
            return _model(original, wait)
        return _sensor(original, state or original.state, wait)
    except UntraceableError as error:
        return Outcome(original, 'numpy', str(error))


def _model(original: Model, wait: bool) -> Outcome:
    from .formulas import verify_model
    from .interpreted import interpreted_model
    from .library import CompilerError
    from .native import native_model

    try:
        found = Outcome(native_model(original, wait=wait), 'C')
    except CompilerError as error:
        found = Outcome(interpreted_model(original), 'CasADi', str(error), error.pending)
    verify_model(original, found.result)
    return found


def _sensor(original: Sensor, state: Space, wait: bool) -> Outcome:
    from .formulas import verify_sensor
    from .interpreted import interpreted_sensor
    from .library import CompilerError
    from .native import native_sensor

    try:
        found = Outcome(native_sensor(original, state, wait=wait), 'C')
    except CompilerError as error:
        found = Outcome(interpreted_sensor(original, state), 'CasADi', str(error), error.pending)
    verify_sensor(original, found.result, state)
    return found
