# SPDX-License-Identifier: Apache-2.0
"""Fits of six parameters to a minute at 100 Hz, against ten seconds of processor time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.programs.tune.coverage_cases import Case, likelihood, recorded, steps

from .benchmark import Benchmark, Timing

#: Processor seconds of a fit.
_TEN = 10.0
_PUSH = steps(3.0, 5.0)
_LINEAR = Case(
    'linear',
    {
        'model': 'mass_spring_damper_2d', 'rate': 100.0, 'sensors': ['position'],
        'position.rate': 100.0,
    },
    {'model_parameters.mass': 1.3, 'position.noise': [0.03, 0.03]},
    ['mass', 'damping_x', 'stiffness_x', 'force_noise', 'position.noise'],
    60.0, lambda time: np.repeat(_PUSH(time), 2),
)  # fmt: skip
_CART_POLE = Case(
    'cart-pole',
    {
        'model': 'cart_pole', 'rate': 100.0, 'joint_states.rate': 100.0,
        'initial_estimate': [0.0, 0.0, 3.0, 0.0], 'initial_std': [0.01, 0.02, 0.05, 0.05],
    },
    {'model_parameters.friction': 0.2, 'joint_states.noise': [0.01, 0.02]},
    ['friction', 'pole_mass', 'length', 'force_noise', 'joint_states.noise'],
    60.0, steps(2.0, 1.7),
)  # fmt: skip


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks: processor time of a fit."""
    what = 'fit of 6 parameters to a minute at 100 Hz'
    yield [
        Benchmark(f'{what}, {case.name} / 10 CPU s', 1.0, _fit(case), lambda: _TEN)
        for case in (_LINEAR, _CART_POLE)
    ]


def _fit(case: Case) -> Timing:
    """Return what fits a case, and returns the processor time."""
    data = recorded(case, 1)

    def timing() -> float:
        start = time.process_time()
        fit(likelihood(case, data))
        return time.process_time() - start

    return timing
