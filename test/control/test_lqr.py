# SPDX-License-Identifier: Apache-2.0
import numpy as np
from scipy.integrate import quad_vec

from kalman_ros.control.lqr import cost, sampled_cost
from kalman_ros.core import LinearSystem, Space


def test_the_cost_of_a_sample_is_the_integral_of_the_cost_along_it():
    state, input = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))
    system = LinearSystem([[0.1, 1.0], [-2.0, -0.3]], [[0.2], [1.0]], np.eye(2), state, input)
    weights = cost([2.0, 0.5], [0.3], (2, 1), [[0.1], [-0.2]])
    x, u, dt = np.array([1.0, -0.5]), np.array([0.7]), 0.4

    def rate(t):
        z = np.concatenate((system.step(x, u, t), u))
        return z @ weights.weight @ z

    exact, _ = quad_vec(rate, 0.0, dt, epsabs=1e-13)
    z = np.concatenate((x, u))
    np.testing.assert_allclose(z @ sampled_cost(system, weights, dt).weight @ z, exact, rtol=1e-11)
