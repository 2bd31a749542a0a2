# SPDX-License-Identifier: Apache-2.0
"""Many runs of a loop, in chunks, by one or several processes.

Each run has a separate seed, so that its numbers depend neither on the other runs nor on how
the runs are divided.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.gain_schedule import GainSchedule

from . import closed_loop
from .batch_loop import Loop, run_batch
from .computed import computed
from .linear_runs import LinearRuns, is_linear
from .run_statistics import Outcomes, RunStatistics, outcomes_of
from .spread import spread

#: Largest number of runs in a chunk, so that its arrays fit the cache of a processor.
MOST = 1000
#: Number of runs in a chunk that is sent elsewhere.
_SENT = 250
#: Function that is called with the number of runs that are complete.
Progress = Callable[[int], None]


def spawned(seed: int, runs: int) -> tuple[int, ...]:
    """Return the seeds of the runs: run k has the same seed, however many runs there are."""
    children = (np.random.SeedSequence(seed, spawn_key=(k,)) for k in range(runs))
    # positive as a parameter of a node, too, which has 64 bits
    return tuple(int(child.generate_state(1, np.uint64)[0] >> np.uint64(1)) for child in children)


@dataclass(frozen=True)
class Experiment:
    """Loops, with the steps and the cost that are counted.

    Parameters
    ----------
    loop
        Loops that are run.
    weight
        Weight (n + m, n + m) of the stacked state and input in the cost of a step; or None.
    first
        First step that counts.
    """

    loop: Loop
    weight: Array | None
    first: int

    def computed(self) -> Experiment:
        """Return the same experiment with models and sensors that are compiled."""
        loop = self.loop
        real = computed(loop.scenario)
        believed = real if loop.believed is loop.scenario else computed(loop.believed)
        return replace(self, loop=replace(loop, scenario=real, believed=believed))

    def outcomes(self, seeds: Sequence[int]) -> Outcomes:
        """Return the outcomes of the runs with these seeds.

        Loops with a filter of mixtures, or with readings that are late, run one after the other.
        """
        kind = filter_class(self.loop.filter or self.loop.believed.filter)
        if kind.mixture or not self.loop.in_order:
            return Outcomes.joined([self.outcome(seed) for seed in seeds])
        if self._linear is not None:
            with np.errstate(all='ignore'):
                outcomes = self._linear.outcomes(seeds)
            if outcomes is not None:
                return outcomes
        statistics = RunStatistics(self.loop, len(seeds), self.weight, self.first)
        limited = run_batch(self.loop, seeds, statistics, schedule=self._schedule)
        return statistics.outcomes(limited)

    def outcome(self, seed: int) -> Outcomes:
        """Return the outcomes of one run, by the code for a single loop."""
        loop = self.loop
        answer = loop.answer and loop.answer()
        command, arrives = loop.command, loop.arrives
        with np.errstate(all='ignore'):
            run = closed_loop.run(
                loop.scenario, None, loop.seconds, seed, believed=loop.believed,
                filter=loop.filter, command=command, answer=answer,
                arrives=lambda _, time: arrives is None or arrives(time), faults=loop.faults,
                replaced=loop.replaced,
            )  # fmt: skip
        limited = int(answer.limited) if answer else 0
        return outcomes_of(loop, run, self.weight, self.first, limited)

    @cached_property
    def _linear(self) -> LinearRuns | None:
        """The runs as matrix products, if everything is linear."""
        if not (self._schedule.applies and is_linear(self.loop)):
            return None
        return LinearRuns(self.loop, self.weight, self.first, self._schedule)

    @cached_property
    def _schedule(self) -> GainSchedule:
        """Gains that chunks share, where no reading changes them."""
        return GainSchedule(self.loop.estimation.filter)


def monte_carlo(
    experiment: Experiment,
    seeds: Sequence[int],
    *,
    workers: int = 1,
    dask: str = '',
    chunk: int | None = None,
    progress: Progress | None = None,
) -> Outcomes:
    """Return the outcomes of the runs with these seeds, in their order.

    Parameters
    ----------
    experiment
        Loops, with the steps and the cost that are counted.
    seeds
        Seeds of the runs.
    workers, dask
        Number of processes, or the address of a Dask scheduler: see `spread`.
    chunk
        Largest number of runs at a time; by default as many as are fast.
    progress
        Function that is called after each chunk, with the number of runs that are complete.

    Raises
    ------
    ValueError
        If a worker ends before its runs do.
    """
    experiment = experiment.computed()
    size = chunk or (_SENT if dask else min(MOST, -(-len(seeds) // workers)))
    parts = [seeds[start : start + size] for start in range(0, len(seeds), size)]
    results: dict[int, Outcomes] = {}
    for index, outcomes in spread(experiment.outcomes, parts, workers, dask):
        results[index] = outcomes
        if progress is not None:
            progress(sum(len(parts[done]) for done in results))
    return Outcomes.joined([results[index] for index in range(len(parts))])
