# SPDX-License-Identifier: Apache-2.0
"""The closed loops of many runs at once, step by step: `closed_loop.run` with leading axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kalman_ros.core import Array, Gaussian, unchecked
from kalman_ros.estimators.batch_estimator import BatchEstimator
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.gain_schedule import GainSchedule
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation, estimation

from .batch_plant import BatchPlant
from .faults.plant_faults import PlantFaults


class Controller(Protocol):
    """Controller that turns estimates into inputs."""

    @property
    def limited(self) -> Any:
        """Number of steps in which a limit changed the input: of each run (runs,), or 0."""
        ...

    def __call__(self, time: int, x: Array) -> Array:
        """Return inputs (runs, m) or (m,) for a time in nanoseconds and estimates (runs, n)."""
        ...


@dataclass(frozen=True)
class Loop:
    """The loops to run, except for their seeds.

    Parameters
    ----------
    scenario, believed
        Systems of the plant, and of the estimator.
    seconds
        Duration of a run; the step at this time is the last.
    answer
        Function that returns a new controller; None for an open loop at the equilibrium input.
    filter
        Name of the filter; if empty, the filter of ``believed``.
    command
        Function that returns the input (m,) of an open loop at a time in seconds.
    arrives
        Function that returns whether readings taken at a time in seconds reach the estimator.
    faults
        Faults of the plant.
    replaced
        Function that puts another filter in the place of one, such as the exported C.
    """

    scenario: Scenario
    believed: Scenario
    seconds: float
    answer: Callable[[], Controller] | None = None
    filter: str = ''
    command: Callable[[float], Array] | None = None
    arrives: Callable[[float], bool] | None = None
    faults: PlantFaults | None = None
    replaced: Callable[[Estimation], Estimation] | None = None

    @property
    def estimation(self) -> Estimation:
        """The estimation of each loop, for readings in order."""
        in_order = Policy(max_gap=0.0)
        setup = estimation(self.believed, in_order, filter=self.filter, biases=False)
        return setup if self.replaced is None else self.replaced(setup)

    @property
    def steps(self) -> int:
        """Number of steps, the first and the last included."""
        return round(self.seconds * self.scenario.rate) + 1

    @property
    def in_order(self) -> bool:
        """Whether readings reach the estimator at the step at which they are taken, or never."""
        return self.faults is None or not self.faults.late


@dataclass(frozen=True)
class Starts:
    """Starts of runs that do not start as the scenario does.

    Parameters
    ----------
    state
        State of each plant (runs, n).
    belief
        Belief of the estimators: a mean (n,) or (runs, n), a covariance (n, n) or (runs, n, n).
    """

    state: Array
    belief: Gaussian

    def part(self, runs: slice) -> Starts:
        """Return the starts of some of the runs."""
        x, P = self.belief
        x, P = x if x.ndim == 1 else x[runs], P if P.ndim == 2 else P[runs]
        return Starts(self.state[runs], unchecked((x, P)))


class Observer(Protocol):
    """Observer of the loops while they run."""

    def reading(self, name: str, y: Array, correction: Correction) -> None:
        """Take the readings (runs, k) of a sensor, at this step."""
        ...

    def step(self, estimator: BatchEstimator, truth: Array, u: Array) -> None:
        """Take the truths (runs, n), the beliefs and the inputs (runs, m) of a step."""
        ...


def run_batch(
    loop: Loop,
    seeds: Sequence[int],
    observer: Observer,
    starts: Starts | None = None,
    schedule: GainSchedule | None = None,
) -> Any:
    """Run the loops with these ``seeds``, and return `Controller.limited`.

    Raises
    ------
    ValueError
        If the filter does not support the model, or has no batched form, or readings are late.
    """
    if not loop.in_order:
        raise ValueError('readings that are late have no batched form')
    scenario, believed = loop.scenario, loop.believed
    x = scenario.initial_state if starts is None else starts.state
    plant = BatchPlant(
        scenario.model, scenario.timed, scenario.rate, x, seeds, loop.steps, loop.faults
    )
    u0 = believed.model.equilibrium.input
    estimator = _estimator(loop, len(seeds), starts, schedule)
    answer = loop.answer and loop.answer()
    u: Array = u0
    with np.errstate(all='ignore'):
        for _ in range(loop.steps):
            time = plant.time
            estimator.advance(time)
            arrive = loop.arrives is None or loop.arrives(time * 1e-9)
            for name, y in plant.readings().items():
                if arrive:
                    observer.reading(name, y, estimator.add_reading(name, y))
            if answer is not None:
                u = answer(time, estimator.belief.mean)
            elif loop.command is not None:
                u = loop.command(time * 1e-9)
            observer.step(estimator, plant.state, u)
            estimator.set_input(u)
            plant.step(u)
    return 0 if answer is None else answer.limited


def _estimator(
    loop: Loop, runs: int, starts: Starts | None, schedule: GainSchedule | None
) -> BatchEstimator:
    built = loop.estimation
    return BatchEstimator(
        built.filter,
        built.sensors,
        built.initial if starts is None else starts.belief,
        loop.believed.model.equilibrium.input,
        (runs,),
        built.policy,
        schedule,
    )
