# SPDX-License-Identifier: Apache-2.0
import numpy as np

from kalman_ros.core import Space
from kalman_ros.sensors.states import States


def test_other_noise_makes_another_sensor():
    space = Space(('x', 'v'), ('m', 'm/s'))
    sensor = States(space, [0.5], ('x',))
    other = sensor.with_covariance(np.array([[4.0]]))
    np.testing.assert_array_equal(other.covariance, [[4.0]])
    np.testing.assert_array_equal(sensor.covariance, [[0.25]])
    np.testing.assert_array_equal(other.jacobian(np.zeros(2)), sensor.jacobian(np.zeros(2)))
