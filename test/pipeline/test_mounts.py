# SPDX-License-Identifier: Apache-2.0
"""Where sensors are by static transforms: chains, loops, and readings before the transform."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from static_frames import message

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.core import rotations as so3
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.frames import Frames
from kalman_ros.pipeline.mounts import Mounts
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader, UnusableInputError
from kalman_ros.pipeline.settings import settings

TURN = Rotation.from_euler('xyz', [np.pi / 2, 0.3, -1.0])
PLACE = [0.2, -0.1, 0.4]
QUARTER = Rotation.from_euler('z', 90, degrees=True)


def numbers(place, turn):
    return [*place, *turn.as_quat()]


CHAIN = (
    ('base_link', 'mast', numbers([0.0, 0.0, 1.0], QUARTER)),
    ('mast', 'imu_link', numbers([1.0, 0.0, 0.0], TURN)),
    ('base_footprint', 'base_link', numbers([0.0, 0.0, 0.1], Rotation.identity())),
)


def frames(*transforms):
    found = Frames()
    for each in transforms:
        found.add(message(each))
    return found


def test_placements_are_composed_along_the_tree():
    known = frames(*CHAIN)
    place, turn = known.placement('imu_link', 'base_link')
    np.testing.assert_allclose(place, [0.0, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(turn, (QUARTER * TURN).as_rotvec(), atol=1e-12)
    place, _ = known.placement('imu_link', 'base_footprint')
    np.testing.assert_allclose(place, [0.0, 1.0, 1.1], atol=1e-12)
    place, turn = known.placement('base_link', 'imu_link')  # from the other end
    np.testing.assert_allclose(turn, -(QUARTER * TURN).as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(place, -(QUARTER * TURN).inv().apply([0.0, 1.0, 1.0]), atol=1e-12)
    np.testing.assert_array_equal(known.placement('mast', 'mast'), np.zeros((2, 3)))


def test_frames_that_nothing_connects_have_no_placement():
    loop = (('a', 'b', CHAIN[0][2]), ('b', 'a', CHAIN[0][2]))
    known = frames(*CHAIN, *loop)
    assert known.placement('a', 'base_link') is None
    assert known.placement('imu_link', 'camera') is None
    assert known.placement('a', 'b') is not None


@pytest.mark.parametrize('wrong', [[np.nan] * 3 + [0, 0, 0, 1], [0] * 7, [0] * 3 + [np.inf] * 4])
def test_a_transform_that_is_none_is_left_out(wrong):
    assert frames(('base_link', 'imu_link', wrong)).placement('imu_link', 'base_link') is None


DRIVE = {
    'model': 'robot_2d', 'sensors': ['imu'], 'imu.measures': ['wz', 'ax', 'ay'],
    'imu.type': 'sensor_msgs/Imu', 'imu.noise': [0.1, 0.1, 0.1], 'imu.mount.tf': True,
    'imu.fields': ['angular_velocity.z', 'linear_acceleration.x', 'linear_acceleration.y'],
}  # fmt: skip


def imu(frame='imu_link', time=1.0):
    """Return what a turned IMU reads in a turn: 0.5 rad/s, 2 m/s^2 to the left."""
    found = Imu()
    write_stamp(found.header.stamp, round(time * 1e9))
    found.header.frame_id = frame
    rate, force = TURN.inv().apply([[0.0, 0.0, 0.5], [0.0, 2.0, 9.8]]).tolist()
    a, f = found.angular_velocity, found.linear_acceleration
    (a.x, a.y, a.z), (f.x, f.y, f.z) = rate, force
    return bytes(serialize_message(found))


class Reader:
    """A sensor that takes its mounting from transforms."""

    def __init__(self, **values):
        self.scenario = settings({**DRIVE, **values}).scenario
        self.said, self.used = [], []
        self.mounts = Mounts(self.scenario, 'base_link', self.said.append)
        self.mounts.on_mounted = self.used.append
        source = self.scenario.sensors['imu']
        own = 'map', 'base_link'
        self._read = SensorReader('imu', source, None, own, self.said.append, self.mounts)
        self.read = lambda *given: self._read.read(imu(*given), source)

    @property
    def trouble(self):
        return self._read.trouble


def test_readings_before_the_transform_are_refused_and_later_ones_are_turned():
    reader = Reader()
    assert reader.mounts.needed
    assert reader.read().outcome is Outcome.NO_TRANSFORM
    assert reader.trouble == "no transform from 'base_link' to 'imu_link' on /tf_static yet"
    reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, TURN))))
    np.testing.assert_allclose(reader.read().values, [0.5, 0.0, 2.0], atol=1e-12)
    (scenario,) = reader.used
    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0])
    # at the place of the sensor: -w^2 l
    found = scenario.sensors['imu'].sensor.measure(x)
    np.testing.assert_allclose(found, [0.5, -0.25 * PLACE[0], -0.25 * PLACE[1]])
    assert reader.read('other').outcome is Outcome.OTHER_FRAME
    assert reader.said == []


def test_a_sensor_in_the_frame_of_the_body_needs_no_transform():
    assert Reader().read('base_link').outcome is None


def test_without_a_transform_of_its_frame_a_sensor_has_no_readings():
    reader = Reader()
    reader.mounts.on_static(message(*CHAIN))
    assert reader.read('camera').outcome is Outcome.NO_TRANSFORM
    assert reader.trouble


TURNS = {
    'model': 'robot_3d', 'imu.kind': 'states', 'imu.measures': ['rx', 'ry', 'rz'],
    'imu.type': 'sensor_msgs/Imu', 'imu.noise': [0.1, 0.1, 0.1], 'imu.mount.tf': True,
    'imu.fields': ['orientation.rx', 'orientation.ry', 'orientation.rz'],
}  # fmt: skip


@pytest.mark.parametrize('pose', ['absolute', 'relative'])
def test_a_rotation_is_the_same_everywhere_on_the_body(pose):
    reader = Reader(**TURNS, **{'imu.pose': pose})
    reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, TURN))))
    assert reader.read().outcome in (None, Outcome.FIRST_POSE)


def test_messages_without_a_frame_are_those_of_the_body_as_in_robot_localization():
    reader = Reader()
    assert reader.read('').outcome is None
    assert reader.said == ["imu: the messages name no frame: taken to be 'base_link'"]
    assert reader.read('').outcome is None
    assert len(reader.said) == 1


def test_a_model_without_heading_refuses_a_place_with_the_reason():
    given = {'measures': ['x'], 'fields': ['linear_acceleration.x'], 'noise': [0.1]}
    sensor = {f'imu.{name}': value for name, value in given.items()}
    reader = Reader(model='mass_spring_damper', **sensor)
    reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, TURN))))
    assert reader.read().outcome is Outcome.NO_TRANSFORM
    assert 'takes a state with a yaw rate' in reader.trouble


def test_the_mounting_outlives_a_live_change():
    reader = Reader()
    reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, TURN))))
    reader.read()
    changed = reader.mounts.applied(settings({**DRIVE, 'imu.noise': [0.2] * 3}).scenario)
    sensor = changed.sensors['imu'].sensor
    assert sensor.covariance[0, 0] == pytest.approx(0.04)
    assert sensor.measure(np.eye(8)[5])[1] == -PLACE[0]


def test_the_two_quaternions_of_half_a_turn_are_no_change():
    reader = Reader()
    for sign in (1, -1):
        transform = [*PLACE, sign, 0, 0, 0]
        reader.mounts.on_static(message(('base_link', 'imu_link', transform)))
        reader.read()
    assert reader.said == []


def test_a_transform_that_cannot_be_used_is_the_reason():
    reader = Reader()
    reader.mounts.on_static(message(('base_link', 'imu_link', [0] * 7)))
    assert reader.read().outcome is Outcome.NO_TRANSFORM
    refused = "the transform of 'imu_link' on /tf_static is not finite, or no rotation"
    assert reader.trouble == refused
    reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, TURN))))
    assert reader.read().outcome is None


def test_a_sensor_that_looks_straight_up_is_mounted_as_it_is():
    up = Rotation.from_euler('xyz', [0.3, -np.pi / 2, 0.7])
    found = frames(('base_link', 'imu_link', numbers(PLACE, up))).placement(
        'imu_link', 'base_link'
    )
    angles = so3.to_euler(found.rotation)
    np.testing.assert_allclose(
        Rotation.from_euler('xyz', angles).as_matrix(), up.as_matrix(), atol=1e-7
    )


def test_a_transform_that_changes_is_named():
    reader = Reader()
    transform = ('base_link', 'imu_link', numbers(PLACE, TURN))
    reader.mounts.on_static(message(transform))
    reader.read()
    reader.mounts.on_static(message(transform))
    assert reader.said == []
    for _ in range(3):
        reader.mounts.on_static(message(('base_link', 'imu_link', numbers(PLACE, QUARTER))))
    assert reader.said == ['imu: the transform of imu_link has changed: restart the estimator']


def test_a_mounting_beside_that_of_transforms_is_refused():
    with pytest.raises(ValueError, match=r'imu.mount.tf: expected no mount.translation and'):
        settings({**DRIVE, 'imu.mount.rotation': [0.1, 0.0, 0.0]})


INERTIAL = {
    'model': 'inertial', 'sensors': ['position'], 'input.mount.tf': True,
    'position.measures': ['x', 'y', 'z'], 'position.noise': [0.5, 0.5, 0.5],
    'position.type': 'geometry_msgs/PoseWithCovarianceStamped',
    'position.fields': [f'pose.pose.position.{axis}' for axis in 'xyz'],
}  # fmt: skip


def imu_of(rate, force, frame='imu_link', stamp=5_000_000_000):
    reading = Imu()
    reading.header.frame_id = frame
    write_stamp(reading.header.stamp, stamp)
    for vector, values in ((reading.angular_velocity, rate), (reading.linear_acceleration, force)):
        vector.x, vector.y, vector.z = map(float, values)
    return bytes(serialize_message(reading))


def test_the_imu_that_is_the_input_is_turned_by_its_transform():
    scenario, warned = settings({**INERTIAL, 'input.stamp_offset': -0.25}).scenario, []
    mounts = Mounts(scenario, 'base_link', warned.append)
    assert mounts.needed
    reader = InputReader(scenario.input, ('map', 'base_link'), warned.append, mounts)
    rate, force = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    data = imu_of(rate, force)
    with pytest.raises(UnusableInputError, match="no transform from 'base_link' to") as error:
        reader.read(data)
    assert error.value.outcome is Outcome.NO_TRANSFORM
    for each in CHAIN:
        mounts.on_static(message(each))
    turn = QUARTER * TURN
    w, place = turn.apply(rate), mounts._frames.placement('imu_link', 'base_link').translation
    assert np.linalg.norm(place) > 0.1
    centre = turn.apply(force) - np.cross(w, np.cross(w, place))
    for _ in range(2):
        found = reader.read(data)
        np.testing.assert_allclose(found.values, [*w, *centre], atol=1e-12)
        assert found.time == 4_750_000_000
    assert not warned
    mounts.on_static(message(('base_link', 'mast', numbers([0.0, 0.0, 1.0], TURN))))
    assert warned == ['input: the transform of imu_link has changed: restart the estimator']


@pytest.mark.parametrize('frame', ['', 'base_link'])
def test_an_input_without_a_frame_or_in_that_of_the_body_is_as_it_is(frame):
    scenario = settings(INERTIAL).scenario
    mounts = Mounts(scenario, 'base_link', str)
    reader = InputReader(scenario.input, ('map', 'base_link'), str, mounts)
    found = reader.read(imu_of([1, 2, 3], [4, 5, 6], frame)).values
    np.testing.assert_allclose(found, [1, 2, 3, 4, 5, 6])


def test_a_place_of_the_input_is_from_one_source_alone():
    with pytest.raises(ValueError, match=r'^input.mount.tf: expected no mount.translation and'):
        settings({**INERTIAL, 'input.mount.rotation': [0.1, 0.0, 0.0]})


def test_what_is_refused_by_its_frame_does_not_turn_the_next_one():
    given = {k: v for k, v in INERTIAL.items() if k != 'input.mount.tf'}
    changes = {'input.mount.translation': [0.5, 0.0, 0.0], 'input.frame': 'imu_link'}
    scenario = settings({**given, **changes}).scenario
    reader = InputReader(scenario.input, ('map', 'base_link'), str, None)
    for stamp in range(5, 25):
        found = reader.read(imu_of([0, 0, 0], [0, 0, 9.8], stamp=stamp * 10_000_000)).values
        np.testing.assert_array_equal(found, [0, 0, 0, 0, 0, 9.8])
        with pytest.raises(UnusableInputError):
            reader.read(imu_of([0, 0, 0.3], [0, 0, 9.8], 'other', stamp * 10_000_000 + 5_000_000))
