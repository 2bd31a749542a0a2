# SPDX-License-Identifier: Apache-2.0
"""Frames of a live page, which contain the new samples of a loop, for JSON."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import exp, isfinite
from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Gaussian, is_finite
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.scenario import Scenario

from .sensor_watch import SensorWatch

#: Largest number of rows of one stream in the usual period of a frame.
_MOST = 12
#: Largest number of steps that are predicted.
_MOST_STEPS = 1000
#: Time constant in seconds of the average of the recent cost.
_RECENT = 10.0


class Streams:
    """A converter from the topics of a loop to frames.

    Times are in seconds since the first truth. Values are rounded to five digits; values that are
    not finite are null.

    Parameters
    ----------
    scenario
        Scenario of the plant.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._state = scenario.state
        self._last: int | None = None
        self._origin: int | None = None
        self._beliefs: deque[Sample] = deque()
        self._covariances: deque[Array] = deque()
        self._most = _MOST
        #: Time of the newest reading of each sensor.
        self._read: dict[str, float] = {}
        self._input: Array = scenario.model.equilibrium.input
        #: Newest belief and truth.
        self.estimate: tuple[Array, Array] | None = None
        #: Samples of the newest frame, of which some may be newer than its belief.
        self.samples: Mapping[str, Sequence[Sample]] = {}
        #: Time of the newest belief in nanoseconds.
        self.estimate_time: int | None = None
        self.truth: Array | None = None
        #: Samples up to this time in nanoseconds are from before a reset.
        self._reset_time: int | None = None
        #: Readings of the sensors beside the truth.
        self.watch = SensorWatch()
        self._restart_averages()

    def restart(self, samples: Mapping[str, Sequence[Sample]]) -> None:
        """Pass over these samples and earlier ones, from before a reset; restart all averages."""
        self._estimates(samples)
        truths = samples['ground_truth']
        self._reset_time = truths[-1].time if truths else self._last
        self._restart_averages()

    def _restart_averages(self) -> None:
        self._sum, self._count, self._recent = 0.0, 0, 0.0
        self.watch.restart()

    @property
    def elapsed(self) -> float:
        """Time in seconds from the first truth to the last; -1 before the first."""
        if self._origin is None or self._last is None:
            return -1.0
        return (self._last - self._origin) * 1e-9

    @property
    def input(self) -> Array:
        """Last input (m,)."""
        return self._input

    def frame(
        self,
        samples: Mapping[str, Sequence[Sample]],
        believed: Scenario,
        weight: Array | None,
        fixed: Mapping[str, list[float]],
        periods: int = 1,
    ) -> dict[str, Any] | None:
        """Return a frame of the new samples; None without new samples.

        Parameters
        ----------
        samples
            New samples by topic.
        believed
            Scenario of the estimator, for its gains.
        weight
            Weight of the cost of a sample (n + m, n + m); None without a cost.
        fixed
            Gain of each sensor, row by row, for a filter with fixed gains.
        periods
            Number of usual periods since the last frame; a late frame has as many more rows.
        """
        self.samples, self._most = samples, _MOST * max(periods, 1)
        samples = self._since_reset(samples)
        self.watch.add(samples, believed)
        truths = samples['ground_truth']
        if self._origin is None:
            stamps = [truth.time for truth in truths if truth.time is not None]
            if not stamps:
                return None
            self._origin = stamps[0]
        frame: dict[str, Any] = {}
        inputs = samples.get(self._scenario.input.topic, ()) if self._scenario.input.fields else ()
        if truths:
            self.truth, self._last = truths[-1].values, truths[-1].time
            frame['truth'] = self._rows(truths)
        rows = self._estimates(samples)
        if rows:
            frame['estimate'] = rows
            assert self.estimate is not None
            frame['P'] = _numbers(self.estimate[1].ravel())
        if inputs:
            m = len(self._scenario.input.fields)
            self._input = inputs[-1].values[:m]
            frame['input'] = self._rows(inputs)
        readings, innovations = self._readings(samples), self._innovations(samples)
        if readings:
            frame['readings'] = readings
        if innovations:
            frame['innovations'] = innovations
            frame['gain'] = self._gains(believed, fixed)
        if weight is not None and truths:
            frame['cost'] = self._cost(truths, weight)
        return frame or None

    def prior(self, believed: Scenario, steps: int = 1) -> dict[str, Any]:
        """Predict the newest belief by ``steps``, each x' = f(x, u), P' = F P F' + Q."""
        if self.estimate is None:
            return {}
        x, P = self.estimate
        for _ in range(steps):
            step = believed.model.linearized_step(x, self._input, 1.0 / believed.rate)
            x, P = step.state, step.F @ P @ step.F.T + step.Q
        std = np.sqrt(np.maximum(P.diagonal(), 0.0))
        return {'x': _numbers(x), 'std': _numbers(std), 'P': _numbers(P.ravel())}

    def steps_to_reading(self, sensor: str, sensor_rate: float) -> int:
        """Return the number of steps to the next expected reading of a sensor, at least 1."""
        if sensor not in self._read:
            return 1
        wait = self._read[sensor] + 1.0 / sensor_rate - self.elapsed
        return min(max(round(wait * self._scenario.rate), 1), _MOST_STEPS)

    def carried(self) -> dict[str, dict[str, Any]]:
        """Return the parameters with which restarted nodes continue from the current state."""
        parameters: dict[str, dict[str, Any]] = {}
        if self.truth is not None and np.isfinite(self.truth).all():
            parameters['plant'] = {'initial_state': self.truth.tolist()}
        if self.estimate is not None and all(map(is_finite, self.estimate)):
            x, P = self.estimate
            std = np.sqrt(np.maximum(P.diagonal(), 0.0)).tolist()
            parameters['estimator'] = {'initial_estimate': x.tolist(), 'initial_std': std}
        return parameters

    def _estimates(self, samples: Mapping[str, Sequence[Sample]]) -> list[Any]:
        """Return estimates with deviations; the k-th covariance belongs to the k-th estimate."""
        n = self._scenario.model.state.size
        self._beliefs.extend(samples[self._state.topic])
        topic = covariance_signal(self._state).topic
        self._covariances.extend(sample.values.reshape(n, n) for sample in samples[topic])
        rows = []
        for _ in range(min(len(self._beliefs), len(self._covariances))):
            belief, P = self._beliefs.popleft(), self._covariances.popleft()
            if self._is_old(belief):
                continue
            self.estimate, self.estimate_time = (belief.values, P), belief.time
            rows.append([self._time(belief), *_belief_row(belief.values, P)])
        return _thin(rows, self._most)

    def _is_old(self, sample: Sample) -> bool:
        reset = self._reset_time
        return reset is not None and sample.time is not None and sample.time <= reset

    def _since_reset(
        self, samples: Mapping[str, Sequence[Sample]]
    ) -> Mapping[str, Sequence[Sample]]:
        """Return the samples since the last reset, but all beliefs: their order pairs them."""
        if self._reset_time is None:
            return samples
        paired = self._state.topic, covariance_signal(self._state).topic
        return {
            topic: all if topic in paired else [s for s in all if not self._is_old(s)]
            for topic, all in samples.items()
        }

    def beliefs(self, beliefs: Sequence[tuple[int, Gaussian]]) -> dict[str, Any]:
        """Return beliefs of a `Ghost` for JSON, in the rows of estimates; empty without any."""
        if not beliefs or self._origin is None:
            return {}
        rows = [
            [self._seconds(time), *_belief_row(belief.mean, belief.covariance)]
            for time, belief in beliefs
        ]
        P = _numbers(beliefs[-1][1].covariance.ravel())
        return {'ghost': _thin(rows, self._most), 'ghost_P': P}

    def _readings(self, samples: Mapping[str, Sequence[Sample]]) -> dict[str, Any]:
        sources = self._scenario.sensors.items()
        rows_by_sensor = {
            name: self._rows(samples[source.signal.topic]) for name, source in sources
        }
        self._read.update(
            {
                name: rows[-1][0]
                for name, rows in rows_by_sensor.items()
                if rows and rows[-1][0] is not None
            }
        )
        return {name: rows for name, rows in rows_by_sensor.items() if rows}

    def _innovations(self, samples: Mapping[str, Sequence[Sample]]) -> dict[str, Any]:
        rows_by_sensor = {}
        for name, source in self._scenario.sensors.items():
            topic = innovation_signal(self._state, name, source.sensor.output).topic
            if samples[topic]:
                rows_by_sensor[name] = self._rows(samples[topic])
        return rows_by_sensor

    def _gains(self, believed: Scenario, fixed: Mapping[str, list[float]]) -> dict[str, Any]:
        """Return the gain K of each sensor, row by row: fixed, or the current P C' R^-1."""
        if fixed:
            return dict(fixed)
        gains = {}
        if self.estimate is not None:
            x, P = self.estimate
            for name, source in believed.enabled.items():
                C, R = source.sensor.jacobian(x), source.sensor.covariance
                try:
                    gains[name] = _numbers(np.linalg.solve(R, C @ P).T.ravel())
                except np.linalg.LinAlgError:
                    continue
        return gains

    def _cost(self, truths: Sequence[Sample], weight: Array) -> list[Any]:
        """Return the mean cost per second since the start, and the recent cost per second."""
        model, rate = self._scenario.model, self._scenario.rate
        rest = model.equilibrium
        u = self._input - rest.input
        for truth in truths:
            z = np.concatenate((model.state.subtract(truth.values, rest.state), u))
            cost = float(z @ weight @ z) * rate
            if isfinite(cost):
                self._sum, self._count = self._sum + cost, self._count + 1
                decay = exp(-1.0 / (rate * min(_RECENT, self._count / rate)))
                self._recent = decay * self._recent + (1.0 - decay) * cost
        return _numbers((self._sum / max(self._count, 1), self._recent))

    def _rows(self, samples: Sequence[Sample]) -> list[Any]:
        rows = [[self._time(sample), *_numbers(sample.values)] for sample in samples]
        return _thin(rows, self._most)

    def _time(self, sample: Sample) -> float | None:
        return None if sample.time is None else self._seconds(sample.time)

    def _seconds(self, time: int) -> float | None:
        return None if self._origin is None else round((time - self._origin) * 1e-9, 4)


def _belief_row(x: Array, P: Array) -> list[float | None]:
    """Return a mean, its standard deviations, and the trace of the covariance."""
    std = np.sqrt(np.maximum(P.diagonal(), 0.0))
    return _numbers(np.concatenate((x, std, (np.trace(P),))))


def _thin(rows: list[Any], most: int) -> list[Any]:
    """Return at most ``most`` evenly spaced rows, including the last row."""
    if len(rows) <= most:
        return rows
    step = -(-len(rows) // most)
    return rows[::-1][::step][::-1]


def _numbers(values: Any) -> list[float | None]:
    """Return numbers for JSON, rounded, and None for a number that is not finite."""
    numbers = (float(value) for value in values)
    return [float(f'{value:.5g}') if isfinite(value) else None for value in numbers]
