# SPDX-License-Identifier: Apache-2.0
"""Data that no one here made, replayed over topics to the running estimator."""

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.task import Future
from sensor_msgs.msg import Imu

from kalman_ros.codecs.messages import message_type, nanoseconds
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.harness import Run
from kalman_ros.nodes.middleware.topics import QUEUE
from kalman_ros.scenario import wiring


class Player:
    """Publishes messages one by one and waits for the estimate that answers each."""

    def __init__(self, run):
        self.run = run
        self.publishers = {}
        self.answered = Future()
        # the recorder looks now and then, which is too seldom to wait for
        kind = message_type(run.scenario.state.type)
        run.node.create_subscription(kind, 'estimate', self.came, QUEUE, raw=True)
        heard = lambda: run.reported('estimator', 'subscribers: /estimate')  # noqa: E731
        run.wait(lambda: heard() == '2', 60.0, heard)

    def came(self, _):
        if not self.answered.done():
            self.answered.set_result(None)

    def publish(self, topic, message):
        if topic not in self.publishers:
            publisher = self.run.node.create_publisher(type(message), topic, QUEUE)
            self.run.wait(
                publisher.get_subscription_count, 10.0, lambda: f'no subscriber of {topic}'
            )
            self.publishers[topic] = publisher
        self.answered = Future()
        self.publishers[topic].publish(message)
        self.run.spin(5.0, until=self.answered)
        assert self.answered.done(), f'{topic} was not answered'


def alone(model, **parameters):
    """Return a run of the estimator alone, in which no reading may get lost on its way."""
    reliable = {f'{name}.reliable': True for name in wiring.system(model).sensors}
    return Run(model, {**reliable, **parameters}, lockstep=False, nodes=('estimator',))


def lidar_radar():
    """Yield sensor, reading, stamp and the true x, y, v_x, v_y of each line of the file."""
    for line in data('lidar_radar_500.txt').read_text().splitlines():
        kind, *numbers = line.split()
        values = np.array(numbers, dtype=float)
        name, k = ('lidar', 2) if kind == 'L' else ('radar', 3)
        yield name, values[:k], int(values[k]) * 1000, values[k + 1 : k + 5]


def replay_lidar_radar(model, std):
    """Return the RMSE of x, y, v_x, v_y of the estimates that the file's readings got."""
    readings = list(lidar_radar())
    start = [*readings[0][1].tolist(), *[0.0] * (len(std) - 2)]
    with alone(model, initial_estimate=start, initial_std=std) as run:
        player = Player(run)
        sources = run.scenario.sensors
        codecs = {name: SignalCodec(source.signal) for name, source in sources.items()}
        for name, y, time, _ in readings:
            message = codecs[name].encode(time, y, sources[name].sensor.covariance)
            player.publish(sources[name].signal.topic, message)
        run.spin(0.1)
        estimates = run.recorder['estimate']
    np.testing.assert_array_equal(estimates.stamp, [time for _, _, time, _ in readings])
    found = estimates.values[:, :4].copy()
    if model == 'turn_rate':
        v, psi = estimates.values[:, 2:4].T
        found[:, 2:] = np.column_stack((v * np.cos(psi), v * np.sin(psi)))
    truth = np.array([truth for *_, truth in readings])
    return np.sqrt(np.mean((truth - found) ** 2, axis=0))


def test_lidar_and_radar_with_turn_rate_over_topics():
    # bound of udacity/CarND-Unscented-Kalman-Filter-Project
    rmse = replay_lidar_radar('turn_rate', [0.15, 0.15, 5.0, 1.0, 0.7])
    assert np.all(rmse <= [0.09, 0.10, 0.40, 0.30]), rmse


def test_lidar_and_radar_with_constant_velocity_over_topics():
    # bound of udacity/CarND-Extended-Kalman-Filter-Project, and what it reached
    rmse = replay_lidar_radar('constant_velocity', [0.15, 0.15, 5.0, 5.0])
    assert np.all(rmse <= [0.11, 0.11, 0.52, 0.52]), rmse
    np.testing.assert_allclose(rmse, [0.0972, 0.0854, 0.4509, 0.4396], rtol=0.12)


def fill(message, source):
    """Copy what a message of a bag has in common with one of rclpy, and return it."""
    for name in message.get_fields_and_field_types():
        value, own = getattr(source, name), getattr(message, name)
        if hasattr(own, 'get_fields_and_field_types'):
            fill(own, value)
        else:
            setattr(message, name, value)
    return message


def bag():
    """Yield topic, message and stamp of everything in the robot's bag."""
    highlevel = pytest.importorskip('rosbags.highlevel')
    kinds = {'sensor_msgs/msg/Imu': Imu, 'nav_msgs/msg/Odometry': Odometry}
    with highlevel.AnyReader([data('diff_drive_61s.bag')]) as reader:
        for connection, _, raw in reader.messages():
            source = reader.deserialize(raw, connection.msgtype)
            message = fill(kinds[connection.msgtype](), source)
            yield connection.topic, message, nanoseconds(message.header.stamp)


@pytest.mark.thorough
def test_the_differential_drive_robot_ends_where_it_should_over_topics():
    # cra-ros-pkg/robot_localization, test_ekf_localization_node_bag3: (1.0206, 3.4292, .7419)
    # within .1383 m. The noise is what the messages say of themselves
    messages = list(bag())
    odometry, imu = '/jackal_velocity_controller/odom', '/imu/data'
    first = next(message for topic, message, _ in messages if topic == imu).orientation
    parameters = {
        'odometry.topic': odometry,
        'imu.topic': imu,
        'imu.measures': ['psi', 'omega'],
        'imu.fields': ['orientation.yaw', 'angular_velocity.z'],
        'imu.noise': [0.1, 0.1],  # not used
        'initial_estimate': [0.0, 0.0, 0.0, 2.0 * float(np.arctan2(first.z, first.w)), 0.0],
    }
    pitch = 0.0
    with alone('diff_drive', **parameters) as run:
        player = Player(run)
        for topic, message, _ in messages:
            if topic == imu:
                q = message.orientation
                pitch = np.arcsin(2.0 * (q.w * q.y - q.z * q.x))
            else:  # the ground is not level: what of the wheels' speed stays in the plane
                message.twist.twist.linear.x *= np.cos(pitch)
            player.publish(topic, message)
        for name, count in (('imu', '3061'), ('odometry', '3060')):
            said = lambda: run.reported('estimator', f'{name}: fused')  # noqa: B023, E731
            run.wait(lambda: said() == count, 60.0, said)  # noqa: B023
        found = run.recorder['estimate']
    # some come late, and are fused in their place
    newest = np.maximum.accumulate([time for *_, time in messages])
    assert np.any(newest != [time for *_, time in messages])
    np.testing.assert_array_equal(found.stamp, newest)
    assert np.hypot(*(found.values[-1, :2] - [1.0206, 3.4292])) < 0.1383
