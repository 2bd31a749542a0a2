# SPDX-License-Identifier: Apache-2.0
"""One prediction and one update, ours against filterpy's own classes.

First on one linear system for both; then ours of robots with 15 states and rotations, as nodes
compute them, against an extended filter of filterpy with 4 states and formulas that cost nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from filterpy.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from kalman_ros.core import Array, Gaussian, LinearSystem, Space, TimedSensor
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.plan import Plan
from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.sensors.states import States

from .benchmark import Benchmark, Timing
from .linear import parameters

#: Steps per measurement.
_STEPS = 300
_DT = 0.01
_ROBOTS = ('robot_3d', 'inertial')
#: Filter, states, readings, and the acceptable share of filterpy's time.
_CASES = (('kf', 4, 2, 0.5), ('ekf', 4, 2, 0.5), ('ukf', 4, 2, 0.2), ('ukf', 15, 6, 0.125))


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield one benchmark per filter and size."""
    robots = [row for how in ('compiled', 'c') for name in _ROBOTS for row in _robot(name, how)]
    yield [*(_benchmark(*case) for case in _CASES), _exported('ukf', 15, 6, 0.08), *robots]


def _benchmark(kind: str, n: int, k: int, goal: float) -> Benchmark:
    system, sensor, y = _system(n, k)
    name = f'{kind} step, {n} states, {k} readings / filterpy'
    return Benchmark(name, goal, _ours(kind, system, sensor, y), _peer(kind, system, sensor, y))


def _exported(kind: str, n: int, k: int, goal: float) -> Benchmark:
    """Return the benchmark of the same filter as exported C, which a node calls."""
    found = settings({**parameters(n, k, kind, 1.0 / _DT), 'arithmetic': 'c'}).fusion()
    assert found.arithmetic == 'c', found.arithmetic
    (sensor,) = found.sensors.values()
    filter: Any = found.filter
    _, rest = filter.model.equilibrium
    ours = _stepped(filter, rest, sensor, np.ones(k))
    name = f'{kind} step in C, {n} states, {k} readings / filterpy'
    return Benchmark(name, goal, ours, _peer(kind, *_system(n, k)))


def _system(n: int, k: int) -> tuple[LinearSystem, States, Array]:
    """Return a linear system, a sensor of some of its states, and a reading."""
    rng = np.random.default_rng(0)
    space = Space(tuple(f'x{index}' for index in range(n)), ('',) * n)
    A = 0.3 * rng.normal(size=(n, n)) - np.eye(n)
    system = LinearSystem(A, np.ones((n, 1)), 0.1 * np.eye(n), space, Space(('u',), ('',)))
    return system, States(space, [0.5] * k, space.names[:k]), np.ones(k)


def _robot(name: str, how: str) -> Iterator[Benchmark]:
    """Yield a prediction of a robot, and a correction by each of its sensors."""
    values = {**from_file(shipped.file(name), 'estimator'), 'filter': 'ekf', 'arithmetic': how}
    found, peer = settings(values).fusion(), of_filterpy()
    assert found.arithmetic in ('C', 'c'), found.arithmetic
    filter: Any = found.filter
    rest, state = filter.model.equilibrium, filter.model.state
    belief = Gaussian(rest.state + 0.1, 0.01 * np.eye(state.size))
    what = f'{name}, ekf{" in C" if how == "c" else ""}, {state.size} states'
    yield Benchmark(
        f'a prediction of {what} / an EKF step of filterpy with 4 states',
        1.0,
        _timed(lambda: filter.predict(belief, rest.input, _DT)),
        peer,
    )
    for each in found.sensors.values():
        y = each.measure(belief.mean)
        yield Benchmark(
            f'a correction of {what}, by {each.name} / the same of filterpy',
            1.0,
            _timed(lambda y=y, each=each: filter.correct(belief, y, each)),  # type: ignore[misc]
            peer,
        )


def second() -> float:
    """Return how long a second of the goals is here, by the EKF of filterpy with 4 states.

    A step of it took 23 us where goals in seconds were set.
    """
    return of_filterpy()() / 23e-6


def of_filterpy() -> Timing:
    """Return the timing of a step of filterpy's EKF with 4 states."""
    kind, n, k, _ = _CASES[1]
    return _peer(kind, *_system(n, k))


def _timed(step: Callable[[], None]) -> Timing:
    def measure() -> float:
        start = time.perf_counter()
        for _ in range(_STEPS):
            step()
        return (time.perf_counter() - start) / _STEPS

    return measure


def _ours(kind: str, system: LinearSystem, sensor: States, y: Array) -> Timing:
    plan = Plan(system, {'y': TimedSensor(sensor, 1.0 / _DT)}, 1.0 / _DT)
    return _stepped(build_filter(kind, plan), np.zeros(1), sensor, y)


def _stepped(filter: Any, u: Array, sensor: Any, y: Array) -> Timing:
    """Return the timing of a prediction and a correction, each from the last one."""
    n = filter.model.state.size
    belief = Gaussian(np.zeros(n), np.eye(n))

    def step() -> None:
        nonlocal belief
        belief = filter.correct(filter.predict(belief, u, _DT), y, sensor).posterior

    return _timed(step)


def _peer(kind: str, system: LinearSystem, sensor: States, y: Array) -> Timing:
    n, k = system.state.size, sensor.output.size
    sampled, H = system.sampled(_DT), sensor.jacobian(np.zeros(n))
    peer: Any
    if kind == 'ukf':
        points = MerweScaledSigmaPoints(n, 1.0, 0.0, 1.0)
        peer = UnscentedKalmanFilter(
            n, k, _DT, hx=lambda x: H @ x, fx=lambda x, dt: sampled.F @ x, points=points
        )
    else:
        peer = (KalmanFilter if kind == 'kf' else ExtendedKalmanFilter)(n, k)
        peer.F = sampled.F
        peer.H = H
    peer.x, peer.P = np.zeros(n), np.eye(n)
    peer.Q, peer.R = sampled.Q, sensor.covariance
    update = (y, lambda x: H, lambda x: H @ x) if kind == 'ekf' else (y,)

    def step() -> None:
        peer.predict()
        peer.update(*update)

    return _timed(step)
