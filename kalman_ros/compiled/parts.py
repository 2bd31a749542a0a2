# SPDX-License-Identifier: Apache-2.0
"""What a filter computes with: a model and its sensors, compiled where they can be."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

from kalman_ros.core import Dynamics, Sensor

from . import Outcome, attempt

COMPILED, NUMPY = 'compiled', 'numpy'
#: The arithmetic of a filter that is C as a whole, in an estimator's node and in a replay.
IN_C = 'c'
#: An environment variable: what it names is used, whatever is chosen.
VARIABLE = 'KALMAN_ROS_ARITHMETIC'


def chosen(arithmetic: str) -> str:
    """Return the arithmetic that the environment names, or else this one."""
    return os.environ.get(VARIABLE) or arithmetic


class Parts(NamedTuple):
    """A model and its sensors, with what computes each.

    Parameters
    ----------
    model, sensors
        Compiled where possible.
    outcomes
        By name, the model's being 'model'; without what is linear.
    """

    model: Dynamics
    sensors: dict[str, Sensor]
    outcomes: dict[str, Outcome]

    @property
    def pending(self) -> list[str]:
        """What a C compiler has yet to do, for `library.load`."""
        return [outcome.pending for outcome in self.outcomes.values() if outcome.pending]

    @property
    def arithmetic(self) -> str:
        """What computes, and why it is not C: ``'C'``, ``'C; radar: numpy (...)'``."""
        groups: dict[tuple[str, str], list[str]] = {}
        for name, outcome in self.outcomes.items():
            groups.setdefault((outcome.arithmetic, outcome.reason), []).append(name)
        words = []
        for (arithmetic, reason), names in groups.items():
            owner = f'{", ".join(names)}: ' if len(groups) > 1 else ''
            words.append(f'{owner}{arithmetic}' + (f' ({reason})' if reason else ''))
        return '; '.join(words) or NUMPY


def parts(
    model: Dynamics,
    sensors: Mapping[str, Sensor],
    arithmetic: str = COMPILED,
    *,
    wait: bool = True,
    one_of_many: bool = False,
) -> Parts:
    """Return a model and its sensors, compiled if that is chosen and possible.

    Parameters
    ----------
    model, sensors
        The originals, which stay as they are.
    arithmetic
        ``'compiled'`` or ``'numpy'``, unless the environment variable says which.
    wait
        Whether to wait for a C compiler.
    one_of_many
        Whether there are many that differ in numbers.

    Raises
    ------
    ValueError
        If the arithmetic is unknown.
    """
    arithmetic = chosen(arithmetic)
    if arithmetic not in (COMPILED, NUMPY):
        name = f'{VARIABLE} in the environment' if os.environ.get(VARIABLE) else 'arithmetic'
        raise ValueError(f"{name}: expected {COMPILED} or {NUMPY}, got '{arithmetic}'")
    if arithmetic == NUMPY:
        return Parts(model, {**sensors}, {})
    every: dict[str, Dynamics | Sensor] = {'model': model, **sensors}
    tried = {
        name: attempt(part, model.state, wait=wait, one_of_many=one_of_many)
        for name, part in every.items()
    }
    return Parts(
        tried['model'].result,
        {name: tried[name].result for name in sensors},
        {
            name: outcome
            for name, outcome in tried.items()
            if outcome.arithmetic != NUMPY or outcome.reason or outcome.pending
        },
    )
