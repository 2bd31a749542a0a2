# SPDX-License-Identifier: Apache-2.0
"""Many runs of a plant and an estimator with independent noise."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space
from kalman_ros.estimators.batch_estimator import for_many
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.filter import Filter
from kalman_ros.linear.factor import cholesky
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.batch_plant import BatchPlant


@dataclass(frozen=True)
class Consistency:
    """Averages over runs, each divided by its expectation: 1 for a consistent filter.

    Parameters
    ----------
    runs
        The number of runs.
    anees
        The average NEES at each step (N,).
    anis
        By sensor, the average NIS of each of its readings.
    degrees
        Of the NEES under ``''``, and of each sensor's NIS.
    """

    runs: int
    anees: Array
    anis: Mapping[str, Array]
    degrees: Mapping[str, int]

    def share_inside(self, name: str = '', miss: float = 0.05) -> float:
        """Return the fraction of averages within bounds missed with probability ``miss``."""
        low, high = chi_square_bounds(1.0, 2.0 / (self.degrees[name] * self.runs), miss)
        values = self.anis[name] if name else self.anees
        return float(np.mean((low <= values) & (values <= high)))


class Moment(NamedTuple):
    """The state (n,) at a step of a run, and its readings (k,), by sensor."""

    state: Array
    readings: Mapping[str, Array]


def truths(scenario: Scenario, runs: int, steps: int) -> list[list[Moment]]:
    """Return the moments of runs from states drawn from the initial belief, step by step.

    The seeds are 0, 1, ...; the input is that of the equilibrium.
    """
    timed = {name: source.timed for name, source in scenario.enabled.items()}
    space, belief, u = scenario.model.state, scenario.initial_belief, scenario.model.equilibrium
    starts = np.array([_draw(space, belief, run) for run in range(runs)])
    plant = BatchPlant(scenario.model, timed, scenario.rate, starts, range(runs), steps)
    found: list[list[Moment]] = [[] for _ in range(runs)]
    for step in range(steps):
        if step:
            plant.step(u.input)
        states, readings = np.array(plant.state), plant.readings()
        for run, moments in enumerate(found):
            own = {name: np.array(y[run]) for name, y in readings.items()}
            moments.append(Moment(states[run], own))
    return found


def consistency(
    scenario: Scenario,
    filter: Filter,
    runs: int,
    steps: int,
    *,
    noise: float = 1.0,
    drawn: Sequence[Sequence[Moment]] | None = None,
) -> Consistency:
    """Run a filter from truths drawn from its initial belief, with the equilibrium's input.

    Parameters
    ----------
    scenario
        The system.
    filter
        Of the same system, or of a wrong model of it.
    runs
        With the seeds 0, 1, ...
    steps
        Of each run.
    noise
        The standard deviations that the filter assumes for the sensors, relative to the true
        ones.
    drawn
        Precomputed `truths`; those of another filter of the same scenario are valid.
    """
    timed = {name: source.timed for name, source in scenario.enabled.items()}
    believed = {
        name: t.sensor.with_covariance(noise**2 * t.sensor.covariance) for name, t in timed.items()
    }
    space, u, dt = scenario.model.state, scenario.model.equilibrium.input, 1.0 / scenario.rate
    drawn = truths(scenario, runs, steps) if drawn is None else drawn
    try:  # all runs at once, which gives the same
        beliefs = [_Beliefs(for_many(filter), scenario.initial_belief, drawn)]
    except ValueError:
        beliefs = [_Beliefs(filter, scenario.initial_belief, [moments]) for moments in drawn]
    for each in beliefs:
        for step in range(steps):
            each.follow(step, believed, space)
            each.predict(u, dt)
    all_nees = np.concatenate([each.nees for each in beliefs], axis=1)
    all_nis = {
        name: np.concatenate([np.array(each.nis[name]) for each in beliefs], axis=1)
        for name in timed
    }
    degrees = {'': space.size, **{name: t.sensor.output.size for name, t in timed.items()}}
    return Consistency(
        runs,
        all_nees.mean(axis=1) / space.size,
        {name: values.mean(axis=1) / degrees[name] for name, values in all_nis.items()},
        degrees,
    )


class _Beliefs:
    """What a filter believes in some runs; a filter of one belief has one run."""

    def __init__(self, filter: Any, first: Gaussian, runs: Sequence[Sequence[Moment]]) -> None:
        self._filter, self._runs, self._belief = filter, runs, first
        self._one = len(runs) == 1
        if not self._one:
            self._belief = Gaussian(*(np.stack([part] * len(runs)) for part in first))
        self.nees: list[Array] = []
        self.nis: dict[str, list[Array]] = defaultdict(list)

    def follow(self, step: int, sensors: Mapping[str, Sensor], space: Space) -> None:
        """Take the readings of a step."""
        moments = [run[step] for run in self._runs]
        for name in moments[0].readings:
            y = self._stacked([moment.readings[name] for moment in moments])
            found = self._filter.correct(self._belief, y, sensors[name])
            self.nis[name].append(np.atleast_1d(found.nis))
            self._belief = found.posterior
        error = space.subtract(self._stacked([each.state for each in moments]), self._belief.mean)
        self.nees.append(np.atleast_1d(nees(error, self._belief.covariance)))

    def predict(self, u: Array, dt: float) -> None:
        """Go on by a step."""
        self._belief = self._filter.predict(self._belief, u, dt)

    def _stacked(self, each: Sequence[Array]) -> Array:
        return each[0] if self._one else np.array(each)


def _draw(space: Space, belief: Gaussian, seed: int) -> Array:
    """Return a state (n,) of a space, drawn from a belief."""
    L, _, _ = cholesky(belief.covariance)
    drawn = belief.mean + L @ np.random.default_rng(seed).standard_normal(belief.mean.size)
    return space.reached(drawn, belief.mean)
