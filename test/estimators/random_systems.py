# SPDX-License-Identifier: Apache-2.0
"""Linear systems and sensors drawn at random, for the tests of this folder."""

import numpy as np

from kalman_ros.core import Gaussian, LinearSystem, Sensor, Space, TimedSensor
from kalman_ros.estimators.plan import Plan


class Linear(Sensor):
    linear = True

    def __init__(self, C, R, name):
        self.C, self.covariance, self.name = C, R, name
        names = tuple(f'{name}{index}' for index in range(len(C)))
        self.output = Space(names, ('',) * len(C))

    def measure(self, x):
        return x @ self.C.T

    def jacobian(self, x):
        return self.C


def random_plan(seed, n=4, m=2, k=2):
    rng = np.random.default_rng(seed)
    space = Space(tuple(f'x{index}' for index in range(n)), ('',) * n)
    inputs = Space(tuple(f'u{index}' for index in range(m)), ('',) * m)
    root = rng.normal(size=(n, n))
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    system = LinearSystem(A, B, 0.1 * root @ root.T, space, inputs)
    sensor = Linear(rng.normal(size=(k, n)), np.diag(rng.uniform(0.2, 2.0, k)), 'y')
    return rng, Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0), sensor


def random_problem(seed):
    """Return random numbers, a system, its sensor and a first belief."""
    rng, plan, sensor = random_plan(seed)
    n = plan.model.state.size
    prior = Gaussian(rng.normal(size=n), np.diag(rng.uniform(0.5, 2.0, n)))
    return rng, plan.model, sensor, prior
