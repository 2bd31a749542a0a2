# SPDX-License-Identifier: Apache-2.0
"""Readings of the sensors beside the truth, and which of them are not as the filter believes."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Sensor
from kalman_ros.scenario import Scenario, SensorSource

#: The recent past: seconds of the truth, or as many periods of a sensor if that is longer.
_SECONDS, _PERIODS = 2.0, 25
#: The least number of readings from which anything follows; and too little noise.
_LEAST, _LEAST_CALM = 8, 20
#: A sensor is silent after this many periods, and at least after these seconds.
_SILENT_PERIODS, _SILENT = 6, 0.6
#: A sensor loses readings if a smaller share than this arrives.
_ARRIVES = 0.7
#: A reading is far off beyond this many deviations; so is one of 500 million by chance.
_FAR = 6.0
#: Deviations by which a median is off, and the ratio of deviations, that are worth a word ...
_BIASED, _NOISIER = 0.5, 1.6
#: ... and how many deviations of the statistic itself are added.
_SURE = 5.0
#: The delay in seconds that is worth a word.
_LATE = 0.1
#: The median of the magnitude of a Gaussian variable with a deviation of one.
_MEDIAN = 0.6745


@dataclass
class _Window:
    """Recent readings of one sensor: times in ns, values (k,), and errors (k,)."""

    times: deque[int] = field(default_factory=deque)
    values: deque[Array] = field(default_factory=deque)
    errors: deque[Array] = field(default_factory=deque)
    #: By how many seconds the newest reading is late at least.
    late: float = 0.0

    def forget(self, before: int) -> None:
        """Remove the readings before a time."""
        while self.times and self.times[0] < before:
            for column in (self.times, self.values, self.errors):
                column.popleft()


class SensorWatch:
    """A comparison of recent readings with the truth that they measure.

    It says what a filter cannot know, since it has no truth: which sensor is not as it is
    believed to be, and how.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self, skip: int = 0) -> None:
        """Forget all readings; pass over the next ``skip`` frames, with readings from before."""
        self._skip = skip
        self._windows: dict[str, _Window] = {}
        self._truths: dict[int, Array] = {}
        self._begin: int | None = None
        self._now = 0

    def add(self, samples: Mapping[str, Sequence[Sample]], believed: Scenario) -> None:
        """Add the new samples of a loop, by topic."""
        if self._skip:
            self._skip -= 1
            return
        truths = [(s.time, s.values) for s in samples['ground_truth'] if s.time is not None]
        if truths:
            first, self._now = truths[0][0], truths[-1][0]
            if self._begin is None or self._now < self._begin:
                self.restart()
                self._begin, self._now = first, truths[-1][0]
            self._truths.update(truths)
        if self._begin is None:
            return
        length = _SECONDS
        for name, source in believed.enabled.items():
            length = max(length, _length(source))
            window = self._windows.setdefault(name, _Window())
            readings = [s for s in samples[source.signal.topic] if s.time in self._truths]
            if readings:
                x = np.array([self._truths[s.time] for s in readings if s.time is not None])
                self._extend(window, source.sensor, readings, x)
                if truths:
                    window.late = (first - window.times[-1]) * 1e-9
            window.forget(self._now - round(_length(source) * 1e9))
        oldest = self._now - round((length + 1.0) * 1e9)
        while self._truths and (time := next(iter(self._truths))) < oldest:
            del self._truths[time]

    @staticmethod
    def _extend(window: _Window, sensor: Sensor, readings: Sequence[Sample], x: Array) -> None:
        values = np.array([sample.values for sample in readings])
        if values.shape[1] != sensor.output.size:
            return
        errors = sensor.output.subtract(values, np.atleast_2d(sensor.measure(x)))
        window.times.extend(s.time for s in readings if s.time is not None)
        window.values.extend(values)
        window.errors.extend(errors)

    def troubles(self, believed: Scenario) -> dict[str, dict[str, Any]]:
        """Return for JSON what is wrong with each sensor; sensors as believed are left out."""
        troubles = {
            name: self._trouble(self._windows[name], source)
            for name, source in believed.enabled.items()
            if name in self._windows
        }
        return {name: trouble for name, trouble in troubles.items() if trouble}

    def _trouble(self, window: _Window, source: SensorSource) -> dict[str, Any]:
        assert self._begin is not None
        watched, period = (self._now - self._begin) * 1e-9, 1.0 / source.timed.rate
        since = (self._now - window.times[-1]) * 1e-9 if window.times else watched
        if since > max(_SILENT, _SILENT_PERIODS * period):
            return {'kind': 'silent', 'seconds': round(since, 1)}
        count = len(window.times)
        if watched > _length(source):
            share = count * period / _length(source)
            if count and share < _ARRIVES:
                return {'kind': 'lost', 'share': round(1.0 - share, 2)}
        if count < _LEAST:
            return {}
        error, std = np.array(window.errors), np.sqrt(source.sensor.covariance.diagonal())
        error = error[np.isfinite(error).all(axis=1)]
        if len(error) < _LEAST or not (std > 0.0).all():
            return {}
        if (np.array(window.values) == window.values[0]).all():
            return {'kind': 'frozen'}
        trouble = _judge(error, std)
        for off in trouble.get('off', []):
            k, output = off.pop('coordinate'), source.sensor.output
            off.update(name=output.names[k], unit=output.units[k])
        if not trouble and window.late > _LATE:
            return {'kind': 'late', 'seconds': round(window.late, 2)}
        return trouble


def _length(source: SensorSource) -> float:
    """Return the seconds over which a sensor is watched."""
    return max(_SECONDS, _PERIODS / source.timed.rate)


def _judge(error: Array, std: Array) -> dict[str, Any]:
    """Return what errors (N, k) are beside the deviations (k,) that are believed.

    Median and median absolute deviation are those of most readings, whatever a few of them are.
    In deviations, a median of N Gaussian values scatters by 1.25 / sqrt(N), and their root mean
    square by 0.71 / sqrt(N) (P. J. Huber, Robust Statistics, 1981, sections 1 and 5).
    """
    chance = _SURE / np.sqrt(len(error))
    middle = np.median(error, axis=0)
    spread = np.median(np.abs(error - middle), axis=0) / _MEDIAN / std
    far = np.abs(error - middle) > _FAR * std * np.maximum(spread, 1.0)
    share = float(far.any(axis=1).mean())
    if share:
        return {'kind': 'outliers', 'share': round(share, 3)}
    off = np.abs(middle) / std / np.maximum(spread, 1.0)
    biased = np.flatnonzero(off > _BIASED + 1.25 * chance).tolist()
    if biased:
        sizes = [{'coordinate': k, 'size': float(f'{middle[k]:.2g}')} for k in biased]
        return {'kind': 'bias', 'off': sizes}
    near = error[~far.any(axis=1)] - middle
    ratio = np.maximum(np.sqrt((near**2).mean(axis=0)) / std, 1e-9)
    k = int(np.abs(np.log(ratio)).argmax())
    factor = float(ratio[k])
    largest = factor if factor > 1.0 or len(near) < _LEAST_CALM else 1.0 / factor
    if largest > _NOISIER + 0.71 * chance:
        return {'kind': 'noise', 'off': [{'coordinate': k, 'factor': float(f'{factor:.2g}')}]}
    return {}
