# SPDX-License-Identifier: Apache-2.0
"""Faults of the actuator, and disturbances unknown to the estimator."""

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
    """The options of faults at the input; all are off by default."""

    actuator_gain: Annotated[
        Sequence[float], About('factor of each input before it acts; one for all', live=True)
    ] = (1.0,)
    actuator_delay: Annotated[float, About('delay of the input', 's', 0.0, 10.0, live=True)] = 0.0
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
        About('half width of the dead zone of each input; one for all', '', 0.0, live=True),
    ] = (0.0,)
    disturbance_constant: Annotated[
        Sequence[float], About('constant disturbance of each input; one for all', live=True)
    ] = (0.0,)
    disturbance_amplitude: Annotated[
        Sequence[float], About('amplitude of a sine added to each input; one for all', live=True)
    ] = (0.0,)
    disturbance_frequency: Annotated[
        float, About('frequency of that sine', 'Hz', minimum=0.0, live=True)
    ] = 1.0
    disturbance_noise: Annotated[
        Sequence[float],
        About(
            'spectral density, in squared units of input by s, of white noise added to each; '
            'one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0,)
    fault_window: Annotated[
        Sequence[float],
        About(
            'start and end of dead zone, loss and disturbances, in seconds '
            'since the start or ~/reset',
            's',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0, inf)


#: The options that enable a fault.
_STRENGTHS = (
    'actuator_loss',
    'actuator_dead_zone',
    'disturbance_constant',
    'disturbance_amplitude',
    'disturbance_noise',
)


class BodyFaults:
    """The faults at m inputs: lost commands, dead zone and disturbances.

    Raises
    ------
    ValueError
        If the options do not match this number of inputs.
    """

    def __init__(self, options: BodyOptions, size: int) -> None:
        set_to = {name: getattr(options, name) for name in _STRENGTHS}
        #: The faults that are on, with their settings.
        self.on = [f'{name}: {value}' for name, value in set_to.items() if np.any(value)]
        self._loss = set_to.pop('actuator_loss')
        expanded = {name: one_each(name, value, size) for name, value in set_to.items()}
        self._dead = expanded['actuator_dead_zone']
        self._constant = expanded['disturbance_constant']
        self._amplitude = expanded['disturbance_amplitude']
        self._density = expanded['disturbance_noise']
        self._omega = 2.0 * pi * options.disturbance_frequency
        self._window = window(options.fault_window)

    def act(self, time: float) -> bool:
        """Return whether any fault acts at a time, in seconds."""
        return bool(self.on) and time in self._window

    def lose(self, random: np.random.Generator) -> bool:
        """Draw whether the command of this step is lost."""
        return self._loss > 0.0 and bool(random.random() < self._loss)

    def moved(self, u: Array) -> Array:
        """Return the part of an input (m,) beyond the dead zone."""
        return np.asarray(u - np.clip(u, -self._dead, self._dead))

    def push(self, time: float, dt: float, random: np.random.Generator) -> Array:
        """Return the disturbance (m,) of the input during a step of ``dt`` from ``time`` on.

        White noise of density V has the variance V / dt when it is held for a step.
        """
        push = self._constant + self._amplitude * sin(self._omega * time)
        if self._density.any():
            std = np.sqrt(self._density / dt)
            push = push + std * random.standard_normal(len(std))
        return np.asarray(push)
