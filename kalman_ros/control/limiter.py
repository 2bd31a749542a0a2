# SPDX-License-Identifier: Apache-2.0
"""Inputs limited to what the actuators can do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalman_ros.core import Array, one_each

#: Names of the limits, which are parameters of the controller and not of a scenario.
LIMITS = ('input_limit', 'input_lower_limit', 'input_rate_limit')
#: The values of `LIMITS` with which no limit applies.
_NONE = dict(zip(LIMITS, (inf, -inf, inf)))


@dataclass(frozen=True)
class Limits:
    """What the actuators can do.

    Parameters
    ----------
    lower, upper
        The smallest and the largest value of each input (m,).
    rate
        The largest change of each input per second (m,).
    """

    lower: Array
    upper: Array
    rate: Array

    @staticmethod
    def none(m: int) -> Limits:
        """Return limits that never apply."""
        return Limits(np.full(m, -inf), np.full(m, inf), np.full(m, inf))

    @property
    def are_none(self) -> bool:
        """Whether no limit ever applies."""
        return bool(np.isinf([self.lower, self.upper, self.rate]).all())

    def within(self, u: Array) -> Array:
        """Return the allowed input closest to an input (m,), whatever its change."""
        return np.clip(u, self.lower, self.upper)

    @property
    def are_alike(self) -> NDArray[np.bool_]:
        """Whether the lower limit of each input (m,) is minus the upper one."""
        alike: NDArray[np.bool_] = self.lower == -self.upper
        return alike

    def check(self, what: str, u: Array, remedy: str = '') -> None:
        """Raise ValueError if an input (m,) is beyond the limits; ``what`` is its name."""
        below, above = u < self.lower, u > self.upper
        if np.any(below | above):
            name = 'input_lower_limit' if np.any(below & ~self.are_alike) else 'input_limit'
            raise ValueError(
                f'{name}: expected limits that contain {what} {u.tolist()}, '
                f'got {self.lower.tolist()} to {self.upper.tolist()}{remedy}'
            )


def limits_of(m: int, values: Mapping[str, Any]) -> Limits:
    """Return the limits of ``m`` actuators by the names of `LIMITS`.

    One number is used for every input. An input without a lower limit, or with that of minus
    infinity, is limited to plus and minus its ``input_limit``.

    Raises
    ------
    ValueError
        If the number of values is wrong, one is negative, or the lower limit above the upper.
    """
    limits = {name: one_each(name, values.get(name, none), m) for name, none in _NONE.items()}
    for name in 'input_limit', 'input_rate_limit':
        if np.any(limits[name] < 0.0):
            raise ValueError(f'{name}: expected at least 0, got {limits[name].tolist()}')
    upper, lower = limits['input_limit'], limits['input_lower_limit']
    lower = np.where(np.isneginf(lower), -upper, lower)
    if np.any(lower > upper):
        raise ValueError(
            f'input_lower_limit: expected at most the input_limit {upper.tolist()}, '
            f'got {lower.tolist()}'
        )
    return Limits(lower, upper, limits['input_rate_limit'])


class Limiter:
    """Moves an input towards a wanted one, within `Limits`, starting at the idle input.

    Where the limits conflict, after they were narrowed, that of the rate applies, and the
    others are reached as soon as the rate allows. Inputs (m,) may have leading axes.

    Parameters
    ----------
    limits
        What the actuators can do.
    idle
        The input (m,) of an idle controller.

    Raises
    ------
    ValueError
        If the idle input is beyond the limits.
    """

    def __init__(self, limits: Limits, idle: Array) -> None:
        #: The current input (m,).
        self.value = idle
        #: The number of inputs that a limit has changed; with leading axes, of each.
        self.limited: Any = 0
        self.adopt(limits, idle)

    def adopt(self, limits: Limits, idle: Array) -> None:
        """Use other limits and another idle input from now on; the input is unchanged."""
        limits.check('the idle input', idle)
        self._limits, self.idle = limits, idle
        self._free = limits.are_none

    @property
    def at_idle(self) -> bool:
        """Whether the input is the idle one."""
        return bool(np.array_equal(self.value, self.idle))

    def toward(self, wanted: Array, seconds: float) -> Array:
        """Return the input (m,) closest to ``wanted`` (m,) that can be reached in ``seconds``."""
        if self._free:
            self.value = wanted
            return wanted
        self.value = self._within_reach(self._limits.within(wanted), seconds)
        changed = np.any(self.value != wanted, axis=-1)
        self.limited = self.limited + (int(changed) if wanted.ndim == 1 else changed)
        return self.value

    def toward_idle(self, seconds: float) -> Array:
        """Return the input (m,) closest to the idle one that can be reached in ``seconds``."""
        self.value = self._within_reach(self.idle, seconds)
        return self.value

    def jump_to_idle(self) -> Array:
        """Return the idle input, regardless of the rate limit."""
        self.value = self.idle
        return self.value

    def _within_reach(self, wanted: Array, seconds: float) -> Array:
        rate, before = self._limits.rate, self.value
        # in no time, too, an unlimited input may go anywhere
        reach: Array = np.full(rate.shape, inf)
        np.multiply(rate, seconds, out=reach, where=np.isfinite(rate))
        within: Array = np.clip(wanted, before - reach, before + reach)
        return within
