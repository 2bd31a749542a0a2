# SPDX-License-Identifier: Apache-2.0
"""Many closed loops at once, with independent noise: a Monte Carlo experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.ensemble import Ensemble, ensemble
from kalman_ros.compiled import is_available
from kalman_ros.core import ArrayLike
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.loop_law import Reference
from kalman_ros.simulation.monte_carlo import spawned

from . import text
from .accept import duration, limits_given, number, whole
from .estimates import _path
from .loop_setup import Given, loop_of
from .simulating import SimulatedRun, run_of


@dataclass(frozen=True, eq=False, repr=False)
class ManyRuns(KnownNames, Ensemble):
    """Runs of a loop with their statistics; it prints and draws itself."""

    _loop: Loop

    def run(self, index: int) -> SimulatedRun:
        """Return a run of these again, step by step: ``kr.simulate`` with its seed."""
        if not -self.runs <= index < self.runs:
            raise IndexError(f'run: expected an index below {self.runs}, got {index}')
        return run_of(self._loop, self.seeds[index])

    def __repr__(self) -> str:
        scenario, state = self.scenario, self.scenario.model.state
        law = f', law {scenario.law}' if scenario.law else ''
        lines = text.sentence(
            f'{self.runs} runs of {type(scenario.model).__name__} for {self.seconds:g} s at '
            f'{scenario.rate:g} Hz, filter {scenario.filter}{law}; averages from '
            f'{self.after:g} s on'
        )
        if self._loop.faults is not None:
            lines += text.sentence(f'faults: {self._loop.faults}')
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


@knows_arguments(N='runs', n='runs', T='seconds', duration='seconds')
def monte_carlo(
    scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    runs: int = 100,
    seconds: float = 10.0,
    seed: int = 0,
    workers: int = 1,
    dask: str = '',
    after: float | None = None,
    lost: Mapping[str, float] | None = None,
    reference: Reference = None,
    gain: ArrayLike | None = None,
    input_limit: ArrayLike | None = None,
    input_lower_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
    chunk: int | None = None,
    progress: Callable[[int], None] | None = None,
    arithmetic: str = 'compiled',
) -> ManyRuns:
    """Return many runs of a loop, computed together, with the statistics of their errors.

    Each is a run of `simulate` with a separate seed, spawned from ``seed``: run k is the same
    however many runs there are, and however they are divided among chunks and processes. Where
    no reading changes the covariances, as in a linear loop without gates, all runs share them.

    Parameters
    ----------
    scenario, overrides, reference, gain, input_limit, input_lower_limit, input_rate_limit
        As for `simulate`, faults included; the same for all runs. Runs whose readings may be
        late are computed one after the other.
    runs
        How many.
    seconds
        The duration of each run.
    seed
        From which those of the runs are spawned.
    workers
        Processes among which the runs are divided.
    dask
        The address of a Dask scheduler, ``'tcp://host:8786'``, whose workers run them instead.
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
    arithmetic
        What computes the filter: ``'compiled'`` formulas of model and sensors, or ``'c'``, the C
        that `export` writes, so that many runs test what will run on a board.

    Raises
    ------
    ValueError
        If an argument is invalid, no input holds the reference, or C does not have the filter.
    DesignError
        If the law has no solution.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> many = kr.monte_carlo('mass_spring_damper_2d', runs=50, seconds=5, seed=1)
    >>> many.rms.round(3)
    array([0.023, 0.114, 0.022, 0.114])
    """
    given = Given(reference, gain, limits_given(input_limit, input_lower_limit, input_rate_limit))
    loop, law = loop_of(scenario, overrides, given, duration('seconds', seconds))
    loop = replace(loop, replaced=_replaced(arithmetic, loop.believed))
    result = ensemble(
        loop,
        law,
        spawned(whole('seed', seed), whole('runs', runs, 1)),
        after=None if after is None else number('after', after, 'a number of seconds'),
        lost=lost,
        workers=whole('workers', workers, 1),
        dask=dask,
        chunk=None if chunk is None else whole('chunk', chunk, 1),
        progress=progress,
    )
    values = {field.name: getattr(result, field.name) for field in fields(Ensemble)}
    return ManyRuns(**values, _loop=loop)


def _replaced(arithmetic: str, believed: Scenario) -> Callable[[Estimation], Estimation] | None:
    """Return what replaces the filter of a loop; None if nothing does."""
    if arithmetic not in ('compiled', 'c'):
        raise ValueError(f"arithmetic: expected 'compiled' or 'c', got {arithmetic!r}")
    if arithmetic == 'compiled':
        return None
    if not is_available():
        raise ValueError("arithmetic: 'c' is not possible here: CasADi is not installed")
    from kalman_ros.embedded.filter_in_c import in_c  # CasADi is slow to load

    return partial(in_c, believed)
