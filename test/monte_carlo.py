# SPDX-License-Identifier: Apache-2.0
"""Many runs of a plant and an estimator with independent noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Space
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.filter import Filter
from kalman_ros.linear.factor import cholesky
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.simulated_plant import SimulatedPlant


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
    u, found = scenario.model.equilibrium.input, []
    for run in range(runs):
        start = _draw(scenario.model.state, scenario.initial_belief, run)
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


def _draw(space: Space, belief: Gaussian, seed: int) -> Array:
    """Return a state (n,) of a space, drawn from a belief."""
    L, _, _ = cholesky(belief.covariance)
    drawn = belief.mean + L @ np.random.default_rng(seed).standard_normal(belief.mean.size)
    return space.reached(drawn, belief.mean)
