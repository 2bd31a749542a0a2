# SPDX-License-Identifier: Apache-2.0
"""How long a fit takes: a minute of the cart-pole at 100 Hz, six parameters."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import kalman_ros as kr
from kalman_ros.simulation.batch_plant import BatchPlant

from .benchmark import Benchmark
from .filters import second

#: Seconds that a fit may take, elapsed.
_MOST = 2.0
_SECONDS = 60.0
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
    """Yield the benchmark, of elapsed time."""
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

    yield [Benchmark(what, 1.0, ours, lambda: _MOST * second())]


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
