# SPDX-License-Identifier: Apache-2.0
"""An inertial estimate at rest: without readings of zero it drifts away, with them it stays."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from kalman_ros.analysis.diagnosis import frozen
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.programs.doctor.loading import replayed
from kalman_ros.programs.replay import statistics

START, RATE, SECONDS = 1_700_000_000_000_000_000, 50, 30
GYRO_BIAS, FORCE_BIAS = np.array([0.01, -0.005, 0.008]), np.array([0.05, -0.03, 0.04])
INERTIAL = {
    'model': 'inertial', 'sensors': ['rest', 'slip'], 'initial_estimate': [0.0] * 15,
    'initial_std': [1e-3] * 3 + [0.02] * 3 + [0.01] * 3 + [0.02] * 3 + [0.05] * 3,
    'rest.type': 'nav_msgs/Odometry', 'rest.topic': 'odom', 'rest.measures': ['vx', 'vy', 'vz'],
    'rest.fields': [f'twist.twist.linear.{axis}' for axis in 'xyz'], 'rest.noise': [0.01] * 3,
    'rest.zero': True, 'rest.still.below': [0.02] * 3,
    'slip.kind': 'body_velocity', 'slip.axes': ['y', 'z'], 'slip.type': 'nav_msgs/Odometry',
    'slip.topic': 'odom', 'slip.fields': ['twist.twist.linear.y', 'twist.twist.linear.z'],
    'slip.noise': [0.02, 0.02], 'slip.zero': True,
}  # fmt: skip
TURN = {
    'sensors': ['rest', 'slip', 'turn'], 'turn.type': 'sensor_msgs/Imu', 'turn.topic': 'imu',
    'turn.measures': ['gx', 'gy', 'gz'], 'turn.noise': [0.005] * 3,
    'turn.fields': [f'angular_velocity.{axis}' for axis in 'xyz'],
    'turn.still.below': [0.05] * 3,
}  # fmt: skip


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """An IMU with biases that lies still, beside wheels that report it."""
    folder, rng = tmp_path_factory.mktemp('bag') / 'rest', np.random.default_rng(5)
    with RecordingWriter(folder) as writer:
        writer.add('/odom', 'nav_msgs/msg/Odometry')
        writer.add('/imu', 'sensor_msgs/msg/Imu')
        for k in range(RATE * SECONDS):
            time = START + k * 1_000_000_000 // RATE
            odometry, imu = Odometry(), Imu()
            rate = GYRO_BIAS + 0.005 * rng.normal(size=3)
            force = FORCE_BIAS + [0.0, 0.0, 9.80665] + 0.1 * rng.normal(size=3)
            a, f = imu.angular_velocity, imu.linear_acceleration
            (a.x, a.y, a.z), (f.x, f.y, f.z) = rate.tolist(), force.tolist()
            for topic, message in (('/imu', imu), ('/odom', odometry)):
                write_stamp(message.header.stamp, time)
                writer.write(topic, time, bytes(serialize_message(message)))
    return folder


@pytest.mark.thorough
@pytest.mark.slow
def test_readings_of_zero_hold_the_place_and_find_the_biases(bag):
    at_rest = replay(bag, INERTIAL, TURN)
    assert at_rest.sensors['rest'].counts[Outcome.MOVING] == 25  # half a second
    assert at_rest.sensors['rest'].fused == RATE * SECONDS - 25
    assert at_rest.sensors['slip'].fused == RATE * SECONDS
    end, P = at_rest.beliefs.mean[-1], at_rest.beliefs.covariance[-1]
    drifting = replay(bag, INERTIAL, {'rest.enabled': False})
    assert np.linalg.norm(end[:3]) < 0.1
    assert np.abs(drifting.beliefs.mean[-1, 0]) > 5.0
    np.testing.assert_allclose(end[9:12], GYRO_BIAS, atol=1e-3)
    error = np.concatenate((end[:9], end[9:12] - GYRO_BIAS, end[12:] - FORCE_BIAS))
    assert (np.abs(error) < 4.0 * np.sqrt(P.diagonal())).all()


@pytest.mark.slow
@pytest.mark.thorough
def test_readings_of_zero_are_not_judged(bag):
    """They neither scatter nor change, and no sensor is to blame for that."""
    checked = statistics.checks(replay(bag, INERTIAL, TURN), None)
    assert {each.name for each in checked} == {'NIS of turn / 3', 'whiteness of turn'}
    evidence = replayed(Bag(bag), {**INERTIAL, **TURN})
    assert frozen.find(Examination(evidence)) == []
    assert frozen.repeats(evidence.sensors['slip']) is not None
