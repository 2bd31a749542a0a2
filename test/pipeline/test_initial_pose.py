# SPDX-License-Identifier: Apache-2.0
"""A pose from RViz becomes a belief."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.serialization import serialize_message

from kalman_ros import scenario
from kalman_ros.core import Gaussian
from kalman_ros.pipeline.initial_pose import PoseReader

NAMES = ('x', 'v_x', 'y', 'v_y')


def pose(x=1.0, y=2.0, variance=0.25):
    message = PoseWithCovarianceStamped()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.covariance[:] = (variance * np.eye(6)).ravel()
    return bytes(serialize_message(message))


def test_the_pose_is_put_in_and_the_rest_stays():
    found = scenario.build({'model': 'mass_spring_damper_2d'})
    assert found.model.state.names == NAMES
    root = np.random.default_rng(0).normal(size=(4, 4))
    before = Gaussian(np.array([9.0, 8.0, 7.0, 6.0]), root @ root.T)
    mean, covariance = before.mean.copy(), before.covariance.copy()
    belief = PoseReader(found)(pose(), before)
    np.testing.assert_array_equal(belief.mean, [1.0, 8.0, 2.0, 6.0])
    expected = covariance.copy()
    expected[[0, 2], :] = 0.0
    expected[:, [0, 2]] = 0.0
    expected[[0, 2], [0, 2]] = 0.25
    np.testing.assert_array_equal(belief.covariance, expected)
    np.testing.assert_array_equal(before.mean, mean)
    np.testing.assert_array_equal(before.covariance, covariance)


@pytest.mark.parametrize(
    ('model', 'data', 'says'),
    [
        ('mass_spring_damper_2d', pose(x=np.nan), 'expected finite numbers'),
        ('mass_spring_damper_2d', pose(variance=0.0), 'covariance: expected a positive definite'),
        ('dc_motor', pose(), 'no pose'),
    ],
)
def test_what_is_no_belief_is_refused(model, data, says):
    found = scenario.build({'model': model})
    with pytest.raises(ValueError, match=says):
        PoseReader(found)(data, found.initial_belief)
