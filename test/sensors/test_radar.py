# SPDX-License-Identifier: Apache-2.0
"""The radar at the place of the target, where the bearing has no meaning."""

import numpy as np

from kalman_ros.core import Space
from kalman_ros.sensors.radar import Radar

SENSOR = Radar(Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s')), [0.3, 0.03, 0.3])


def test_at_its_own_place_it_reads_numbers():
    with np.errstate(all='raise'):
        np.testing.assert_allclose(SENSOR.measure(np.zeros(4)), 0.0, atol=1e-3)
        assert np.isfinite(SENSOR.jacobian(np.array([0.0, 0.0, 3.0, 4.0]))).all()


def test_the_range_rate_is_the_velocity_along_the_line():
    y = SENSOR.measure(np.array([3.0, 4.0, 1.0, 2.0]))
    np.testing.assert_allclose(y, [5.0, np.arctan2(4.0, 3.0), 11.0 / 5.0])
