# SPDX-License-Identifier: Apache-2.0
"""Many closed loops at once, each with noise of its own: a Monte Carlo experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array, ArrayLike, DesignError
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.monte_carlo import Experiment, spawned
from kalman_ros.simulation.monte_carlo import monte_carlo as outcomes_of_runs
from kalman_ros.simulation.run_statistics import Outcomes

from . import text
from .accept import duration, number, whole
from .estimates import _path
from .known_names import KnownNames
from .loop_law import Given, Reference, loop_of
from .lost_runs import allowed, lost_runs
from .simulating import SimulatedRun, run_of

#: The probability with which consistent filters are outside of the bounds that are stated.
_MISS = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class ManyRuns(KnownNames):
    """Runs of a loop with their statistics; it prints and draws itself.

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
    _loop: Loop

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

    def run(self, index: int) -> SimulatedRun:
        """Return a run of these again, step by step: ``kr.simulate`` with its seed."""
        if not -self.runs <= index < self.runs:
            raise IndexError(f'run: expected an index below {self.runs}, got {index}')
        return run_of(self._loop, self.seeds[index])

    def _mean(self, values: Array) -> Array:
        """Return the mean over the runs that are not lost; NaN if all are."""
        kept = values[~self.lost]
        return np.asarray(kept.mean(axis=0) if len(kept) else np.full(values.shape[1:], np.nan))

    def _step(self, total: Array) -> Array:
        count = np.maximum(self.outcomes.count, 1)
        return total / (count if total.ndim == 1 else count[:, np.newaxis])

    def __repr__(self) -> str:
        scenario, state = self.scenario, self.scenario.model.state
        law = f', law {scenario.law}' if scenario.law else ''
        lines = text.sentence(
            f'{self.runs} runs of {type(scenario.model).__name__} for {self.seconds:g} s at '
            f'{scenario.rate:g} Hz, filter {scenario.filter}{law}; averages from '
            f'{self.after:g} s on'
        )
        cells = (
            [state.label(name), *map(text.number, pair)]
            for name, pair in zip(state.names, zip(self.rms.tolist(), self.std.tolist()))
        )
        lines += text.table(['', 'RMS error', 'claimed'], cells)
        low, high = self.anees_bounds
        if self.runs > 1:
            verdict = 'consistent' if self.consistent else 'NOT consistent'
            lines.append(
                f'ANEES {self.anees:.4g}, within {low:.4g} to {high:.4g} for a consistent '
                f'filter: {verdict}'
            )
        else:
            lines.append(f'NEES {self.anees:.4g} of its degrees')
        shown = ', '.join(f'{name} {value:.4g}' for name, value in self.nis.items())
        lines += text.sentence(f'NIS of its degrees: {shown}') if shown else []
        if self.outcomes.cost.size:
            lines.append(f'cost per second {self.cost:.4g} ± {self.cost_error:.2g}')
        limited = float(self.outcomes.limited.mean())
        if limited:
            lines.append(f'a limit changed the input in {100.0 * limited:.3g} % of the steps')
        if self.lost.any():
            first = ', '.join(map(str, np.flatnonzero(self.lost)[:5].tolist()))
            lines.append(
                f'{np.count_nonzero(self.lost)} of {self.runs} runs are lost, not in the '
                f'averages; the first: {first}'
            )
        return '\n'.join(lines)

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw the errors of all runs and what was claimed, and the ANEES, over time.

        Returns
        -------
        The axes of a figure of matplotlib, which a notebook shows and ``plt.show()`` opens; with a
        ``path`` the figure is saved there instead, and closed.
        """
        from kalman_ros.report.many_runs_picture import many_runs  # matplotlib is slow to load

        return many_runs(self, _path(path))


def monte_carlo(
    scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    runs: int = 100,
    seconds: float = 10.0,
    seed: int = 0,
    workers: int = 1,
    after: float | None = None,
    lost: Mapping[str, float] | None = None,
    reference: Reference = None,
    gain: ArrayLike | None = None,
    input_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
    chunk: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ManyRuns:
    """Return many runs of a loop, computed together, with the statistics of their errors.

    Each is a run of `simulate` with a seed of its own, spawned from ``seed``: run k is the same
    however many runs there are, and however they are divided among chunks and processes. Where
    no reading changes the covariances, as in a linear loop without gates, all runs share them.

    Parameters
    ----------
    scenario, overrides, reference, gain, input_limit, input_rate_limit
        As for `simulate`; the same for all runs.
    runs
        How many.
    seconds
        The duration of each run.
    seed
        From which those of the runs are spawned.
    workers
        Processes among which the runs are divided.
    after
        Seconds of the start that averages over time omit; by default those in which the loop
        settles in theory, but at most half of a run.
    lost
        The largest error of a state, and distance from its reference, at the end of a run that
        is not lost, by name; by default ten times what they are at the start, initial standard
        deviation included. A run with a number that is not finite is always lost.
    chunk
        The most runs to compute at a time; by default as many as are quick.
    progress
        Called with the number of runs that are complete, after each chunk.

    Raises
    ------
    ValueError
        If an argument is invalid, or no input holds the reference.
    DesignError
        If the law has no solution.
    """
    given = Given(reference, gain, input_limit, input_rate_limit)
    real, believed, law = loop_of(scenario, overrides, given)
    seconds, runs = duration('seconds', seconds), whole('runs', runs, 1)
    seed, workers = whole('seed', seed), whole('workers', workers, 1)
    chunk = None if chunk is None else whole('chunk', chunk, 1)
    loop = Loop(real, believed, seconds, law)
    if after is None:
        after = _settling(believed, law is not None, seconds)
    elif not 0.0 <= number('after', after, 'a number of seconds') <= seconds:
        raise ValueError(f'after: expected 0 to {seconds:g} s, the duration, got {after:g}')
    most = allowed(real, lost)
    weight = regulators.price(believed).weight if law is not None else None
    seeds = spawned(seed, runs)
    experiment = Experiment(loop, weight, round(float(after) * real.rate))
    found = outcomes_of_runs(experiment, seeds, workers=workers, chunk=chunk, progress=progress)
    target = law.target(seconds) if law is not None else None
    gone = lost_runs(real, found, target, most)
    return ManyRuns(believed, seeds, seconds, float(after), gone, found, loop)


def _settling(scenario: Scenario, controlled: bool, seconds: float) -> float:
    """Return the seconds in which a loop settles in theory; 0 if there is none."""
    if not controlled or not scenario.enabled:
        return 0.0
    from kalman_ros.analysis.checks import theory

    try:
        settling = theory(scenario).settling_time
    except (DesignError, ValueError):
        return 0.0
    return min(settling, 0.5 * seconds)
