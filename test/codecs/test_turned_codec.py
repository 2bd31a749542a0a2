# SPDX-License-Identifier: Apache-2.0
"""Readings of turned sensors, against scipy's rotations and messages written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from kalman_ros.codecs.covariances import AbsentError, refuse_absent
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.core import Signal
from kalman_ros.core.mount import Mounting

IMU = 'sensor_msgs/Imu'
RATES = tuple(f'angular_velocity.{axis}' for axis in 'xyz')
ANGLES = tuple(f'orientation.{angle}' for angle in ('roll', 'pitch', 'yaw'))
VECTOR = tuple(f'orientation.{name}' for name in ('rx', 'ry', 'rz'))
QUARTER = np.pi / 2
MOUNTS = [
    (QUARTER, 0.0, 0.0), (0.0, QUARTER, 0.0), (0.0, -QUARTER, 0.0), (0.0, 0.0, QUARTER),
    (np.pi, 0.0, 0.0), (0.3, -0.8, 2.5),
]  # fmt: skip
#: Of the axes of the body, by those of the axes forward, right, down.
FRD, NED = np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1]])


def euler(angles):
    return Rotation.from_euler('xyz', angles)


def spd(rng):
    root = rng.normal(size=(3, 3))
    return root @ root.T + np.eye(3)


def imu(rate, attitude, covariance):
    """Return a message with what the sensor's own axes read."""
    message = Imu()
    message.header.stamp.sec = 7
    a, q = message.angular_velocity, message.orientation
    a.x, a.y, a.z = rate.tolist()
    q.x, q.y, q.z, q.w = attitude.as_quat().tolist()
    message.angular_velocity_covariance[:] = covariance.ravel()
    message.orientation_covariance[:] = covariance.ravel()
    return bytes(serialize_message(message))


def read_twice(signal, data):
    """Return a sample, which must be the same once the layout of the message is known."""
    read = WireReader(codec_of(signal))
    first, second = read(data), read(data)
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.covariance, second.covariance)
    assert first.time == second.time == 7_000_000_000
    return first


@pytest.mark.parametrize('angles', MOUNTS)
def test_vectors_and_their_covariances_are_turned_into_the_body(angles):
    rng = np.random.default_rng(1)
    rate, C, M = rng.normal(size=3), spd(rng), euler(angles).as_matrix()
    data = imu(M.T @ rate, Rotation.identity(), M.T @ C @ M)
    found = read_twice(Signal('imu', IMU, RATES, mounting=Mounting(angles)), data)
    np.testing.assert_allclose(found.values, rate, atol=1e-12)
    np.testing.assert_allclose(found.covariance, C, atol=1e-12)
    alone = read_twice(Signal('imu', IMU, RATES[2:], mounting=Mounting(angles)), data)
    np.testing.assert_allclose(alone.values, rate[2:], atol=1e-12)
    np.testing.assert_allclose(alone.covariance, C[2:, 2:], atol=1e-12)


@pytest.mark.parametrize('angles', MOUNTS)
def test_an_attitude_is_that_of_the_body(angles):
    """Also where the sensor itself points straight up, and has neither roll nor yaw."""
    body = (0.1, -0.2, 2.0)
    data = imu(np.zeros(3), euler(body) * euler(angles), np.diag([1.0, 2.0, 3.0]))
    found = read_twice(Signal('imu', IMU, ANGLES, mounting=Mounting(angles)), data)
    np.testing.assert_allclose(found.values, body, atol=1e-9)
    np.testing.assert_allclose(found.covariance, np.diag([1.0, 2.0, 3.0]), atol=1e-12)
    yaw = read_twice(Signal('imu', IMU, ANGLES[2:], mounting=Mounting(angles)), data)
    assert yaw.values == pytest.approx(2.0)
    vector = read_twice(Signal('imu', IMU, VECTOR, mounting=Mounting(angles)), data)
    np.testing.assert_allclose(vector.values, euler(body).as_rotvec(), atol=1e-9)
    np.testing.assert_allclose(vector.covariance, np.diag([1.0, 2.0, 3.0]), atol=1e-12)


def test_north_east_down_becomes_east_north_up():
    """Heading north, the yaw is 90 degrees; a turn to the right is negative."""
    rate, C = np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 3.0])
    mount = (0.3, -0.8, 2.5)
    body = euler((0.05, 0.1, 1.0))
    # the sensor is turned as it were one of forward, left, up, and then reads other axes
    reported = NED.T @ (body * euler(mount)).as_matrix() @ FRD
    turn = euler(mount).as_matrix() @ FRD
    data = imu(turn.T @ rate, Rotation.from_matrix(reported), NED.T @ C @ NED)
    mounting = Mounting(mount, 'ned')
    found = read_twice(Signal('imu', IMU, ANGLES, mounting=mounting), data)
    np.testing.assert_allclose(found.values, (0.05, 0.1, 1.0), atol=1e-9)
    np.testing.assert_allclose(found.covariance, C, atol=1e-12)
    found = read_twice(Signal('imu', IMU, RATES, mounting=mounting), data)
    np.testing.assert_allclose(found.values, rate, atol=1e-12)
    north = imu(np.array([0.0, 0.0, 0.4]), Rotation.identity(), C)
    signal = Signal('imu', IMU, (ANGLES[2], RATES[2]), mounting=Mounting(convention='ned'))
    np.testing.assert_allclose(read_twice(signal, north).values, [QUARTER, -0.4], atol=1e-9)


def test_places_keep_their_axes_with_a_mount_and_not_with_a_convention():
    message = Odometry()
    message.pose.pose.position.x, message.pose.pose.position.y = 3.0, 4.0
    fields = ('pose.pose.position.x', 'pose.pose.position.y')
    for mounting, expected in (
        (Mounting((0.0, 0.0, 1.0)), [3.0, 4.0]),
        (Mounting(convention='ned'), [4.0, 3.0]),
    ):
        codec = codec_of(Signal('odom', 'nav_msgs/Odometry', fields, mounting=mounting))
        np.testing.assert_allclose(codec.decode(message), expected)


@pytest.mark.parametrize('angles', MOUNTS)
@pytest.mark.parametrize('convention', ['enu', 'ned'])
@pytest.mark.parametrize('attitude', [ANGLES, VECTOR])
def test_what_is_written_is_read_again(angles, convention, attitude):
    mounting = Mounting(angles, convention, 'imu_link')
    signal = Signal('imu', IMU, (*attitude, *RATES[1:]), mounting=mounting)
    values, C = np.array([0.1, -0.2, 2.0, 0.5, 0.6]), np.diag([1.0, 2.0, 3.0, 4.0, 5.0])
    codec = codec_of(signal, 'map')
    message = WireWriter(codec)(7_000_000_000, values, C)
    assert message.header.frame_id == 'imu_link'
    found = read_twice(signal, bytes(serialize_message(message)))
    np.testing.assert_allclose(found.values, values, atol=1e-9)
    np.testing.assert_allclose(found.covariance, C, atol=1e-9)


def test_a_covariance_of_minus_one_means_no_reading():
    message = Imu()
    message.orientation_covariance[0] = -1.0
    message.angular_velocity_covariance[:] = np.eye(3).ravel()
    data = bytes(serialize_message(message))
    read = WireReader(codec_of(Signal('imu', IMU, RATES)))
    for _ in range(2):
        np.testing.assert_array_equal(read(data).covariance, np.eye(3))
    angles = WireReader(codec_of(Signal('imu', IMU, ANGLES)))
    with pytest.raises(AbsentError, match=r'orientation_covariance\[0\] is -1'):
        angles(data)
    message.angular_velocity_covariance[0] = -1.0
    data = bytes(serialize_message(message))
    for fields, mounting in ((RATES, Mounting()), (RATES[2:], Mounting((0.1, 0.2, 0.3)))):
        signal = Signal('imu', IMU, fields, mounting=mounting)
        for reader in (read, WireReader(codec_of(signal))):
            with pytest.raises(AbsentError):
                reader(data)
    # the third axis alone, without looking at what makes the first element -1
    with pytest.raises(AbsentError):
        SignalCodec(Signal('imu', IMU, RATES[2:])).decode(message)


@pytest.mark.parametrize(
    ('signal', 'why'),
    [
        (Signal('a', 'sensor_msgs/JointState', ('position[hip]',)), 'no axes to turn in pos'),
        (Signal('a', 'sensor_msgs/NavSatFix', ('east', 'north')), 'a fix has no axes'),
        (
            Signal('a', IMU, RATES[2:], 'angular_velocity_covariance'),
            'covariance: to be turned it must be of angular_velocity.x, angular_velocity.y, too',
        ),
    ],
)
def test_what_cannot_be_turned_is_refused_in_one_line(signal, why):
    with pytest.raises(ValueError, match=why):
        codec_of(replace(signal, mounting=Mounting((1.0, 0.0, 0.0))))


@pytest.mark.parametrize('first', [-2.0, -1.0 - 2e-16, -1.0 + 2e-16, -0.5, 0.0, 1.0, np.nan])
def test_only_minus_one_says_that_there_is_no_reading(first):
    """Other numbers below zero are no covariance, which is another fault."""
    ways = [('a',), ('b',)]
    refuse_absent(ways, [first, 4.0])
    for values, name in (([-1.0, first], 'a'), ([first, -1.0], 'b')):
        with pytest.raises(AbsentError, match=rf'^{name}\[0\] is -1$'):
            refuse_absent(ways, values)


@pytest.mark.parametrize('convention', ['enu', 'ned'])
def test_a_heading_offset_turns_the_world_of_the_messages(convention):
    """A compass that calls d zero reads R of a body whose attitude is Rz(d) W R B'."""
    rng, d = np.random.default_rng(4), 0.7
    attitude, rate, C = Rotation.random(random_state=3), rng.normal(size=3), spd(rng)
    mounting = Mounting((0.1, -0.2, 0.3), convention, heading=d)
    data = imu(rate, attitude, C)
    W = Rotation.from_euler('z', d).as_matrix() @ (NED if convention == 'ned' else np.eye(3))
    B = euler(mounting.rotation).as_matrix() @ (FRD if convention == 'ned' else np.eye(3))
    sample = read_twice(Signal('imu', IMU, VECTOR, mounting=mounting), data)
    wanted = Rotation.from_matrix(W @ attitude.as_matrix() @ B.T).as_rotvec()
    np.testing.assert_allclose(sample.values, wanted, atol=1e-12)
    np.testing.assert_allclose(sample.covariance, W @ C @ W.T, atol=1e-12)
    # what is in the axes of the body is not turned by it
    sample = read_twice(Signal('imu', IMU, RATES, mounting=mounting), data)
    np.testing.assert_allclose(sample.values, B @ rate, atol=1e-12)
    yaw = Signal('imu', IMU, ANGLES[2:], mounting=Mounting(heading=d))
    data = imu(rate, euler((0.0, 0.0, 0.4)), C)
    np.testing.assert_allclose(read_twice(yaw, data).values, [1.1], atol=1e-12)
