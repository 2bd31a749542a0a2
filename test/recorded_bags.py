# SPDX-License-Identifier: Apache-2.0
"""Recordings that others published, as bags of standard messages."""

from operator import itemgetter

import numpy as np
from rclpy.serialization import serialize_message
from recorded import data

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import message_type, write_stamp
from kalman_ros.core import rotations as so3
from kalman_ros.core.geodesy import Place, TangentPlane, axes, geodetic

#: When a recording begins, in nanoseconds.
START = 1_700_000_000_000_000_000
#: From forward, right, down to forward, left, up (REP-103).
FLIPPED = np.array([1.0, -1.0, -1.0])


def written(folder, topics, entries):
    """Write a bag of entries (time in s, topic, fill), each of which fills a message."""
    with RecordingWriter(folder) as writer:
        kinds = {topic: message_type(kind) for topic, kind in topics.items()}
        for topic, kind in topics.items():
            writer.add(topic, kind.replace('/', '/msg/'))
        for seconds, topic, fill in sorted(entries, key=itemgetter(0)):
            message, time = kinds[topic](), START + round(seconds * 1e9)
            write_stamp(message.header.stamp, time)
            fill(message)
            writer.write(topic, time, bytes(serialize_message(message)))
    return folder


def of_imu(rate, force):
    """Return what fills an Imu without attitude."""

    def fill(message):
        message.orientation_covariance[0] = -1.0
        for vector, values in (
            (message.angular_velocity, rate), (message.linear_acceleration, force)
        ):  # fmt: skip
            vector.x, vector.y, vector.z = map(float, values)

    return fill


def of_twist(*linear, turn=0.0):
    """Return what fills the twist of an Odometry."""

    def fill(message):
        twist = message.twist.twist
        twist.linear.x, twist.linear.y, twist.linear.z = map(float, linear)
        twist.angular.z = float(turn)

    return fill


def of_fix(latitude, longitude, altitude):
    """Return what fills a NavSatFix whose covariance is unknown."""

    def fill(message):
        message.latitude, message.longitude = float(latitude), float(longitude)
        message.altitude, message.status.status = float(altitude), 0

    return fill


class Car:
    """A minute of a car on a road: `car_60s`."""

    def __init__(self):
        folder = data('car_60s')
        self._read = lambda name: np.load(folder / f'{name}.npy')
        self.times = self._read('frame_times')
        self._begin = self.times[0]
        self.times = self.times - self._begin
        positions = self._read('frame_positions')
        self.datum = geodetic(positions[0])
        #: The true places, in m to the east, the north and up of the first one.
        self.truth = (positions - positions[0]) @ axes(self.datum).T

    def _timed(self, name, every=1):
        return (self._read(f'{name}_t') - self._begin)[::every], self._read(f'{name}_value')[
            ::every
        ]

    def fixes(self):
        """Return the times, as they are stamped, and the local places of the fixes."""
        times, values = self._timed('live_gnss_ublox')
        plane = TangentPlane(self.datum)
        return times, np.array([plane.local(Place(*row)) for row in values[:, [0, 1, 4]]])

    def bag(self, folder, silent=(0.0, 0.0)):
        """Write NavSatFix, Imu and Odometry, without fixes between the times ``silent``."""
        entries = []
        for (t, rate), force in zip(zip(*self._timed('gyro')), self._timed('accelerometer')[1]):
            entries.append((t, '/imu', of_imu(FLIPPED * rate, FLIPPED * force)))
        for t, speed in zip(*self._timed('speed', 4)):
            entries.append((t, '/odom', of_twist(speed[0], 0.0, 0.0)))
        for t, row in zip(*self._timed('live_gnss_ublox')):
            if not silent[0] < t < silent[1]:
                entries.append((t, '/fix', of_fix(*row[[0, 1, 4]])))
        topics = {
            '/imu': 'sensor_msgs/Imu', '/odom': 'nav_msgs/Odometry',
            '/fix': 'sensor_msgs/NavSatFix',
        }  # fmt: skip
        return written(folder, topics, entries)


class Uwb:
    """Half a minute of a robot between four radio anchors: `uwb_robot`."""

    anchors = ('105', '107', '109', '108')
    #: In m. The file calls .0785 the distance, and right what is left: driven as it says, the path
    #: is 1.0 m off the truth, as here .17 m.
    wheel_distance = 2 * 0.0785

    def __init__(self):
        folder = data('uwb_robot')
        lines = [line.split() for line in (folder / 'Indoor_UWB_Input.txt').open()]
        self._ranges = [line for line in lines if line[0] == 'range2']
        self._drives = np.array([line[1:4] for line in lines if line[0] == 'odom2diff'], float)
        truth = np.loadtxt(folder / 'Indoor_UWB_GT.txt', usecols=(1, 2, 3))
        self.times, self.truth = truth[:, 0], truth[:, 1:]

    def bag(self, folder):
        """Write an Odometry of the wheels, and a Range of each anchor."""
        entries = []
        for t, right, left in self._drives:
            turn = (left - right) / self.wheel_distance
            entries.append((t, '/odom', of_twist((right + left) / 2.0, 0.0, 0.0, turn=turn)))
        for _, t, distance, *_, anchor, _ in self._ranges:
            entries.append((float(t), f'/range_{anchor}', of_range(float(distance))))
        topics = {f'/range_{anchor}': 'sensor_msgs/Range' for anchor in self.anchors}
        return written(folder, {'/odom': 'nav_msgs/Odometry', **topics}, entries)


def of_range(distance):
    """Return what fills a Range."""

    def fill(message):
        message.range = distance

    return fill


class Hand:
    """An IMU that is turned by hand for three minutes, with optical truth: `imu_optical`.

    D. Laidig, M. Caruso, A. Cereatti and T. Seel, BROAD: A Benchmark for Robust Inertial
    Orientation Estimation, Data 6(7), 2021; trial 02.
    """

    #: Readings that are averaged; the magnetometer's are as many times rarer again.
    every = 5
    #: Averaged readings at rest before it moves.
    _resting = 170

    def __init__(self):
        import h5py

        with h5py.File(data('imu_optical') / '02_undisturbed_slow_rotation_B.hdf5') as file:
            read = [np.array(file[f'imu_{name}']) for name in ('gyr', 'acc', 'mag')]
            q, moving = np.array(file['opt_quat']), np.array(file['movement'], dtype=bool)
        n = self.every
        count = len(q) // n * n
        self.rate, self.force, field = (
            each[:count].reshape(-1, n, 3).mean(axis=1) for each in read
        )
        self.field = 1e-6 * field  # T
        q, moving = q[n - 1 : count : n, [1, 2, 3, 0]], moving[n - 1 : count : n]
        self.counts = moving & ~np.isnan(q).any(axis=1)
        self.truth, self.dt = so3.from_quaternion(q), n / 285.714

    def at_rest(self):
        """Return the attitude (3,), gravity, and the field of the Earth to the north and up."""
        force, field = (each[: self._resting].mean(axis=0) for each in (self.force, self.field))
        gravity = np.linalg.norm(force)
        up = force / gravity
        east = np.cross(field, up)
        north = np.linalg.norm(east)
        axes = np.array([east / north, np.cross(up, east) / north, up])
        return so3.log(axes), gravity, (north, field @ up)

    def bag(self, folder):
        """Write Imu and MagneticField."""
        entries = []
        for k, (rate, force, field) in enumerate(zip(self.rate, self.force, self.field)):
            # an input holds from its stamp on, and a mean is that of the time before
            entries.append(((k - 1) * self.dt, '/imu', of_imu(rate, force)))
            if k % self.every == 0:
                entries.append((k * self.dt, '/magnetometer', of_field(field)))
        topics = {'/imu': 'sensor_msgs/Imu', '/magnetometer': 'sensor_msgs/MagneticField'}
        return written(folder, topics, entries)


def of_field(field):
    """Return what fills a MagneticField."""

    def fill(message):
        vector = message.magnetic_field
        vector.x, vector.y, vector.z = map(float, field)

    return fill
