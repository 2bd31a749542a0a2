# SPDX-License-Identifier: Apache-2.0
"""The statistics of many runs of a loop: errors, consistency, cost, and the share that is lost."""

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

#: The probability with which consistent filters are outside of the bounds that are stated.
_MISS = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """Runs of a loop with their statistics.

    Averages over time begin ``after`` seconds, and those over runs omit the runs that are lost.

    Parameters
    ----------
    scenario
        The scenario of the estimator and the controller.
    seeds
        Of each run: ``kr.simulate`` with one of them is that run.
    seconds, after
        The duration of each run, and of its start, which averages omit.
    lost
        The runs that are lost (runs,).
    outcomes
        The numbers of each run and of each step.
    """

    scenario: Scenario
    seeds: tuple[int, ...]
    seconds: float
    after: float
    lost: npt.NDArray[np.bool_]
    outcomes: Outcomes

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(self.seeds)

    @property
    def time(self) -> Array:
        """The time (N,) of each step in seconds."""
        return np.arange(len(self.outcomes.count)) / self.scenario.rate

    @property
    def rms(self) -> Array:
        """The root mean square error of each state (n,)."""
        return np.asarray(np.sqrt(self._mean(self.outcomes.squared_error)))

    @property
    def std(self) -> Array:
        """What the estimators claimed: the root mean variance of each state (n,)."""
        first = round(self.after * self.scenario.rate)
        count = max(1, int(self.outcomes.count[first:].sum()))
        return np.asarray(np.sqrt(self.outcomes.step_variance[first:].sum(axis=0) / count))

    @property
    def anees(self) -> float:
        """The average normalised error squared over its degrees: 1 for a consistent filter."""
        return float(self._mean(self.outcomes.nees))

    @cached_property
    def anees_bounds(self) -> tuple[float, float]:
        """Where the `anees` of a consistent filter is in 95 % of such experiments.

        From the scatter of the runs, which are independent; without bounds for a single run.
        """
        values = self.outcomes.nees[~self.lost]
        if len(values) < 2:
            return 0.0, np.inf
        variance = float(values.var(ddof=1)) / len(values) / float(values.mean()) ** 2
        return chi_square_bounds(1.0, variance, _MISS) if variance > 0.0 else (1.0, 1.0)

    @property
    def consistent(self) -> bool:
        """Whether the `anees` is within its bounds."""
        low, high = self.anees_bounds
        return low <= self.anees <= high

    @property
    def nis(self) -> dict[str, float]:
        """The average normalised innovation squared over its degrees, by sensor."""
        found = {}
        for name, values in self.outcomes.nis.items():
            values = values[~self.lost & np.isfinite(values)]
            if len(values):
                found[name] = float(values.mean())
        return found

    @property
    def cost(self) -> float:
        """The mean cost per second; NaN without an input."""
        if not self.outcomes.cost.size:
            return np.nan
        return float(self._mean(self.outcomes.cost)) * self.scenario.rate

    @property
    def cost_error(self) -> float:
        """The standard error of `cost`; NaN for a single run."""
        values = self.outcomes.cost[~self.lost] if self.outcomes.cost.size else np.empty(0)
        if len(values) < 2:
            return np.nan
        return float(values.std(ddof=1) / np.sqrt(len(values))) * self.scenario.rate

    @property
    def lost_share(self) -> float:
        """The share of the runs that are lost."""
        return float(np.mean(self.lost))

    @property
    def step_anees(self) -> Array:
        """The average normalised error squared at each step (N,), over its degrees."""
        return self._step(self.outcomes.step_nees) / self.scenario.model.state.size

    @property
    def step_rms(self) -> Array:
        """The root mean square error at each step (N, n), over runs with finite numbers."""
        return np.asarray(np.sqrt(self._step(self.outcomes.step_squares)))

    @property
    def step_std(self) -> Array:
        """The root mean variance that was claimed at each step (N, n)."""
        return np.asarray(np.sqrt(self._step(self.outcomes.step_variance)))

    def _mean(self, values: Array) -> Array:
        """Return the mean over the runs that are not lost; NaN if all are."""
        kept = values[~self.lost]
        return np.asarray(kept.mean(axis=0) if len(kept) else np.full(values.shape[1:], np.nan))

    def _step(self, total: Array) -> Array:
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
    """Return the runs of a loop with these seeds.

    Parameters
    ----------
    loop
        The loop.
    law
        Its controller, if it has one.
    seeds
        Of the runs.
    after
        Seconds of the start that averages omit; by default `settling`.
    lost
        As for `lost_runs`, by the names of states.
    workers, dask, chunk, progress
        As for `monte_carlo`.

    Raises
    ------
    ValueError
        If ``after`` or ``lost`` is invalid.
    """
    real, believed = loop.scenario, loop.believed
    most = allowed(real, lost)
    if after is None:
        after = settling(believed, law is not None, loop.seconds)
    elif not 0.0 <= after <= loop.seconds:
        raise ValueError(f'after: expected 0 to {loop.seconds:g} s, the duration, got {after:g}')
    experiment = Experiment(loop, _weight(believed) if law else None, round(after * real.rate))
    found = monte_carlo(
        experiment, seeds, workers=workers, dask=dask, chunk=chunk, progress=progress
    )
    gone = lost_runs(real, found, law.target(loop.seconds) if law else None, most)
    return Ensemble(believed, seeds, loop.seconds, after, gone, found)


def _weight(scenario: Scenario) -> Array:
    """Return the weight of the stacked state and input in the cost of a step."""
    return regulators.price(scenario).weight


def settling(scenario: Scenario, controlled: bool, seconds: float) -> float:
    """Return the seconds in which a loop settles in theory, at most half of ``seconds``.

    0 without a controller, or without a theory.
    """
    if not controlled or not scenario.enabled:
        return 0.0
    try:
        found = checks.theory(scenario).settling_time
    except (DesignError, ValueError):
        return 0.0
    return min(found, 0.5 * seconds)
