# SPDX-License-Identifier: Apache-2.0
"""Inputs limited to what the actuators can do."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from kalman_ros.core import Array, ArrayLike, one_each

#: Names of the limits, which are parameters of the controller and not of a scenario.
LIMITS = ('input_limit', 'input_rate_limit')


@dataclass(frozen=True)
class Limits:
    """What the actuators can do.

    Parameters
    ----------
    magnitude
        The largest magnitude of each input (m,).
    rate
        The largest change of each input per second (m,).
    """

    magnitude: Array
    rate: Array

    @staticmethod
    def none(m: int) -> Limits:
        """Return limits that never apply."""
        return Limits(np.full(m, inf), np.full(m, inf))


def limits_of(m: int, magnitude: ArrayLike = inf, rate: ArrayLike = inf) -> Limits:
    """Return the limits of ``m`` actuators; one number is used for every input.

    Raises
    ------
    ValueError
        If the number of values is wrong, or one is negative.
    """
    pairs = ('input_limit', magnitude), ('input_rate_limit', rate)
    checked = [one_each(name, values, m) for name, values in pairs]
    for (name, _), values in zip(pairs, checked):
        if not np.all(values >= 0.0):
            raise ValueError(f'{name}: expected at least 0, got {values.tolist()}')
    return Limits(*checked)


class Limiter:
    """Moves an input towards a wanted one, within `Limits`, starting at the idle input.

    Where the limits conflict, after the magnitude was reduced, the rate limit applies and
    the magnitude is reached as soon as the rate allows. Inputs (m,) may have leading axes.

    Parameters
    ----------
    limits
        What the actuators can do.
    idle
        The input (m,) of an idle controller.

    Raises
    ------
    ValueError
        If the idle input exceeds the largest magnitude.
    """

    def __init__(self, limits: Limits, idle: Array) -> None:
        #: The current input (m,).
        self.value = idle
        #: The number of inputs that a limit has changed; with leading axes, of each.
        self.limited: Any = 0
        self.adopt(limits, idle)

    def adopt(self, limits: Limits, idle: Array) -> None:
        """Use other limits and another idle input from now on; the input is unchanged."""
        check_idle(limits, idle)
        self._limits, self.idle = limits, idle
        self._free = bool(np.isinf([limits.magnitude, limits.rate]).all())

    @property
    def at_idle(self) -> bool:
        """Whether the input is the idle one."""
        return bool(np.array_equal(self.value, self.idle))

    def toward(self, wanted: Array, seconds: float) -> Array:
        """Return the input (m,) closest to ``wanted`` (m,) that can be reached in ``seconds``."""
        if self._free:
            self.value = wanted
            return wanted
        most = self._limits.magnitude
        self.value = self._within_reach(np.clip(wanted, -most, most), seconds)
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


def check_idle(limits: Limits, idle: Array) -> None:
    """Raise ValueError if the idle input exceeds the largest magnitude."""
    if np.any(np.abs(idle) > limits.magnitude):
        raise ValueError(
            f'input_limit: expected at least the magnitude of the idle input {idle.tolist()}, '
            f'got {limits.magnitude.tolist()}'
        )
