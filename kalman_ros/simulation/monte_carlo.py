# SPDX-License-Identifier: Apache-2.0
"""Many runs of a plant and an estimator side by side, each with noise of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.filter import Filter
from kalman_ros.linear.factor import cholesky
from kalman_ros.scenario import Scenario

from .plant import SimulatedPlant


@dataclass(frozen=True)
class Consistency:
    """Averages over runs, each divided by its expectation: 1 for a consistent filter.

    Parameters
    ----------
    runs
        How many there were.
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
        """Return which share of the averages is within bounds that are missed so often."""
        low, high = chi_square_bounds(1.0, 2.0 / (self.degrees[name] * self.runs), miss)
        values = self.anis[name] if name else self.anees
        return float(np.mean((low <= values) & (values <= high)))


class Moment(NamedTuple):
    """The state (n,) at a step of a run, and the readings (k,) that are due there, by sensor."""

    state: Array
    readings: Mapping[str, Array]


def truths(scenario: Scenario, runs: int, steps: int) -> list[list[Moment]]:
    """Return what happens in runs from states drawn from the initial belief, step by step.

    The seeds are 0, 1, ...; the input is that of the equilibrium.
    """
    timed = {name: source.timed for name, source in scenario.enabled.items()}
    u, found = scenario.model.equilibrium.input, []
    for run in range(runs):
        start = _draw(scenario.initial_belief, run)
        plant, moments = SimulatedPlant(scenario.model, timed, scenario.rate, start, run), []
        for step in range(steps):
            if step:
                plant.step(u)
            moments.append(Moment(plant.state, plant.readings()))
        found.append(moments)
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
        Of the same system, or of one that is believed to be it.
    runs
        With the seeds 0, 1, ...
    steps
        Of each run.
    noise
        The standard deviations that the filter believes the sensors to have, relative to those
        that they have.
    drawn
        The `truths`, if they are there already; those of another filter of the same scenario
        will do.
    """
    timed = {name: source.timed for name, source in scenario.enabled.items()}
    believed = {
        name: t.sensor.with_covariance(noise**2 * t.sensor.covariance) for name, t in timed.items()
    }
    space, belief = scenario.model.state, scenario.initial_belief
    u = scenario.model.equilibrium.input
    dt = 1.0 / scenario.rate
    drawn = truths(scenario, runs, steps) if drawn is None else drawn
    all_nees = np.empty((runs, steps))
    all_nis: dict[str, list[list[float]]] = {name: [] for name in timed}
    for run, moments in enumerate(drawn):
        posterior = belief
        for found in all_nis.values():
            found.append([])
        for step, (truth, readings) in enumerate(moments):
            for name, y in readings.items():
                correction = filter.correct(posterior, y, believed[name])
                all_nis[name][-1].append(correction.nis)
                posterior = correction.posterior
            error = space.subtract(truth, posterior.mean)
            all_nees[run, step] = nees(error, posterior.covariance)
            posterior = filter.predict(posterior, u, dt)
    degrees = {'': space.size, **{name: t.sensor.output.size for name, t in timed.items()}}
    return Consistency(
        runs,
        all_nees.mean(axis=0) / space.size,
        {name: np.mean(values, axis=0) / degrees[name] for name, values in all_nis.items()},
        degrees,
    )


def _draw(belief: Gaussian, seed: int) -> Array:
    """Return a state (n,) drawn from a belief."""
    L, _, _ = cholesky(belief.covariance)
    return belief.mean + L @ np.random.default_rng(seed).standard_normal(belief.mean.size)
