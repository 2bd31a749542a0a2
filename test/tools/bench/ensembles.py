# SPDX-License-Identifier: Apache-2.0
"""Closed loops of many runs at once: against a loop of filterpy, and against their noise alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from kalman_ros import scenario
from kalman_ros.control.limiter import Limits
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.loop_law import Law
from kalman_ros.simulation.monte_carlo import Experiment, monte_carlo, spawned
from kalman_ros.simulation.noise import stream

from .benchmark import Benchmark
from .filters import second

_RUNS, _STEPS = 1000, 1000
#: A linear loop with 4 states and 2 readings at each step.
_LINEAR = {'velocity.enabled': False, 'position.rate': 100.0, 'rate': 100.0}
#: Runs that workers divide.
_SHARED = 400
#: Processor seconds for a million steps of the cart-pole.
_MILLION = 1.0


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks: processor time, of a run for those of the linear loop.

    That of workers is of elapsed time: it needs two processors that nothing else uses.
    """
    linear, seeds = _experiment(scenario.build(_LINEAR)), spawned(0, _RUNS)
    upright = _experiment(scenario.build({'model': 'cart_pole', 'filter': 'ekf'}))
    monte_carlo(linear, seeds[:2])  # imports
    what = f'LQG run of {_STEPS} steps, {_RUNS} at once'
    yield [
        Benchmark(f'{what} / filterpy', 1.0 / 200.0, lambda: _ours(linear, seeds), _filterpy),
        Benchmark(f'{what} / its noise', 2.0, lambda: _ours(linear, seeds), lambda: _noise(seeds)),
        Benchmark(
            'million steps of EKF and LQR, cart-pole / 43,500 EKF steps of filterpy', 1.5,
            lambda: _RUNS * _ours(upright, seeds), lambda: _MILLION * second(),
        ),
        Benchmark(
            f'{_SHARED} runs of the cart-pole, 2 workers / 1', 1.0 / 1.6,
            lambda: _elapsed(upright, seeds[:_SHARED], 2),
            lambda: _elapsed(upright, seeds[:_SHARED], 1),
        ),
    ]  # fmt: skip


def _experiment(built: Scenario) -> Experiment:
    law = Law(built, regulators.feedback(built), Limits.none(built.model.input.size), None)
    loop = Loop(built, built, (_STEPS - 1) / built.rate, law)
    return Experiment(loop, regulators.price(built).weight, 0)


def _ours(experiment: Experiment, seeds: tuple[int, ...]) -> float:
    """Return the processor time of a run."""
    start = time.process_time()
    monte_carlo(experiment, seeds)
    return (time.process_time() - start) / len(seeds)


def _elapsed(experiment: Experiment, seeds: tuple[int, ...], workers: int) -> float:
    """Return the time that the runs take, in chunks of one size."""
    start = time.perf_counter()
    monte_carlo(experiment, seeds, workers=workers, chunk=len(seeds) // 4)
    return time.perf_counter() - start


def _noise(seeds: tuple[int, ...]) -> float:
    """Return the processor time in which the numbers of a run are drawn."""
    start = time.process_time()
    for seed in seeds:
        stream(seed, 'process').standard_normal((_STEPS, 4))
        stream(seed, 'sensor position').standard_normal((_STEPS, 2))
    return (time.process_time() - start) / len(seeds)


def _filterpy() -> float:
    """Return the processor time of one run with filterpy's filter."""
    built = scenario.build(_LINEAR)
    step = built.model.transition(*built.model.equilibrium, 1.0 / built.rate)
    sensor = built.enabled['position'].sensor
    K = regulators.feedback(built).gain
    start = time.process_time()
    rng = np.random.default_rng(0)
    w = rng.multivariate_normal(np.zeros(4), step.Q, _STEPS)
    v = rng.multivariate_normal(np.zeros(2), sensor.covariance, _STEPS)
    peer: Any = KalmanFilter(4, 2, 2)
    peer.F, peer.B, peer.Q, peer.R = step.F, step.G, step.Q, sensor.covariance
    peer.H = sensor.jacobian(np.zeros(4))
    peer.x, peer.P = built.initial_belief.mean, built.initial_belief.covariance
    x, u = built.initial_state, np.zeros(2)
    for k in range(_STEPS):
        if k:
            peer.predict(u)
        peer.update(sensor.measure(x) + v[k])
        u = -K @ peer.x
        x = step.F @ x + step.G @ u + w[k]
    return time.process_time() - start
