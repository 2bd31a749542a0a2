# SPDX-License-Identifier: Apache-2.0
"""Statistics of many runs of a loop: errors, consistency, cost, and the share of lost runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array, DesignError
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.loop_law import Law
from kalman_ros.simulation.lost_runs import allowed, lost_runs
from kalman_ros.simulation.monte_carlo import Experiment, Progress, monte_carlo
from kalman_ros.simulation.run_statistics import Outcomes

from . import checks

#: The probability that a consistent filter is outside the bounds.
_MISS = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """The runs of a loop and their statistics.

    Averages over time begin ``after`` seconds; averages over runs omit lost runs.

    Parameters
    ----------
    scenario
        Scenario of the estimator and the controller.
    seeds
        Seed of each run; ``kr.simulate`` with this seed repeats the run.
    seconds, after
        Duration of each run, and of its start, which averages omit, in seconds.
    lost
        Whether each run is lost (runs,).
    outcomes
        Results of each run and of each step.
    """

    scenario: Scenario
    seeds: tuple[int, ...]
    seconds: float
    after: float
    lost: npt.NDArray[np.bool_]
    outcomes: Outcomes

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.seeds)

    @property
    def time(self) -> Array:
        """Time (N,) of each step in seconds."""
        return np.arange(len(self.outcomes.count)) / self.scenario.rate

    @property
    def rms(self) -> Array:
        """Root mean square error of each state (n,)."""
        return np.asarray(np.sqrt(self._mean_over_runs(self.outcomes.squared_error)))

    @property
    def std(self) -> Array:
        """Root mean variance of each state (n,), as the estimators computed it."""
        first = round(self.after * self.scenario.rate)
        count = max(1, int(self.outcomes.count[first:].sum()))
        return np.asarray(np.sqrt(self.outcomes.step_variance[first:].sum(axis=0) / count))

    @property
    def anees(self) -> float:
        """Average NEES divided by its degrees of freedom: 1 for a consistent filter."""
        return float(self._mean_over_runs(self.outcomes.nees))

    @cached_property
    def anees_bounds(self) -> tuple[float, float]:
        """Interval that contains the `anees` of a consistent filter in 95 % of experiments.

        It follows from the scatter of the runs, which are independent. A single run has no bounds.
        """
        values = self.outcomes.nees[~self.lost]
        if len(values) < 2:
            return 0.0, np.inf
        variance = float(values.var(ddof=1)) / len(values) / float(values.mean()) ** 2
        return chi_square_bounds(1.0, variance, _MISS) if variance > 0.0 else (1.0, 1.0)

    @property
    def consistent(self) -> bool:
        """Whether `anees` is within `anees_bounds`."""
        low, high = self.anees_bounds
        return low <= self.anees <= high

    @property
    def nis(self) -> dict[str, float]:
        """Average NIS divided by its degrees of freedom, by sensor."""
        averages = {}
        for name, values in self.outcomes.nis.items():
            values = values[~self.lost & np.isfinite(values)]
            if len(values):
                averages[name] = float(values.mean())
        return averages

    @property
    def cost(self) -> float:
        """Mean cost per second; NaN without an input."""
        if not self.outcomes.cost.size:
            return np.nan
        return float(self._mean_over_runs(self.outcomes.cost)) * self.scenario.rate

    @property
    def cost_error(self) -> float:
        """Standard error of `cost`; NaN for a single run."""
        values = self.outcomes.cost[~self.lost] if self.outcomes.cost.size else np.empty(0)
        if len(values) < 2:
            return np.nan
        return float(values.std(ddof=1) / np.sqrt(len(values))) * self.scenario.rate

    @property
    def lost_share(self) -> float:
        """Share of the runs that are lost."""
        return float(np.mean(self.lost))

    @property
    def step_anees(self) -> Array:
        """Average NEES at each step (N,), divided by its degrees of freedom."""
        return self._mean_by_step(self.outcomes.step_nees) / self.scenario.model.state.size

    @property
    def step_rms(self) -> Array:
        """Root mean square error at each step (N, n), over runs with finite numbers."""
        return np.asarray(np.sqrt(self._mean_by_step(self.outcomes.step_squares)))

    @property
    def step_std(self) -> Array:
        """Root mean variance at each step (N, n), as the estimators computed it."""
        return np.asarray(np.sqrt(self._mean_by_step(self.outcomes.step_variance)))

    def _mean_over_runs(self, values: Array) -> Array:
        """Return the mean over the runs that are not lost; NaN if all runs are lost."""
        valid = values[~self.lost]
        return np.asarray(valid.mean(axis=0) if len(valid) else np.full(values.shape[1:], np.nan))

    def _mean_by_step(self, total: Array) -> Array:
        count = np.maximum(self.outcomes.count, 1)
        return total / (count if total.ndim == 1 else count[:, np.newaxis])


def ensemble(
    loop: Loop,
    law: Law | None,
    seeds: tuple[int, ...],
    *,
    after: float | None = None,
    lost: Mapping[str, float] | None = None,
    workers: int = 1,
    dask: str = '',
    chunk: int | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Run a loop once with each seed and return the runs.

    Parameters
    ----------
    loop
        Loop to simulate.
    law
        Control law of the loop, if it has one.
    seeds
        Seeds of the runs.
    after
        Duration in seconds of the start that averages omit; by default `settling`.
    lost
        Limits as for `lost_runs`, by the names of states.
    workers, dask, chunk, progress
        As for `monte_carlo`.

    Raises
    ------
    ValueError
        If ``after`` or ``lost`` is invalid.
    """
    scenario, believed = loop.scenario, loop.believed
    limits = allowed(scenario, lost)
    if after is None:
        after = settling(believed, law is not None, loop.seconds)
    elif not 0.0 <= after <= loop.seconds:
        raise ValueError(f'after: expected 0 to {loop.seconds:g} s, the duration, got {after:g}')
    experiment = Experiment(loop, _weight(believed) if law else None, round(after * scenario.rate))
    outcomes = monte_carlo(
        experiment, seeds, workers=workers, dask=dask, chunk=chunk, progress=progress
    )
    lost_mask = lost_runs(scenario, outcomes, law.target(loop.seconds) if law else None, limits)
    return Ensemble(believed, seeds, loop.seconds, after, lost_mask, outcomes)


def _weight(scenario: Scenario) -> Array:
    """Return the weight matrix of the stacked state and input in the cost of a step."""
    return regulators.price(scenario).weight


def settling(scenario: Scenario, controlled: bool, seconds: float) -> float:
    """Return the theoretical settling time of a loop in seconds, at most half of ``seconds``.

    It is 0 without a controller, or without a theory.
    """
    if not controlled or not scenario.enabled:
        return 0.0
    try:
        settling_time = checks.theory(scenario).settling_time
    except (DesignError, ValueError):
        return 0.0
    return min(settling_time, 0.5 * seconds)
