# SPDX-License-Identifier: Apache-2.0
"""The worst case of a scenario's loop while its plant has other parameters than believed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any

import numpy as np

from kalman_ros.control.compensator import current_compensator
from kalman_ros.control.lqr import Cost
from kalman_ros.control.margins import Margins
from kalman_ros.control.margins import margins as margins_of
from kalman_ros.control.performance import NoisyLoop, noisy_loop
from kalman_ros.control.state_space import StateSpace
from kalman_ros.control.worst_case import (
    Bracket,
    StabilityLimit,
    stability_limit,
    worst_cost,
    worst_peak,
)
from kalman_ros.core import Array, is_finite
from kalman_ros.scenario import Scenario, build
from kalman_ros.scenario.regulator import feedback, price

from .input_loops import even_estimator, even_noise, margins_or_none
from .observability import stacked
from .tuning.named_parameters import NamedParameters

#: The name of a factor of all inputs, as the plant's parameter.
ACTUATOR_GAIN = 'actuator_gain'
#: The most parameters: the work grows as 6 to their power, and the boxes with it.
MOST_PARAMETERS = 3


@dataclass(frozen=True)
class Plant:
    """What may differ from the belief: model and sensors, and a factor of all inputs."""

    scenario: Scenario
    gain: float = 1.0


@dataclass(frozen=True)
class WorstCases:
    """The worst of a loop over a box of parameters.

    Parameters
    ----------
    names
        Names of the parameters (d,).
    nominal, low, high
        Values that the design believes, and the ends of the box (d,).
    nominal_cost
        Mean cost per second of the plant as believed.
    cost
        Largest mean cost per second.
    nominal_disk
        Disk margin of the plant as believed, by input.
    disk
        By input, with the other inputs closed: the largest peak of S - T, which is two over the
        disk margin.
    margins
        By input: all margins at the point of the largest peak; None if the loop is unstable there.
    stability
        How much larger the box may be.
    """

    names: tuple[str, ...]
    nominal: Array
    low: Array
    high: Array
    nominal_cost: float
    cost: Bracket
    nominal_disk: Mapping[str, float]
    disk: Mapping[str, Bracket]
    margins: Mapping[str, Margins | None]
    stability: StabilityLimit


class PlantLoops:
    """The loops of the estimator and law of one scenario with other plants.

    Estimator and law are designed for the scenario and do not change. As in a design, each
    sensor counts as if it read at every step, and the plant is linearised where it rests.

    Parameters
    ----------
    scenario
        The scenario that estimator and law believe.
    plants
        The plant at parameters (d,).
    weights
        The cost of one sample that is judged; by default that of the scenario.

    Raises
    ------
    DesignError
        If there is no input, no law, or no steady-state estimator.
    """

    def __init__(
        self, scenario: Scenario, plants: Callable[[Array], Plant], weights: Cost | None = None
    ) -> None:
        self._dt, self._plants = 1.0 / scenario.rate, plants
        self._known: dict[bytes, tuple[StateSpace, Array, Array]] = {}
        law = feedback(scenario)
        estimator = even_estimator(scenario, scenario.model.equilibrium)
        self._weights = weights or price(scenario)
        plant, _, _ = self._sampled(Plant(scenario))
        self.controller = current_compensator(plant, law.system(self._dt), estimator)

    def noisy(self, at: Array) -> NoisyLoop:
        """Return the loop with its noise and its cost of one sample."""
        plant, W, V = self._plant(at)
        return noisy_loop(plant, self.controller, W, V, self._weights)

    def broken(self, at: Array, input: int) -> StateSpace:
        """Return the loop that is broken at one input."""
        plant, _, _ = self._plant(at)
        return (self.controller @ plant).channel(input)

    def difference(self, at: Array, input: int) -> StateSpace:
        """Return S - T at one input."""
        T = self.broken(at, input).closed()
        return StateSpace(T.A, T.B, -2.0 * T.C, 1.0 - 2.0 * T.D, T.dt)

    def _plant(self, at: Array) -> tuple[StateSpace, Array, Array]:
        """Return the sampled plant at parameters (d,), computed once."""
        key = at.tobytes()
        if key not in self._known:
            with np.errstate(all='ignore'):  # what overflows is refused below
                plant, W, V = self._sampled(self._plants(at))
            if not all(map(is_finite, (plant.A, plant.B, plant.C, W, V))):
                place = ', '.join(f'{value:.4g}' for value in at.tolist())
                raise ValueError(f'intervals: expected plants with finite numbers, not at {place}')
            self._known[key] = plant, W, V
        return self._known[key]

    def _sampled(self, plant: Plant) -> tuple[StateSpace, Array, Array]:
        """Return the sampled plant, its process noise and the noise of all readings."""
        scenario = plant.scenario
        point = scenario.model.equilibrium
        step = scenario.model.transition(*point, self._dt)
        C = stacked(scenario, point.state)
        G = plant.gain * step.G
        direct = np.zeros((len(C), G.shape[1]))
        return StateSpace(step.F, G, C, direct, self._dt), step.Q, even_noise(scenario)


def worst_cases(
    scenario: Scenario,
    plants: Callable[[Array], Plant],
    box: Mapping[str, tuple[float, float, float]],
    weights: Cost | None = None,
) -> WorstCases:
    """Return the worst of a scenario's loop over a box of the plant's parameters.

    Parameters
    ----------
    scenario
        The scenario that estimator and law believe.
    plants
        The plant at parameters (d,), in the order of ``box``.
    box
        Nominal value, low and high end by name.
    weights
        The cost of one sample that is judged; by default that of the scenario.

    Raises
    ------
    ValueError
        If there are too many parameters, or an interval is invalid.
    DesignError
        If there is no design, or its loop is not even stable with the plant as believed.
    """
    _check(box)
    names, rate = tuple(box), scenario.rate
    nominal, low, high = (np.array(ends, dtype=float) for ends in zip(*box.values()))
    loops = PlantLoops(scenario, plants, weights)
    nominal_cost = loops.noisy(nominal).cost * rate
    cost = worst_cost(loops.noisy, low, high)
    nominal_disk, disk, margins = {}, {}, {}
    for index, name in enumerate(scenario.model.input.names):
        nominal_disk[name] = margins_of(loops.broken(nominal, index)).disk.alpha
        disk[name] = worst_peak(partial(loops.difference, input=index), low, high)
        margins[name] = margins_or_none(loops.broken(disk[name].point, index))
    unstable = [at.point for at in (cost, *disk.values()) if at.reached == inf]
    return WorstCases(
        names, nominal, low, high, nominal_cost,
        Bracket(cost.reached * rate, cost.bound * rate, cost.point), nominal_disk, disk, margins,
        stability_limit(loops.noisy, nominal, low, high, unstable),
    )  # fmt: skip


def named_plants(
    values: Mapping[str, Any], intervals: Mapping[str, tuple[float, float]]
) -> tuple[Callable[[Array], Plant], dict[str, tuple[float, float, float]]]:
    """Return the plants of parameters by their names, and the box of these parameters.

    Parameters
    ----------
    values
        Parameters of a scenario, flat.
    intervals
        Low and high ends by name, as for a fit: ``mass``, ``model_parameters.mass``; or
        ``actuator_gain``, a factor of all inputs.

    Raises
    ------
    ValueError
        If a name is unknown, ambiguous, or not that of the plant.
    """
    named, box = NamedParameters(values), dict[str, tuple[float, float, float]]()
    for name, (low, high) in intervals.items():
        if name == ACTUATOR_GAIN:
            box[name] = (1.0, low, high)
            continue
        parameter, *others = named.choose([name])
        if others:
            parts = ', '.join(other.name for other in (parameter, *others))
            raise ValueError(f'{name}: expected the name of one number, one of {parts}')
        full = parameter.name
        if full.startswith('initial_') or full.rpartition('.')[2] in ('delay', 'bias'):
            raise ValueError(f'{full}: expected a parameter that changes the loop')
        box[full] = (parameter.start, low, high)
    named.choose([name for name in box if name != ACTUATOR_GAIN])

    def plants(at: Array) -> Plant:
        real = dict(zip(box, at.tolist()))
        gain = real.pop(ACTUATOR_GAIN, 1.0)
        return Plant(build({**values, **named.changes(real)}, with_law=False), gain)

    return plants, box


def _check(box: Mapping[str, tuple[float, float, float]]) -> None:
    if not 1 <= len(box) <= MOST_PARAMETERS:
        raise ValueError(f'intervals: expected 1 to {MOST_PARAMETERS} parameters, got {len(box)}')
    for name, (nominal, low, high) in box.items():
        if not low < high or not low <= nominal <= high:
            raise ValueError(
                f'{name}: expected low < high about its designed value {nominal:g}, '
                f'got {low:g} to {high:g}'
            )
