# SPDX-License-Identifier: Apache-2.0
"""Systems of other libraries, such as python-control and scipy.signal, known by their attributes.

Neither library is imported: a state-space system is what has A and B, a transfer function what
has polynomials or poles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

#: What other systems have: polynomials, poles with a gain, responses, and numbers of signals.
_MARKS = (('num', 'den'), ('zeros', 'poles', 'gain'), ('frdata',), ('ninputs',))


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


def is_state_space(value: Any) -> bool:
    """Return whether ``value`` has the matrices of a system."""
    return hasattr(value, 'A') and hasattr(value, 'B')


def read_system(name: str, value: Any) -> ForeignSystem | None:
    """Return the matrices of a state-space system; None if ``value`` is no system at all.

    Raises
    ------
    ValueError
        If it is a system without a state, such as a transfer function.
    """
    if is_state_space(value):
        given: Any = getattr(value, 'dt', None)
        sampled = given is not None and given != 0
        # a continuous system of scipy has no dt, but can be discretised
        continuous = not sampled and (given is not None or hasattr(value, 'to_discrete'))
        C, D = getattr(value, 'C', None), getattr(value, 'D', None)
        dt = float(given) if sampled else None
        return ForeignSystem(value.A, value.B, C, D, dt, continuous)
    if isinstance(value, type):
        raise ValueError(f'{name}: expected an object, got the class {value.__name__}')
    if any(all(hasattr(value, mark) for mark in marks) for marks in _MARKS):
        kind = 'a transfer function' if hasattr(value, 'num') else type(value).__name__
        raise ValueError(f'{name}: expected a matrix or a state-space system, got {kind}')
    return None
