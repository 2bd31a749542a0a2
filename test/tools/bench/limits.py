# SPDX-License-Identifier: Apache-2.0
"""Predictive control where limits act: a step, the loop, and a published problem."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

import kalman_ros as kr
from kalman_ros.control.feedback import Regulator
from kalman_ros.control.limiter import limits_of
from kalman_ros.core import Array
from kalman_ros.harness import Run
from kalman_ros.scenario import build
from kalman_ros.scenario.regulator import feedback

from .benchmark import Benchmark

_FORCE, _RUNS, _STEPS = 10.0, 10, 60
#: Steps of the masses, and the time of one by its authors' program in C, in 2010.
_MASS_STEPS, _PUBLISHED = 1000, 5e-3
_RATE, _SECONDS = 200.0, 10.0
_SYSTEM: dict[str, Any] = {
    'model': 'cart_pole', 'law': 'mpc', 'horizon': 0.2, 'state_limit.x': [-1.0, 1.0],
    'state_limit.theta': [-0.4, 0.4],
}  # fmt: skip


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield steps of a cart-pole with a weak motor and of six masses, and the loop at 200 Hz."""
    yield [
        Benchmark(
            'mpc step where limits act, cart-pole, N = 20 / LQR step',
            30.0,
            lambda: float(np.median(_times(predicts=True))),
            lambda: float(np.median(_times(predicts=False))),
        ),
        Benchmark(
            '99 % of these steps / 1 ms, processor time',
            1.0,
            lambda: float(np.percentile(_times(predicts=True), 99.0)),
            lambda: 1e-3,
        ),
        Benchmark(
            'mpc step of the oscillating masses of Wang and Boyd, 99 % / 5 ms, processor time',
            1.0,
            lambda: float(np.percentile(_times_of_masses(), 99.0)),
            lambda: _PUBLISHED,
        ),
        Benchmark(
            'time of the steps that a plant at 200 Hz misses, mpc from a limit / 1 %',
            1.0,
            _missed,
            lambda: 0.01 * _SECONDS,
        ),
    ]


def _times_of_masses() -> Array:
    """Return the processor times of steps in which a limit acts, of masses between two walls.

    The problem is Example 1 of Y. Wang and S. Boyd, Fast Model Predictive Control Using Online
    Optimization, IEEE Trans. Control Syst. Technol. 18 (2), 2010: 12 states, 3 inputs of at most
    0.5, positions within 4, 30 steps of 0.5 s, random forces up to 0.5.
    """
    n, dt = 6, 0.5
    springs = np.eye(n, k=1) + np.eye(n, k=-1) - 2.0 * np.eye(n)
    pulls = np.zeros((n, 3))
    pulls[[0, 2, 3], [0, 1, 2]], pulls[[1, 4, 5], [0, 1, 2]] = 1.0, -1.0
    A = np.block([[np.zeros((n, n)), np.eye(n)], [springs, np.zeros((n, n))]])
    B = np.vstack((np.zeros((n, 3)), pulls))
    model = kr.continuous_model(A, B, np.eye(2 * n))
    limits = {f'x{place}': [-4.0, 4.0] for place in range(n)}
    control = kr.mpc(
        A, B, np.eye(2 * n), np.eye(3), dt=dt,
        input_limit=0.5, state_limit=limits, horizon=15.0, moves=30,
    )  # fmt: skip
    rng, x, times = np.random.default_rng(0), np.zeros(2 * n), []
    for _ in range(_MASS_STEPS):
        start = time.thread_time()
        u = control.step(x)
        if np.abs(u).max() > 0.4999:
            times.append(time.thread_time() - start)
        x = model.step(x, u, dt) + np.append(np.zeros(n), rng.uniform(-0.5, 0.5, n))
    return np.array(times)


def _missed() -> float:
    """Return the time in seconds of the steps that the plant of a loop in real time misses."""
    start = [0.8, 0.0, 0.0, 0.0]
    values = {
        **_SYSTEM, 'rate': _RATE, 'joint_states.rate': _RATE,
        'initial_state': start, 'initial_estimate': start,
    }  # fmt: skip
    with Run(values, lockstep=False, only={'controller': {'input_limit': [_FORCE]}}) as run:
        run.advance(_SECONDS)
        run.complete()
        return float(run.reported('plant', 'missed steps')) / _RATE


def _times(*, predicts: bool) -> Array:
    """Return the processor times of the steps in which a limit acts, or of all by the gain."""
    scenario = build(_SYSTEM)
    model, dt = scenario.model, 1.0 / scenario.rate
    law = feedback(scenario)
    if not predicts:
        law = replace(law, prediction=None)
    rng, times = np.random.default_rng(0), []
    for _ in range(_RUNS):
        bounds = limits_of(model.input.size, {'input_limit': _FORCE})
        regulator = Regulator(model.state, law, model.equilibrium, limits=bounds)
        x, acted = np.array([rng.uniform(-0.8, 0.8), 0.0, 0.0, 0.0]), _count(regulator)
        for _ in range(_STEPS):
            start = time.thread_time()
            wanted = regulator.propose(x, dt)
            spent = time.thread_time() - start
            u = np.clip(wanted, -_FORCE, _FORCE)
            regulator.applied(x, wanted, u, dt)
            if not predicts or acted() > 0:
                times.append(spent)
            x = model.step(x, u, dt)
    return np.array(times)


def _count(regulator: Regulator) -> Callable[[], int]:
    """Return a function of how often a limit acted since its last call."""
    before = 0

    def acted() -> int:
        nonlocal before
        now = 0 if regulator.predictor is None else regulator.predictor.limited
        since, before = now - before, now
        return since

    return acted
