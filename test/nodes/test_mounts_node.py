# SPDX-License-Identifier: Apache-2.0
"""The mounting of a sensor from the real /tf_static, where tf2_msgs is installed, or one line."""

import importlib.util

import pytest
from sensor_msgs.msg import Imu
from static_frames import message

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.middleware.topics import STATIC
from kalman_ros.scenario import shipped

INSTALLED = importlib.util.find_spec('tf2_msgs') is not None


@pytest.fixture
def started(pair):
    file = str(shipped.file('diff_drive'))
    return lambda: pair(EstimatorNode, file=file, **{'imu.mount.tf': 'true'})


@pytest.mark.skipif(INSTALLED, reason='tf2_msgs is installed')
@pytest.mark.parametrize(
    ('frame', 'outcome'), [('imu_link', Outcome.NO_TRANSFORM), ('base_link', Outcome.FUSED)]
)
def test_without_tf2_msgs_what_is_in_the_frame_of_the_body_is_used(started, capfd, frame, outcome):
    found = started()
    said = capfd.readouterr().err
    assert "sensors in other frames than 'base_link' are not used: the message package" in said
    imus = found.publisher(Imu, 'imu')
    reading = Imu()
    write_stamp(reading.header.stamp, found.node.get_clock().now().nanoseconds)
    reading.header.frame_id = frame
    imus.publish(reading)
    counts = found.node._online.counts['imu']
    found.until(lambda: counts.total() == 1, 'the reading did not come')
    assert counts == {outcome: 1}


@pytest.mark.skipif(not INSTALLED, reason='tf2_msgs is not installed')
def test_a_sensor_has_readings_once_its_frame_is_placed(started):
    from tf2_msgs.msg import TFMessage

    found = started()
    imus = found.publisher(Imu, 'imu')
    counts = found.node._online.counts['imu']

    def turn():
        reading = Imu()
        write_stamp(reading.header.stamp, found.node.get_clock().now().nanoseconds)
        reading.header.frame_id = 'imu_link'
        reading.angular_velocity.x = 0.7  # about the axis that is up on the body
        imus.publish(reading)

    found.until(lambda: turn() or counts[Outcome.NO_TRANSFORM] > 3, 'no refusal')
    assert counts[Outcome.FUSED] == 0
    static = found.peer.create_publisher(TFMessage, '/tf_static', STATIC)
    static.publish(
        message(('base_link', 'imu_link', (0.0,) * 3 + (0.0, -(0.5**0.5), 0.0, 0.5**0.5)))
    )
    found.until(lambda: turn() or counts[Outcome.FUSED] > 20, 'no reading')
    assert found.node._online.belief.mean[4] == pytest.approx(0.7, abs=0.05)
