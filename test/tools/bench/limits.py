# SPDX-License-Identifier: Apache-2.0
"""Predictive control where limits act, on a cart-pole with a weak motor: a step, and the loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros.control.feedback import Regulator
from kalman_ros.core import Array
from kalman_ros.harness import Run
from kalman_ros.scenario import build
from kalman_ros.scenario.regulator import feedback, limits

from .benchmark import Benchmark

_FORCE, _RUNS, _STEPS = 10.0, 10, 60
_RATE, _SECONDS = 200.0, 10.0
_SYSTEM: dict[str, Any] = {
    'model': 'cart_pole', 'law': 'mpc', 'horizon': 0.2, 'state_limit.x': [-1.0, 1.0],
    'state_limit.theta': [-0.4, 0.4],
}  # fmt: skip


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the step against that of the regulator, and its 99th percentile against 1 ms."""
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
            'time of the steps that a plant at 200 Hz misses, mpc from a limit / 1 %',
            1.0,
            _missed,
            lambda: 0.01 * _SECONDS,
        ),
    ]


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
        bounds = limits(scenario, _FORCE)
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
