# SPDX-License-Identifier: Apache-2.0
"""The samples of a loop as frames for a page: what is new since the last one, in JSON."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import exp, isfinite
from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, is_finite
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.scenario import Scenario

#: The most rows of one stream in a frame.
_MOST = 12
#: Seconds over which the recent cost is averaged.
_RECENT = 10.0


class Streams:
    """Turns the topics of a loop into frames.

    Times are in seconds since the first truth, values are rounded to five digits, and what is
    not finite is null.

    Parameters
    ----------
    scenario
        Of the plant.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._state = scenario.state
        self._last: int | None = None
        self._origin: int | None = None
        self._beliefs: deque[Sample] = deque()
        self._covariances: deque[Array] = deque()
        self._input: Array = scenario.model.equilibrium.input
        #: The newest belief and truth.
        self.estimate: tuple[Array, Array] | None = None
        self.truth: Array | None = None
        self.restart_cost()

    def restart_cost(self) -> None:
        """Start the averages of the cost again."""
        self._sum, self._count, self._recent = 0.0, 0, 0.0

    @property
    def elapsed(self) -> float:
        """Seconds from the first truth to the last one; -1 before the first."""
        if self._origin is None or self._last is None:
            return -1.0
        return (self._last - self._origin) * 1e-9

    @property
    def input(self) -> Array:
        """The last input (m,)."""
        return self._input

    def frame(
        self,
        samples: Mapping[str, Sequence[Sample]],
        believed: Scenario,
        weight: Array | None,
        fixed: Mapping[str, list[float]],
    ) -> dict[str, Any] | None:
        """Return what is new; None if nothing is.

        Parameters
        ----------
        samples
            New samples by topic.
        believed
            The estimator's scenario, for its gains.
        weight
            Of the cost of a sample (n + m, n + m); None without a cost.
        fixed
            The gain of each sensor, row by row, of a filter with fixed ones.
        """
        truths = samples['ground_truth']
        if self._origin is None:
            stamps = [found.time for found in truths if found.time is not None]
            if not stamps:
                return None
            self._origin = stamps[0]
        found: dict[str, Any] = {}
        inputs = samples.get(self._scenario.input.topic, ()) if self._scenario.input.fields else ()
        if truths:
            self.truth, self._last = truths[-1].values, truths[-1].time
            found['truth'] = self._rows(truths)
        rows = self._believed(samples)
        if rows:
            found['estimate'] = rows
            assert self.estimate is not None
            found['P'] = _numbers(self.estimate[1].ravel())
        if inputs:
            m = len(self._scenario.input.fields)
            self._input = inputs[-1].values[:m]
            found['input'] = self._rows(inputs)
        readings, innovations = self._readings(samples), self._innovations(samples)
        if readings:
            found['readings'] = readings
        if innovations:
            found['innovations'] = innovations
            found['gain'] = self._gains(believed, fixed)
        if weight is not None and truths:
            found['cost'] = self._cost(truths, weight)
        return found or None

    def prior(self, believed: Scenario) -> dict[str, Any]:
        """Return the newest belief, predicted by one step: x' = f(x, u), P' = F P F' + Q."""
        if self.estimate is None:
            return {}
        x, P = self.estimate
        step = believed.model.linearized_step(x, self._input, 1.0 / believed.rate)
        predicted = step.F @ P @ step.F.T + step.Q
        std = np.sqrt(np.maximum(predicted.diagonal(), 0.0))
        return {'x': _numbers(step.state), 'std': _numbers(std), 'P': _numbers(predicted.ravel())}

    def carried(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of nodes that continue from here."""
        found: dict[str, dict[str, Any]] = {}
        if self.truth is not None and np.isfinite(self.truth).all():
            found['plant'] = {'initial_state': self.truth.tolist()}
        if self.estimate is not None and all(map(is_finite, self.estimate)):
            x, P = self.estimate
            std = np.sqrt(np.maximum(P.diagonal(), 0.0)).tolist()
            found['estimator'] = {'initial_estimate': x.tolist(), 'initial_std': std}
        return found

    def _believed(self, samples: Mapping[str, Sequence[Sample]]) -> list[Any]:
        """Return estimates with their deviations: the k-th covariance is of the k-th estimate."""
        n = self._scenario.model.state.size
        self._beliefs.extend(samples[self._state.topic])
        whole = covariance_signal(self._state).topic
        self._covariances.extend(found.values.reshape(n, n) for found in samples[whole])
        rows = []
        for _ in range(min(len(self._beliefs), len(self._covariances))):
            belief, P = self._beliefs.popleft(), self._covariances.popleft()
            self.estimate = belief.values, P
            std = np.sqrt(np.maximum(P.diagonal(), 0.0))
            row = np.concatenate((belief.values, std, (np.trace(P),)))
            rows.append([self._time(belief), *_numbers(row)])
        return _thinned(rows)

    def _readings(self, samples: Mapping[str, Sequence[Sample]]) -> dict[str, Any]:
        sources = self._scenario.sensors.items()
        found = {name: self._rows(samples[source.signal.topic]) for name, source in sources}
        return {name: rows for name, rows in found.items() if rows}

    def _innovations(self, samples: Mapping[str, Sequence[Sample]]) -> dict[str, Any]:
        found = {}
        for name, source in self._scenario.sensors.items():
            topic = innovation_signal(self._state, name, source.sensor.output).topic
            if samples[topic]:
                found[name] = self._rows(samples[topic])
        return found

    def _gains(self, believed: Scenario, fixed: Mapping[str, list[float]]) -> dict[str, Any]:
        """Return the gain K of each sensor, row by row: fixed, or P C' R^-1 now."""
        if fixed:
            return dict(fixed)
        found = {}
        if self.estimate is not None:
            x, P = self.estimate
            for name, source in believed.enabled.items():
                C, R = source.sensor.jacobian(x), source.sensor.covariance
                try:
                    found[name] = _numbers(np.linalg.solve(R, C @ P).T.ravel())
                except np.linalg.LinAlgError:
                    continue
        return found

    def _cost(self, truths: Sequence[Sample], weight: Array) -> list[Any]:
        """Return the cost a second: the mean since the start, and the recent one."""
        model, rate = self._scenario.model, self._scenario.rate
        rest = model.equilibrium
        u = self._input - rest.input
        for found in truths:
            z = np.concatenate((model.state.subtract(found.values, rest.state), u))
            cost = float(z @ weight @ z) * rate
            if isfinite(cost):
                self._sum, self._count = self._sum + cost, self._count + 1
                keep = exp(-1.0 / (rate * min(_RECENT, self._count / rate)))
                self._recent = keep * self._recent + (1.0 - keep) * cost
        return _numbers((self._sum / max(self._count, 1), self._recent))

    def _rows(self, samples: Sequence[Sample]) -> list[Any]:
        return _thinned([[self._time(found), *_numbers(found.values)] for found in samples])

    def _time(self, found: Sample) -> float | None:
        if found.time is None or self._origin is None:
            return None
        return round((found.time - self._origin) * 1e-9, 4)


def _thinned(rows: list[Any]) -> list[Any]:
    """Return at most a few rows, evenly spaced, the last one included."""
    if len(rows) <= _MOST:
        return rows
    step = -(-len(rows) // _MOST)
    return rows[::-1][::step][::-1]


def _numbers(values: Any) -> list[float | None]:
    """Return numbers for JSON."""
    plain = (float(value) for value in values)
    return [float(f'{value:.5g}') if isfinite(value) else None for value in plain]
