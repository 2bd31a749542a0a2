# SPDX-License-Identifier: Apache-2.0
"""`kr.filter` of a plain function, against a loop around filterpy's own class."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import ceil

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

import kalman_ros as kr
from kalman_ros.core import Array

from .benchmark import Benchmark, Timing

_READINGS, _LONGEST = 400, 0.05
_DENSITY, _VARIANCE = np.diag([0.0, 0.1]), 0.0025


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmark."""
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.02, 0.2, _READINGS))
    readings = np.sin(times) + np.sqrt(_VARIANCE) * rng.normal(size=_READINGS)
    model = kr.continuous_model(_pendulum, W=_DENSITY)

    def ours() -> object:
        return kr.filter(model, ([1, 0], _VARIANCE), times, readings, initial=([0.1, 0.0], 0.1))

    what = f'kr.filter of a pendulum, {_READINGS} uneven readings / filterpy'
    yield [Benchmark(what, 1.5, _timed(ours), _timed(lambda: _of_filterpy(times, readings)))]


def _pendulum(x: Array) -> Array:
    return np.array([x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1]])


def _of_filterpy(times: Array, readings: Array) -> list[tuple[Array, Array]]:
    """Return means and covariances, with a Jacobian by hand and Runge-Kutta of fourth order."""
    found = ExtendedKalmanFilter(2, 1)
    found.x, found.P, found.R = np.array([0.1, 0.0]), 0.1 * np.eye(2), np.array([[_VARIANCE]])
    before, rows = times[0], []
    for now, y in zip(times, readings):
        dt, before, x = now - before, now, found.x
        A = np.array([[0.0, 1.0], [-9.81 * np.cos(x[0]), -0.1]])
        F = np.eye(2) + A * dt + A @ A * (0.5 * dt * dt)
        found.x, found.P = _moved(x, dt), F @ found.P @ F.T + _DENSITY * dt
        found.update(np.array([y]), lambda x: np.array([[1.0, 0.0]]), lambda x: x[:1])
        rows.append((found.x.copy(), found.P.copy()))
    return rows


def _moved(x: Array, dt: float) -> Array:
    count = max(1, ceil(dt / _LONGEST))
    h = dt / count
    for _ in range(count):
        a = _pendulum(x)
        b = _pendulum(x + 0.5 * h * a)
        c = _pendulum(x + 0.5 * h * b)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + _pendulum(x + h * c))
    return x


def _timed(work: Callable[[], object]) -> Timing:
    """Return what measures the processor time of one pass in seconds."""

    def measure() -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    return measure
