# SPDX-License-Identifier: Apache-2.0
"""How long fits take: of the cart-pole to a minute at 100 Hz, and of plain functions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

import kalman_ros as kr
from kalman_ros.simulation.batch_plant import BatchPlant

from .benchmark import Benchmark
from .filters import second

#: Seconds that a fit may take, elapsed: of the cart-pole, and of a function.
_MOST, _MOST_OF_FUNCTION = 2.0, 3.0
_SECONDS = 60.0
#: Seconds between two readings of a function.
_PERIOD = 0.05
#: What is fitted, and where the fit begins instead of at the truth.
_FIT = ('friction', 'pole_mass', 'length', 'force_noise', 'joint_states.noise')
_TRUTH = {
    'model': 'cart_pole', 'filter': 'ekf', 'rate': 100.0, 'joint_states.rate': 100.0,
    'initial_state': [0.0, 0.0, 3.0, 0.0], 'initial_estimate': [0.0, 0.0, 3.0, 0.0],
    'initial_std': [0.01, 0.02, 0.05, 0.05],
}  # fmt: skip
_STARTS = {
    'model_parameters.friction': 0.2, 'model_parameters.pole_mass': 0.25,
    'model_parameters.length': 0.27, 'model_parameters.force_noise': 0.002,
    'joint_states.noise': [0.008, 0.015],
}  # fmt: skip


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks, of elapsed time."""
    what = 'a fit of 6 parameters to a minute of the cart-pole / 87,000 EKF steps of filterpy'
    times, y, u = _recording()

    def ours() -> float:
        start = time.perf_counter()
        found = kr.tune(
            {**_TRUTH, **_STARTS}, {'joint_states': times}, {'joint_states': y}, u,
            input_times=times, fit=_FIT,
        )  # fmt: skip
        assert found.converged
        return time.perf_counter() - start

    fits = [Benchmark(what, 1.0, ours, lambda: _MOST * second())]
    for name, make in (('continuous', _swing), ('discrete', _sampled_swing)):
        name = (
            f'a fit of 4 parameters of a function in {name} time, with math and if, to 500 '
            'readings / 130,000 EKF steps of filterpy'
        )
        fits.append(
            Benchmark(name, 1.0, partial(_fit, make), lambda: _MOST_OF_FUNCTION * second())
        )
    yield fits


def _rates(gravity: float, drag: float) -> Callable[..., list[Any]]:
    """Return the rates of a pendulum whose drag depends on its direction."""

    def rates(x: Any, u: Any) -> list[Any]:
        resisting = drag * x[1] * abs(x[1]) if x[1] > 0.0 else 0.3 * drag * x[1]
        return [x[1], -gravity * math.sin(float(x[0])) - resisting + u[0]]

    return rates


def _swing(g: float = 9.0, d: float = 0.15, q: float = 0.02, r: float = 0.02) -> Any:
    model = kr.continuous_model(_rates(g, d), W=[1e-6, q], states='angle rate', inputs='torque')
    return model, kr.sensor([1.0, 0.0], [[r]])


def _sampled_swing(g: float = 9.0, d: float = 0.15, q: float = 0.02, r: float = 0.02) -> Any:
    rates = _rates(g, d)

    def following(x: Any, u: Any) -> list[Any]:
        rate = x[1] + _PERIOD * rates(x, u)[1]
        return [x[0] + _PERIOD * rate, rate]

    model = kr.discrete_model(
        following, Q=[1e-6, q * _PERIOD], states='angle rate', inputs='torque', period=_PERIOD
    )
    return model, kr.sensor([1.0, 0.0], [[r]])


def _fit(make: Callable[..., Any]) -> float:
    """Return the seconds of a fit to 500 readings."""
    rng, (model, _) = np.random.default_rng(1), make(9.81, 0.1, 0.01, 0.01)
    x, readings = np.array([0.6, 0.0]), []
    inputs = 2.0 * np.sin(0.7 * _PERIOD * np.arange(500))[:, np.newaxis]
    for u in inputs:
        x = model.step(x, u, _PERIOD) + rng.normal(0.0, [1e-4, math.sqrt(0.01 * _PERIOD)])
        readings.append(x[0] + rng.normal(0.0, 0.1))
    start = time.perf_counter()
    fitted = kr.tune(
        make, _PERIOD * np.arange(1, 501), np.array(readings), inputs,
        initial=([0.6, 0.0], [0.1, 0.1]),
    )  # fmt: skip
    assert fitted.converged
    return time.perf_counter() - start


def _recording() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (N,), readings (N, 2) and inputs (N, 1) of a cart that is pushed about."""
    built = kr.load(_TRUTH)
    steps = round(_SECONDS * built.rate)
    plant = BatchPlant(
        built.model, built.timed, built.rate, built.initial_state[np.newaxis], [0], steps
    )
    times, readings, inputs = [], [], []
    for step in range(steps):
        at = step / built.rate
        push = 2.0 * np.sign(np.sin(2.0 * np.pi * at / 1.7 + 0.8 * np.sin(0.37 * at)))
        times.append(at)
        readings.append(plant.readings()['joint_states'][0])
        inputs.append([push])
        plant.step(np.array([push]))
    return np.array(times), np.array(readings), np.array(inputs)
