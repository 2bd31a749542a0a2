# SPDX-License-Identifier: Apache-2.0
"""Many runs of a plant and an estimator side by side, each with noise of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.factor import cholesky
from kalman_ros.estimators.filter import Filter

from .plant import SimulatedPlant
from .scenario import Scenario


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


def consistency(
    scenario: Scenario, filter: Filter, runs: int, steps: int, *, noise: float = 1.0
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
    """
    timed = {name: source.timed for name, source in scenario.enabled.items()}
    believed = {
        name: t.sensor.with_covariance(noise**2 * t.sensor.covariance) for name, t in timed.items()
    }
    space, belief = scenario.model.state, scenario.initial_belief
    u = scenario.model.equilibrium.input
    all_nees = np.empty((runs, steps))
    all_nis: dict[str, list[list[float]]] = {name: [] for name in timed}
    for run in range(runs):
        truth = _draw(belief, run)
        plant = SimulatedPlant(scenario.model, timed, scenario.rate, truth, run)
        posterior = belief
        for found in all_nis.values():
            found.append([])
        for step in range(steps):
            for name, y in plant.readings().items():
                correction = filter.correct(posterior, y, believed[name])
                all_nis[name][-1].append(correction.nis)
                posterior = correction.posterior
            error = space.subtract(plant.state, posterior.mean)
            all_nees[run, step] = nees(error, posterior.covariance)
            plant.step(u)
            posterior = filter.predict(posterior, u, plant.dt)
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
