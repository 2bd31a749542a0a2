# SPDX-License-Identifier: Apache-2.0
"""Systems of other libraries, such as python-control and scipy.signal, known by their attributes.

Neither library is imported to know them: a state-space system is what has A and B, a transfer
function what has polynomials or poles.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

#: Attributes of a state-space system, and of a transfer function.
_STATE_SPACE = (('A', 'B'),)
_TRANSFER = (('num', 'den'), ('zeros', 'poles', 'gain'))
#: Labels that nobody has chosen.
_DEFAULT = re.compile(r'[a-z]+\[\d+\]')
#: Attributes of other systems: a measured response, or python-control's nonlinear system.
_OTHER = (('frdata',), ('ninputs',))


@dataclass(frozen=True)
class ForeignSystem:
    """The matrices of dx/dt = A x + B u, y = C x + D u, and what is known of its time.

    Parameters
    ----------
    A, B, C, D
        As given, unchecked; None if there is none.
    dt
        Seconds of a sample; 1 if it has samples of unknown length; None otherwise.
    continuous
        Whether it is certain that time is continuous; python-control may leave it open.
    """

    A: Any
    B: Any
    C: Any
    D: Any
    dt: float | None
    continuous: bool


class Labels(NamedTuple):
    """The names of a system's states, inputs and readings; None where nobody has chosen any."""

    states: tuple[str, ...] | None
    inputs: tuple[str, ...] | None
    readings: tuple[str, ...] | None


def labels_of(value: Any) -> Labels:
    """Return the names that a system of python-control has.

    What a name cannot have becomes an underscore: ``speed_m_s`` of 'speed m/s'.
    """

    def given(kind: str) -> tuple[str, ...] | None:
        labels = tuple(getattr(value, f'{kind}_labels', None) or ())
        if all(_DEFAULT.fullmatch(label) for label in labels):
            return None
        names = tuple(re.sub(r'\W+', '_', label).strip('_') for label in labels)
        usable = all(map(str.isidentifier, names)) and len({*names}) == len(names)
        return names if usable else None

    return Labels(given('state'), given('input'), given('output'))


def _has(value: Any, kinds: tuple[tuple[str, ...], ...]) -> bool:
    """Return whether ``value`` is an object with all attributes of one of ``kinds``."""
    return not isinstance(value, type) and any(
        all(hasattr(value, attribute) for attribute in kind) for kind in kinds
    )


def is_foreign(value: Any) -> bool:
    """Return whether ``value`` is a linear system: matrices, polynomials, or poles."""
    return _has(value, (*_STATE_SPACE, *_TRANSFER))


def read_system(name: str, value: Any) -> ForeignSystem | None:
    """Return the matrices of a system; None if ``value`` is no system at all.

    Those of a transfer function are its controllable canonical form, by `scipy.signal.tf2ss`.

    Raises
    ------
    ValueError
        If it is a system that has no such form.
    """
    if isinstance(value, type):
        raise ValueError(f'{name}: expected an object, got the class {value.__name__}')
    # a continuous system of scipy has no dt, but can be discretised
    given: Any = getattr(value, 'dt', None)
    if _has(value, _STATE_SPACE):
        A, B = value.A, value.B
        C, D = getattr(value, 'C', None), getattr(value, 'D', None)
    elif _has(value, _TRANSFER):
        A, B, C, D = _realised(name, value)
    elif _has(value, _OTHER):
        raise ValueError(f'{name}: expected a linear system, got {type(value).__name__}')
    else:
        return None
    sampled = given is not None and given != 0
    continuous = not sampled and (given is not None or hasattr(value, 'to_discrete'))
    return ForeignSystem(A, B, C, D, float(given) if sampled else None, continuous)


def _realised(name: str, value: Any) -> tuple[Any, ...]:
    """Return A, B, C and D of a transfer function from one input."""
    from scipy import signal  # slow to import

    try:
        if not hasattr(value, 'num'):
            num, den = signal.zpk2tf(value.zeros, value.poles, value.gain)
        else:
            num, den = value.num, value.den
        if isinstance(num, list) or getattr(num, 'dtype', None) == np.dtype(
            object
        ):  # [output][input]
            several = len(num), len(num[0])
            if several != (1, 1):
                raise ValueError(f'it has {several[1]} inputs and {several[0]} outputs')
            num, den = num[0][0], den[0][0]
        if np.size(np.trim_zeros(np.ravel(den), 'f')) < 2:
            raise ValueError('it has no pole')
        matrices: tuple[Any, ...] = signal.tf2ss(num, den)
    except ValueError as error:
        why = str(error).rstrip('.')
        raise ValueError(
            f'{name}: expected a system with states, or one transfer function that has as many '
            f'poles as zeros or more: {why}'
        ) from None
    return matrices
