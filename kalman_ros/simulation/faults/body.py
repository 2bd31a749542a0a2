# SPDX-License-Identifier: Apache-2.0
"""Faults of the actuator, and what pushes the body that nobody told the estimator of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi, sin
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, one_each

from .fault import window


@dataclass(frozen=True)
class BodyOptions:
    """What may be set to go wrong where the input acts; nothing does unless it is."""

    actuator_loss: Annotated[
        float,
        About(
            'probability that the command of a step is lost; the one before it holds',
            minimum=0.0,
            maximum=1.0,
            live=True,
        ),
    ] = 0.0
    actuator_dead_zone: Annotated[
        Sequence[float],
        About('how much of each input has no effect, either way; one for all', '', 0.0, live=True),
    ] = (0.0,)
    disturbance_constant: Annotated[
        Sequence[float],
        About('constant that adds to each input as it acts; one for all', live=True),
    ] = (0.0,)
    disturbance_amplitude: Annotated[
        Sequence[float],
        About('amplitude of a sine that adds to each input; one for all', live=True),
    ] = (0.0,)
    disturbance_frequency: Annotated[
        float, About('frequency of that sine', 'Hz', minimum=0.0, live=True)
    ] = 1.0
    disturbance_noise: Annotated[
        Sequence[float],
        About(
            'spectral density, in squared units of input by s, of white noise that adds to each; '
            'one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0,)
    fault_window: Annotated[
        Sequence[float],
        About(
            'when dead zone, loss and disturbances act: from the first until before the second, '
            'since the start or ~/reset',
            's',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0, inf)


#: The options that switch something on.
_STRENGTHS = (
    'actuator_loss',
    'actuator_dead_zone',
    'disturbance_constant',
    'disturbance_amplitude',
    'disturbance_noise',
)


class BodyFaults:
    """What goes wrong where m inputs act: a command is lost or has no effect, something pushes.

    Raises
    ------
    ValueError
        If the options are not for this number of inputs.
    """

    def __init__(self, options: BodyOptions, size: int) -> None:
        set_to = {name: getattr(options, name) for name in _STRENGTHS}
        #: The faults that are on, and how they are set.
        self.on = [f'{name}: {value}' for name, value in set_to.items() if np.any(value)]
        self._loss = set_to.pop('actuator_loss')
        each = {name: one_each(name, value, size) for name, value in set_to.items()}
        self._dead = each['actuator_dead_zone']
        self._constant = each['disturbance_constant']
        self._amplitude = each['disturbance_amplitude']
        self._density = each['disturbance_noise']
        self._omega = 2.0 * pi * options.disturbance_frequency
        self._window = window(options.fault_window)

    def act(self, time: float) -> bool:
        """Tell whether anything goes wrong at a time, in seconds."""
        return bool(self.on) and time in self._window

    def lose(self, random: np.random.Generator) -> bool:
        """Draw whether the command of this step is lost."""
        return self._loss > 0.0 and bool(random.random() < self._loss)

    def moved(self, u: Array) -> Array:
        """Return what is left of an input (m,) beyond the dead zone."""
        return np.asarray(u - np.clip(u, -self._dead, self._dead))

    def push(self, time: float, dt: float, random: np.random.Generator) -> Array:
        """Return what adds to the input (m,) during a step of ``dt`` from ``time`` on.

        White noise of density V has the variance V / dt when it is held for a step.
        """
        push = self._constant + self._amplitude * sin(self._omega * time)
        if self._density.any():
            std = np.sqrt(self._density / dt)
            push = push + std * random.standard_normal(len(std))
        return np.asarray(push)
