# SPDX-License-Identifier: Apache-2.0
"""A filter whose predictions and corrections are the exported C, in the place of Python's."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros.compiled.library import CompilerError, compiler, load
from kalman_ros.compiled.numbered import COUNT, NUMBER, POINTER, address, hold, memory
from kalman_ros.core import Array, Gaussian, Sensor, definite, unchecked
from kalman_ros.core.ordered_data import FirstSteps, OrderedData
from kalman_ros.estimators.filter import Correction, Filter, Prediction, SmoothableFilter
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation

from .loop import Loop, check_estimator
from .source import filter_source


class _Readings(ctypes.Structure):
    """``readings_of_sensor`` of ``filter.c``."""

    _fields_ = (
        ('y', ctypes.c_void_p), ('R', ctypes.c_void_p), ('limit', ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ('innovation', 'S', 'nis')),
    )  # fmt: skip


class FilterInC(Filter):
    """A filter in C.

    Parameters
    ----------
    original
        The same filter in Python.
    library
        The compiled one.
    sensors
        Their places in C, by name.
    """

    def __init__(self, original: Filter, library: ctypes.CDLL, sensors: dict[str, int]) -> None:
        self.model, self._original, self._sensors = original.model, original, sensors
        vars(self).update(
            optimal=original.optimal, fixed_gain=original.fixed_gain, mixture=original.mixture
        )
        if original.fixed_gain:
            self.gains = original.gains  # type: ignore[attr-defined]
        n, m = self.model.state.size, self.model.input.size
        self._n, self._m, self._whole = n, m, n + n * n
        hold(library, 'filter_predict', ctypes.c_int, POINTER, POINTER, NUMBER)
        hold(library, 'filter_correct', ctypes.c_int, POINTER, ctypes.c_int)
        hold(library, 'filter_predict_many', None, POINTER, POINTER, COUNT, NUMBER)
        hold(library, 'filter_correct_many', None, POINTER, COUNT, ctypes.c_int)
        library.filter_first.argtypes = [POINTER, COUNT, *[POINTER] * 9]
        library.filter_first.restype = COUNT
        library.filter_size.restype = ctypes.c_ulong
        self._library = library
        self._loop = ctypes.create_string_buffer(library.filter_size())

    def _belief(self, v: Array, made: Callable[[tuple[Array, Array]], Gaussian]) -> Gaussian:
        n = self._n
        return made((v[:n], v[n : self._whole].reshape(n, n)))

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""
        if belief.mean.ndim > 1:
            return self._predict_many(belief, u, dt)
        x, P = belief
        v = np.empty(self._whole + self._m + 1)
        v[: self._n], v[self._n : self._whole] = x, P.ravel()
        v[self._whole : -1] = u
        failed = self._library.filter_predict(self._loop, address(memory(v)), dt)
        if failed == 1:
            raise np.linalg.LinAlgError('the prediction has no finite result')
        return self._belief(v, unchecked if failed else definite)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return the belief corrected by the reading ``y`` (k,) of ``sensor``."""
        index = self._sensors.get(sensor.name)
        if index is None:
            return self._original.correct(belief, y, sensor)
        if belief.mean.ndim > 1:
            return self._correct_many(belief, y, sensor, index)
        x, P = belief
        k, n, whole = y.size, self._n, self._whole
        v = np.empty(whole + k + k * k + 1)
        v[:n], v[n:whole], v[whole : whole + k] = x, P.ravel(), y
        v[whole + k : -1] = sensor.covariance.ravel()
        failed = self._library.filter_correct(address(memory(v)), index)
        if failed == 1:
            raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
        S = v[whole + k : -1].reshape(k, k)
        posterior = self._belief(v, unchecked if failed else definite)
        return Correction(posterior, v[whole : whole + k], S, nis=float(v[-1]))

    has_first_steps = True

    def first_steps(
        self,
        belief: Gaussian,
        data: OrderedData,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps before a reading beyond its limit, of readings of sensors in C."""
        places = [self._sensors.get(sensor.name, -1) for sensor in sensors]
        absent = any(place < 0 and len(y) for place, y in zip(places, data.readings))
        if absent or not sensors:
            return None
        length, n = len(data.dt), self._n
        x, P = np.empty((length + 1, n)), np.empty((length + 1, n, n))
        x[0], P[0] = belief
        given = [
            (np.ascontiguousarray(y, float), np.ascontiguousarray(R, float))
            for y, R in zip(data.readings, data.covariances)
        ]
        counts = np.bincount(data.sensor + 1, minlength=len(sensors) + 1)[1:].tolist()
        results = [
            (np.empty((size, *y.shape[1:])), np.empty((size, *R.shape[1:])), np.empty(size))
            for (y, R), size in zip(given, counts)
        ]
        readings = (_Readings * len(self._sensors))()
        for place, (y, R), into, limit in zip(places, given, results, limits):
            if place >= 0:
                addresses = (array.ctypes.data for array in into)
                readings[place] = _Readings(y.ctypes.data, R.ctypes.data, limit, *addresses)
        sensor = np.array([*places, -1])[data.sensor]
        steps = [
            np.ascontiguousarray(array, kind)
            for array, kind in (
                (data.dt, float), (data.input, ctypes.c_long), (data.inputs, float),
                (sensor, ctypes.c_long), (data.start, ctypes.c_long), (data.row, ctypes.c_long),
            )
        ]  # fmt: skip
        count = self._library.filter_first(
            self._loop, length, *(array.ctypes.data for array in steps),
            ctypes.addressof(readings), x.ctypes.data, P.ctypes.data,
        )  # fmt: skip
        sizes = np.bincount(data.sensor[:count] + 1, minlength=len(sensors) + 1)[1:].tolist()
        read = [[array[:size] for array in into] for into, size in zip(results, sizes)]
        return FirstSteps(x[1 : count + 1], P[1 : count + 1], *zip(*read))

    def stacked(self) -> Filter:
        """Return the filter for beliefs with leading axes."""
        other = copy(self)
        other._original = self._original.stacked()
        return other

    def _rows(self, belief: Gaussian, *more: Array) -> tuple[Array, tuple[int, ...]]:
        """Return beliefs as rows of x, P and what stands behind them, and the leading axes."""
        x, P = belief
        lead, n = x.shape[:-1], self._n
        v = np.empty((*lead, self._whole + sum(block.shape[-1] for block in more)))
        v[..., :n], v[..., n : self._whole] = x, P.reshape(*P.shape[:-2], n * n)
        end = self._whole
        for block in more:
            v[..., end : end + block.shape[-1]] = block
            end += block.shape[-1]
        return v, lead

    def _predict_many(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        v, lead = self._rows(belief, u)
        count = int(np.prod(lead))
        self._library.filter_predict_many(self._loop, v.ctypes.data, count, dt)
        return self._beliefs(v)

    def _correct_many(self, belief: Gaussian, y: Array, sensor: Sensor, index: int) -> Correction:
        k, whole = y.shape[-1], self._whole
        R = sensor.covariance
        R = R.reshape(*R.shape[:-2], k * k)
        v, lead = self._rows(belief, y, R, np.zeros(1))
        self._library.filter_correct_many(v.ctypes.data, int(np.prod(lead)), index)
        S = v[..., whole + k : -1].reshape(*lead, k, k)
        return Correction(self._beliefs(v), v[..., whole : whole + k], S, nis=v[..., -1])

    def _beliefs(self, v: Array) -> Gaussian:
        n = self._n
        return unchecked((v[..., :n], v[..., n : self._whole].reshape(*v.shape[:-1], n, n)))


class SmoothableInC(FilterInC, SmoothableFilter):
    """A filter in C whose steps are linearised by the one in Python."""

    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return what `predict` does, with the F and Q of the whole step."""
        original: Any = self._original
        prediction: Prediction = original.linearized(belief, u, dt)
        return prediction


def in_c(scenario: Scenario, estimator: Estimation, *, wait: bool = True) -> Estimation:
    """Return an estimation with its filter in C.

    Without ``wait``, one that no earlier start has compiled is `Estimation.pending`, and the
    filter in Python computes.

    Raises
    ------
    ValueError
        If the filter or the model is not supported, or there is no compiler.
    """
    refused = 'arithmetic: c is not possible here'
    try:
        check_estimator(scenario, estimator)
        loop = Loop(scenario, estimator, np.zeros(scenario.model.input.size), None)
        source = filter_source(loop)
        library = load(source, wait=wait)
    except ValueError as error:
        raise ValueError(f'{refused}: {error}') from None
    except CompilerError as error:
        if wait or not compiler():
            raise ValueError(f'{refused}: {error}') from None
        pending = [*estimator.pending, error.pending] if error.pending else estimator.pending
        said = f'{estimator.arithmetic} (c: {error})'
        return replace(estimator, arithmetic=said, pending=pending)
    places = {name: k for k, name in enumerate(loop.sensors)}
    kind = SmoothableInC if isinstance(estimator.filter, SmoothableFilter) else FilterInC
    return replace(
        estimator, filter=kind(estimator.filter, library, places), arithmetic='c', pending=()
    )
