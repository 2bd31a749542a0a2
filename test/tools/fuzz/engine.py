# SPDX-License-Identifier: Apache-2.0
"""Estimators under hostile input: random models, stamps, readings and covariances.

The output is checked after every item: a finite mean, a valid covariance, and every reading
counted exactly once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from kalman_ros import scenario
from kalman_ros.core import (
    Array,
    DesignError,
    Dynamics,
    Gaussian,
    LinearSystem,
    Model,
    Sensor,
    Space,
    TimedSensor,
)
from kalman_ros.estimators import FILTERS, build_filter, filter_class
from kalman_ros.estimators.filter import Filter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.sensors.linear import Linear

#: Shipped scenarios with rotations, with all their sensors, and how often they are tried, each.
_ROBOTS, _SHARE_OF_ROBOTS = ('robot_3d', 'inertial'), 0.1
#: Items per estimator.
_ITEMS = 200
_RATE = 50.0


def _weight(name: str) -> float:
    """Return how often a filter is tried: the design of a fixed gain and a mixture are slow."""
    kind = filter_class(name)
    return 1.0 if kind.fixed_gain else 2.0 if kind.mixture else 5.0


#: The frequency of each filter.
_SHARES = {name: _weight(name) / sum(map(_weight, FILTERS)) for name in FILTERS}
_HOSTILE = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, -1e300, 1e-300, 5e-324, 1e155)
_SECOND = 1_000_000_000


class BrokenPromiseError(AssertionError):
    """An estimator broke a promise; the message has the promise and the seed."""


class _Swing(Model):
    """A driven pendulum, whose angle wraps."""

    state = Space(('angle', 'rate'), ('rad', 'rad/s'), angles=('angle',))
    input = Space(('torque',), ('N m',))
    max_step = 0.1

    def __init__(self, rng: np.random.Generator) -> None:
        self._stiffness, self._density = rng.uniform(-20.0, 20.0), _scale(rng)

    def derivative(self, x: Array, u: Array) -> Array:
        swing = self._stiffness * np.sin(x[..., 0]) - 0.1 * x[..., 1] + u[..., 0]
        return np.stack((x[..., 1], swing), axis=-1)

    def noise_density(self, x: Array) -> Array:
        return np.diag([0.0, self._density])


class Episode:
    """One random estimator, and its items.

    Parameters
    ----------
    seed
        Of everything random.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._rng = rng = np.random.default_rng(seed)
        model, self._sensors = _system(rng)
        #: What the model is.
        self.model = type(model).__name__
        n, m = model.state.size, model.input.size
        gates = {name: rng.uniform(1.0, 20.0) for name in self._sensors if rng.random() < 0.5}
        policy = Policy(
            window=float(rng.choice([0.0, 0.1, 1.0])),
            gates=gates,
            recover_after=int(rng.choice([0, 1, 5])),
            restart_after=int(rng.choice([0, 3])),
            max_gap=float(rng.choice([0.0, 2.0, 60.0])),
            from_reading=bool(rng.random() < 0.3),
            from_rest=seed % 7 == 0,
        )
        initial = Gaussian(rng.normal(size=n), np.diag(10.0 ** rng.uniform(-6.0, 6.0, n)))
        timed = {name: TimedSensor(s, _RATE) for name, s in self._sensors.items()}
        self.filter, filter = _filter(rng, Plan(model, timed, _RATE))
        self._estimator = OnlineEstimator(filter, self._sensors, initial, np.zeros(m), policy)
        self._m = m
        self._sent: Counter[str] = Counter()
        self._time = _SECOND

    def run(self) -> Iterator[None]:
        """Yield the items, and check after each; BrokenPromiseError at the first failure."""
        for number in range(_ITEMS):
            try:
                self._give()
            except Exception as error:
                raise BrokenPromiseError(
                    self._where(number, f'{type(error).__name__}: {error}')
                ) from error
            trouble = self._trouble()
            if trouble:
                raise BrokenPromiseError(self._where(number, trouble))
            yield

    def _where(self, number: int, what: str) -> str:
        return f'{what} (seed {self.seed}, item {number}, {self.model}, filter {self.filter})'

    def _give(self) -> None:
        rng, estimator = self._rng, self._estimator
        time = self._stamp()
        if self._m and rng.random() < 0.2:
            estimator.add_input(time, _values(rng, self._m))
            return
        name = str(rng.choice(list(self._sensors)))
        k = self._sensors[name].output.size
        now = self._time if rng.random() < 0.2 else None
        estimator.add_reading(name, time, _values(rng, k), _covariance(rng, k), now)
        self._sent[name] += 1

    def _stamp(self) -> int:
        """Return a stamp that mostly increases, and sometimes is arbitrary."""
        rng, kind = self._rng, self._rng.random()
        if kind < 0.7:
            self._time += 20_000_000 * int(rng.integers(0, 4))
        elif kind < 0.9:
            return self._time - int(rng.integers(0, _SECOND))
        elif kind < 0.95:
            return self._time + int(rng.integers(0, 2 * _SECOND))
        elif kind < 0.96:
            return int(rng.integers(0, 2**62))
        else:
            self._time += int(rng.integers(0, 100 * _SECOND))
        return self._time

    def _trouble(self) -> str:
        """Return the broken promise, or ''."""
        estimator = self._estimator
        beliefs = [estimator.belief]
        if estimator.time is not None:
            beliefs.append(estimator.predicted(estimator.time + 10_000_000))
        for belief in beliefs:
            P = belief.covariance
            if not (np.isfinite(belief.mean).all() and np.isfinite(P).all()):
                return 'the belief is not finite'
            if not np.allclose(P, P.T, rtol=1e-9, atol=1e-12 * np.abs(P).max()):
                return 'the covariance is not symmetric'
            if np.linalg.eigvalsh(P)[0] < -1e-9 * np.abs(P).max():
                return 'the covariance is not positive semi-definite'
        counted = {name: sum(counts.values()) for name, counts in estimator.counts.items()}
        if any(counted[name] != self._sent[name] for name in counted):
            return f'readings sent {dict(self._sent)}, counted {counted}'
        return ''


def _system(rng: np.random.Generator) -> tuple[Dynamics, dict[str, Sensor]]:
    """Return a model and its sensors."""
    kind = rng.random()
    for number, name in enumerate(_ROBOTS, 1):
        if kind < number * _SHARE_OF_ROBOTS:
            built = scenario.build({'model': name}, with_law=False)
            return built.model, {n: source.sensor for n, source in built.enabled.items()}
    model = _Swing(rng) if rng.random() < 0.25 else _linear(rng)
    sensors = {f's{index}': _sensor(rng, model) for index in range(rng.integers(1, 4))}
    for name, sensor in sensors.items():
        sensor.name = name
    return model, sensors


def _scale(rng: np.random.Generator) -> float:
    return float(10.0 ** rng.uniform(-4.0, 4.0)) if rng.random() < 0.7 else 0.0


def _linear(rng: np.random.Generator) -> LinearSystem:
    n, m = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    A = 10.0 ** rng.uniform(-2.0, 1.5) * rng.normal(size=(n, n))
    root = rng.normal(size=(n, n))
    state = Space(tuple(f'x{index}' for index in range(n)), ('',) * n)
    input = Space(tuple(f'u{index}' for index in range(m)), ('',) * m)
    B, W = rng.normal(size=(n, m)), _scale(rng) * root @ root.T
    return LinearSystem(A, B, W, state, input)


def _sensor(rng: np.random.Generator, model: Model) -> Sensor:
    k = int(rng.integers(1, 4))
    noise = 10.0 ** rng.uniform(-4.0, 4.0, k)
    return Linear(model.state, noise.tolist(), rng.normal(size=k * model.state.size).tolist())


def _filter(rng: np.random.Generator, plan: Plan) -> tuple[str, Filter]:
    """Return a filter that supports the plan; the extended one supports any."""
    name = str(rng.choice(list(_SHARES), p=list(_SHARES.values())))
    try:
        return name, build_filter(name, plan)
    except (ValueError, DesignError):
        return 'ekf', build_filter('ekf', plan)


def _values(rng: np.random.Generator, size: int) -> Array:
    values = rng.normal(size=size) * 10.0 ** rng.uniform(-3.0, 3.0)
    if rng.random() < 0.1:
        values[rng.integers(size)] = rng.choice(_HOSTILE)
    return values if rng.random() < 0.97 else np.append(values, 0.0)


def _covariance(rng: np.random.Generator, size: int) -> Array | None:
    kind = rng.random()
    if kind < 0.6:
        return None
    root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-6.0, 6.0)
    P: Array = root @ root.T
    if kind > 0.8:
        P[rng.integers(size), rng.integers(size)] = rng.choice(_HOSTILE)
    return P if kind < 0.95 else np.eye(size + 1)
