# SPDX-License-Identifier: Apache-2.0
"""States by name become a belief."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from kalman_ros import scenario
from kalman_ros.pipeline.named_state import StateReader
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file


def message(names, values, std=()):
    found = JointState(name=list(names), position=[*values], effort=[*std])
    return bytes(serialize_message(found))


@pytest.fixture(scope='module')
def found():
    values = from_file(shipped.file('gnss_imu'), 'estimator')
    return scenario.build({**values, 'imu.bias_std': [0.1]})


def test_named_states_are_put_in_and_the_rest_stays(found):
    before = found.believed.initial
    space = found.believed.model.state
    bias = next(name for name in space.names if name.startswith('imu.bias'))
    given = message(['psi', bias], [3.5, 0.2], [0.1, 0.0])
    belief = StateReader(found)(given, before)
    indices = space.indices(['psi', bias])
    np.testing.assert_allclose(belief.mean[indices], [3.5 - 2.0 * np.pi, 0.2])
    np.testing.assert_allclose(belief.covariance[indices, indices], [0.01, 0.0])
    others = [k for k in range(space.size) if k not in indices]
    np.testing.assert_array_equal(belief.mean[others], before.mean[others])


def test_rows_of_a_covariance_are_one(found):
    before = found.believed.initial
    space = found.believed.model.state
    given = message(['y', 'x'], [2.0, 1.0], [0.5, 0.1, 0.1, 0.25])
    belief = StateReader(found)(given, before)
    indices = list(space.indices(['y', 'x']))
    np.testing.assert_allclose(
        belief.covariance[np.ix_(indices, indices)], [[0.5, 0.1], [0.1, 0.25]]
    )
    others = [k for k in range(space.size) if k not in indices]
    np.testing.assert_array_equal(belief.covariance[np.ix_(indices, others)], 0.0)


def test_without_deviations_the_covariance_stays(found):
    before = found.believed.initial
    belief = StateReader(found)(message(['x'], [9.0]), before)
    assert belief.mean[0] == 9.0
    np.testing.assert_array_equal(belief.covariance, before.covariance)


@pytest.mark.parametrize(
    ('given', 'says'),
    [
        ((['nose'], [1.0]), "name: expected names among .*, got 'nose'"),
        (([], []), 'expected names of states, got none'),
        ((['x', 'x'], [1.0, 2.0]), 'expected names that do not repeat'),
        ((['x', 'y'], [1.0]), 'expected 2 values in position'),
        ((['x'], [1.0], [1.0, 2.0]), 'in effort none, 1 deviations or the 1 numbers'),
        ((['x', 'y'], [1.0, 2.0], [1.0, 2.0, 2.0, 1.0]), 'effort: expected a positive semi'),
        ((['x'], [np.nan]), 'expected finite numbers'),
        ((['x'], [1.0], [-1.0]), 'deviations of 0 or more'),
    ],
)
def test_what_is_no_state_is_refused(given, says, found):
    with pytest.raises(ValueError, match=says):
        StateReader(found)(message(*given), found.believed.initial)
