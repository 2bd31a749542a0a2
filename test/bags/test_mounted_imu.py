# SPDX-License-Identifier: Apache-2.0
"""However an IMU is mounted, the robot ends at the same place; readings of other frames do not
count.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seeds import first_fast
from static_frames import message as transforms

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

DRIVE = from_file(shipped.file('diff_drive'), 'estimator')
STEP, COUNT = 20_000_000, 500
START = 1_700_000_000_000_000_000
#: Of the gyroscope, along the axes of the body.
VARIANCES = np.diag([0.04, 0.09, 4e-4])
QUARTER = np.pi / 2


def recorded(folder, mount=(0.0, 0.0, 0.0), frame='base_link', wheels='base_link', placed_at=None):
    """Write 10 s of an S at 1 m/s: the wheels' speed, and the rate of a turned gyroscope."""
    rng, turn = np.random.default_rng(4), Rotation.from_euler('xyz', mount).as_matrix()
    C = (turn.T @ VARIANCES @ turn).ravel()
    with RecordingWriter(folder) as writer:
        writer.add('/odom', 'nav_msgs/msg/Odometry')
        writer.add('/imu', 'sensor_msgs/msg/Imu')
        if placed_at is not None:
            writer.add('/tf_static', 'tf2_msgs/msg/TFMessage')
        for k in range(COUNT):
            time = START + k * STEP
            if k == placed_at:
                q = Rotation.from_euler('xyz', mount).as_quat()
                place = ('base_link', frame, (0.0, 0.0, 0.0, *q))
                writer.write('/tf_static', time, transforms(place))
            odometry, imu = Odometry(), Imu()
            odometry.header.frame_id, odometry.child_frame_id = 'odom', wheels
            imu.header.frame_id = frame
            odometry.twist.twist.linear.x = 1.0
            odometry.twist.covariance[[0, 35]] = 1e-4, 1.0
            rate = turn.T @ (np.array([0.0, 0.0, np.sin(0.01 * k)]) + 0.1 * rng.normal(size=3))
            a = imu.angular_velocity
            a.x, a.y, a.z = rate.tolist()
            imu.angular_velocity_covariance[:] = C
            for topic, message in (('/odom', odometry), ('/imu', imu)):
                write_stamp(message.header.stamp, time)
                writer.write(topic, time, bytes(serialize_message(message)))
    return folder


@pytest.fixture(scope='module')
def straight(tmp_path_factory):
    return replay(recorded(tmp_path_factory.mktemp('bag') / 'straight'), DRIVE)


@pytest.mark.slow
@pytest.mark.parametrize(
    'mount', first_fast([((0.0, QUARTER, 0.0),), ((QUARTER, 0.0, 0.0),), ((0.4, -1.2, 3.0),)], 1)
)
def test_an_imu_mounted_at_90_degrees_ends_at_the_same_place(tmp_path, straight, mount):
    found = replay(recorded(tmp_path / 'a', mount), DRIVE, {'imu.mount.rotation': [*mount]})
    assert found.sensors['imu'].fused == straight.sensors['imu'].fused == COUNT
    np.testing.assert_allclose(found.beliefs.mean, straight.beliefs.mean, atol=1e-9)
    np.testing.assert_allclose(found.beliefs.covariance, straight.beliefs.covariance, atol=1e-9)
    assert found.notes == straight.notes == ()
    lost = replay(tmp_path / 'a', DRIVE)
    assert np.hypot(*(lost.beliefs.mean - straight.beliefs.mean)[-1, :2]) > 1.0


@pytest.mark.slow
def test_the_mounting_is_that_of_the_static_transform(tmp_path, straight):
    mount = (0.4, -1.2, 3.0)
    values = {'imu.mount.tf': True}
    bag = recorded(tmp_path / 'a', mount, frame='imu_link', placed_at=0)
    found = replay(bag, DRIVE, values)
    assert found.sensors['imu'].fused == COUNT
    np.testing.assert_allclose(found.beliefs.mean, straight.beliefs.mean, atol=1e-9)
    assert found.notes == ()
    late = replay(recorded(tmp_path / 'b', mount, frame='imu_link', placed_at=100), DRIVE, values)
    counts = late.sensors['imu'].counts
    assert counts == {Outcome.NO_TRANSFORM: 100, Outcome.FUSED: COUNT - 100}
    # the turn of the first 2 s is known from the wheels alone, and where it is wrong, it is known
    error = late.beliefs.mean[-1] - straight.beliefs.mean[-1]
    assert (np.abs(error) < 4.0 * np.sqrt(late.beliefs.covariance[-1].diagonal())).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ('frame', 'outcome'), [('imu_link', Outcome.NO_TRANSFORM), ('base_link', Outcome.FUSED)]
)
def test_without_static_transforms_what_is_in_the_frame_of_the_body_is_used(
    tmp_path, frame, outcome
):
    found = replay(recorded(tmp_path / 'a', frame=frame), DRIVE, {'imu.mount.tf': True})
    assert dict(found.sensors['imu'].counts) == {outcome: COUNT}


@pytest.mark.slow
def test_an_imu_of_another_frame_than_declared_is_counted_and_not_fused(tmp_path, straight):
    bag = recorded(tmp_path / 'a', (0.0, QUARTER, 0.0), frame='camera_imu')
    found = replay(bag, DRIVE, {'imu.frame': 'imu_link'})
    assert dict(found.sensors['imu'].counts) == {Outcome.OTHER_FRAME: COUNT}
    declared = replay(recorded(tmp_path / 'b', frame='imu_link'), DRIVE, {'imu.frame': 'imu_link'})
    np.testing.assert_array_equal(declared.beliefs.mean, straight.beliefs.mean)
    assert declared.notes == ()


@pytest.mark.slow
def test_an_undeclared_frame_is_taken_for_that_of_the_body_with_a_warning(tmp_path):
    bag = recorded(tmp_path / 'a', frame='imu_link', wheels='base_footprint')
    taken = "frame '{}' is taken for base_link; declare frame and mount to be sure"
    assert replay(bag, DRIVE).notes == (
        f'odometry: {taken.format("base_footprint")}',
        f'imu: {taken.format("imu_link")}',
    )
    assert (
        replay(bag, DRIVE, {'child_frame': 'base_footprint', 'imu.frame': 'imu_link'}).notes == ()
    )


#: The axes of the body, forward, left, up, in those of NED: forward, right, down.
DOWN = np.diag([1.0, -1.0, -1.0])


def inputs(folder, turn, frame='base_link'):
    """Write 5 s on a circle: positions, and the readings of an IMU that is turned."""
    rng = np.random.default_rng(5)
    with RecordingWriter(folder) as writer:
        writer.add('/imu', 'sensor_msgs/msg/Imu')
        writer.add('/position', 'geometry_msgs/msg/PoseWithCovarianceStamped')
        for k in range(COUNT // 2):
            time, imu = START + k * STEP, Imu()
            imu.header.frame_id = frame
            w, f = imu.angular_velocity, imu.linear_acceleration
            noise = 0.01 * rng.normal(size=(2, 3))
            w.x, w.y, w.z = (turn.T @ (np.array([0.0, 0.0, 0.4]) + noise[0])).tolist()
            f.x, f.y, f.z = (turn.T @ (np.array([0.0, 0.8, 9.80665]) + noise[1])).tolist()
            messages = [('/imu', imu)]
            if k % 10 == 0:
                place = PoseWithCovarianceStamped()
                place.header.frame_id, angle = 'map', 0.008 * k
                p = place.pose.pose.position
                p.x, p.y = 5.0 * float(np.sin(angle)), 5.0 * float(1.0 - np.cos(angle))
                messages.append(('/position', place))
            for topic, message in messages:
                write_stamp(message.header.stamp, time)
                writer.write(topic, time, bytes(serialize_message(message)))
    return folder


INERTIAL = {
    'model': 'inertial',
    'sensors': ['position'],
    'idle_input': 'equilibrium',
    'initial_estimate': [*[0.0] * 6, 2.0, *[0.0] * 8],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ('turn', 'values'),
    [
        (Rotation.from_euler('x', QUARTER).as_matrix(), {'mount.rotation': [QUARTER, 0.0, 0.0]}),
        (DOWN, {'convention': 'ned'}),
    ],
    ids=['on its side', 'down'],
)
def test_an_imu_that_is_the_input_is_turned_too(tmp_path, turn, values):
    straight = replay(inputs(tmp_path / 'a', np.eye(3)), INERTIAL)
    assert np.abs(straight.beliefs.mean[-1, 3:5]).max() < 0.1
    bag = inputs(tmp_path / 'b', turn, frame='imu_link')
    given = {f'input.{name}': value for name, value in values.items()}
    found = replay(bag, INERTIAL, {**given, 'input.frame': 'imu_link'})
    np.testing.assert_allclose(found.beliefs.mean, straight.beliefs.mean, atol=1e-9)
    assert found.notes == straight.notes == ()
    other = replay(bag, INERTIAL, {**given, 'input.frame': 'base_imu'})
    assert len(other.inputs.stamp) == 0
    assert replay(bag, INERTIAL).notes == (
        "input: frame 'imu_link' is taken for base_link; declare frame and mount to be sure",
    )
