# SPDX-License-Identifier: Apache-2.0
"""Many runs of a loop, in chunks, by one or several processes.

Each run has a seed of its own, so that its numbers depend neither on the other runs nor on how
the runs are divided.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.batch.batch_filters import BATCHED
from kalman_ros.estimators.batch.gain_schedule import GainSchedule

from . import closed_loop
from .batch_loop import Loop, run_batch
from .run_statistics import Outcomes, RunStatistics, outcomes_of

#: The most runs of a chunk: their arrays fit the cache of a processor.
MOST = 1000
#: Called with the number of runs that are complete.
Progress = Callable[[int], None]


def spawned(seed: int, runs: int) -> tuple[int, ...]:
    """Return the seeds of the runs: run k has the same one, however many there are."""
    children = (np.random.SeedSequence(seed, spawn_key=(k,)) for k in range(runs))
    # positive as a parameter of a node, too, which has 64 bits
    return tuple(int(child.generate_state(1, np.uint64)[0] >> np.uint64(1)) for child in children)


@dataclass(frozen=True)
class Experiment:
    """Loops and what is counted of them.

    Parameters
    ----------
    loop
        The loops.
    weight
        As for `RunStatistics`.
    first
        The first step that counts.
    """

    loop: Loop
    weight: Array | None
    first: int

    def outcomes(
        self, seeds: Sequence[int], schedule: GainSchedule | None = None
    ) -> tuple[Outcomes, GainSchedule | None]:
        """Return the outcomes of the runs with these seeds, and the gains that they shared.

        A filter without a batched form runs one loop after the other.
        """
        if (self.loop.filter or self.loop.believed.filter) not in BATCHED:
            return Outcomes.joined([self._outcome(seed) for seed in seeds]), None
        statistics = RunStatistics(self.loop, len(seeds), self.weight, self.first)
        finished = run_batch(self.loop, seeds, statistics, schedule=schedule)
        return statistics.outcomes(finished.limited), finished.schedule

    def _outcome(self, seed: int) -> Outcomes:
        loop = self.loop
        answer = loop.answer and loop.answer()
        command, arrives = loop.command, loop.arrives
        run = closed_loop.run(
            loop.scenario, None, loop.seconds, seed, believed=loop.believed, filter=loop.filter,
            command=command, answer=answer,
            arrives=lambda _, time: arrives is None or arrives(time),
        )  # fmt: skip
        limited = int(answer.limited) if answer else 0
        return outcomes_of(loop, run, self.weight, self.first, limited)


def monte_carlo(
    experiment: Experiment,
    seeds: Sequence[int],
    *,
    workers: int = 1,
    chunk: int | None = None,
    progress: Progress | None = None,
) -> Outcomes:
    """Return the outcomes of the runs with these seeds, in their order.

    Parameters
    ----------
    experiment
        The loops, and what is counted of them.
    seeds
        Of the runs.
    workers
        Processes.
    chunk
        The most runs at a time; by default as many as are quick.
    progress
        Called after each chunk, with the number of runs that are complete.

    Raises
    ------
    ValueError
        If a worker ends before its runs do.
    """
    size = chunk or min(MOST, -(-len(seeds) // workers))
    parts = [seeds[start : start + size] for start in range(0, len(seeds), size)]
    found: list[Outcomes | None] = [None] * len(parts)
    done = 0
    chunks = _here(experiment, parts) if workers == 1 else _there(experiment, parts, workers)
    for index, outcomes in chunks:
        found[index] = outcomes
        done += len(parts[index])
        if progress is not None:
            progress(done)
    return Outcomes.joined([each for each in found if each is not None])


def _here(
    experiment: Experiment, parts: Sequence[Sequence[int]]
) -> Iterator[tuple[int, Outcomes]]:
    schedule = None
    for index, part in enumerate(parts):
        outcomes, schedule = experiment.outcomes(part, schedule)
        yield index, outcomes


#: What the workers of this process compute; they are forked, and so need no copy of it.
_experiment: Experiment


def _chunk(part: Sequence[int]) -> Outcomes:
    return _experiment.outcomes(part)[0]


def _there(
    experiment: Experiment, parts: Sequence[Sequence[int]], workers: int
) -> Iterator[tuple[int, Outcomes]]:
    """Yield the outcomes of each part as a worker completes it."""
    global _experiment
    _experiment = experiment
    fork = multiprocessing.get_context('fork')
    with ProcessPoolExecutor(min(workers, len(parts)), mp_context=fork) as pool:
        waiting = {pool.submit(_chunk, part): index for index, part in enumerate(parts)}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool:
            raise ValueError('workers: a process ended before its runs did') from None
        finally:
            for future in waiting:
                future.cancel()
