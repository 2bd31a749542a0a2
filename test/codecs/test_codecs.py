# SPDX-License-Identifier: Apache-2.0
"""Every field that is written is read back, through the bytes on the wire."""

import os
import struct
import sys
from math import inf, nan
from time import monotonic, process_time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from kalman_ros.codecs import layout, wire
from kalman_ros.codecs.covariances import AbsentError
from kalman_ros.codecs.messages import (
    UndecodableError,
    frame_and_end,
    leading_frame,
    leading_stamp,
    message_type,
    nanoseconds,
    write_stamp,
)
from kalman_ros.codecs.padding import without_padding
from kalman_ros.codecs.signal_codec import SignalCodec, named
from kalman_ros.codecs.tick import read_tick, write_tick
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.core import Signal
from kalman_ros.scenario import wiring

STATE = wiring.system('mass_spring_damper_2d').state
PLAIN = {
    'odometry': STATE,
    'wrench': Signal('a', 'geometry_msgs/WrenchStamped', ('wrench.force.x', 'wrench.torque.z')),
    'pose': Signal(
        'a',
        'geometry_msgs/PoseWithCovarianceStamped',
        ('pose.pose.position.y', 'pose.pose.position.x'),
    ),
    'joints': Signal('a', 'sensor_msgs/JointState', ('position[hip]', 'velocity[knee]')),
    'array': Signal('a', 'std_msgs/Float64MultiArray', ('data[2]', 'data[0]')),
    'imu': Signal('a', 'sensor_msgs/msg/Imu', ('angular_velocity.z', 'linear_acceleration.x')),
    'pressure': Signal('a', 'sensor_msgs/FluidPressure', ('fluid_pressure',)),
    'twist': Signal('a', 'geometry_msgs/Twist', ('linear.x', 'angular.z')),
}
TURNED = {
    'attitude': Signal('a', 'sensor_msgs/Imu', ('orientation.roll', 'orientation.yaw')),
    'heading': Signal(
        'a', 'nav_msgs/Odometry', ('pose.pose.position.x', 'pose.pose.orientation.yaw')
    ),
}
WHOLE = {
    'rotation': Signal(
        'a',
        'nav_msgs/Odometry',
        (
            'pose.pose.position.x',
            'pose.pose.orientation.rx',
            'pose.pose.orientation.ry',
            'pose.pose.orientation.rz',
        ),
    )
}
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
times = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


def over_the_wire(codec, time, values, covariance=None):
    return bytes(serialize_message(codec.encode(time, np.array(values), covariance)))


@pytest.mark.parametrize('name', PLAIN)
@settings(max_examples=settings.default.max_examples // 3)
@given(data=st.data())
def test_numbers_come_back_to_the_bit(name, data):
    codec = SignalCodec(PLAIN[name], 'map', 'base_link')
    reader = WireReader(codec)
    for _ in range(3):
        time = data.draw(times)
        values = np.array(data.draw(st.lists(numbers, min_size=codec.size, max_size=codec.size)))
        raw = over_the_wire(codec, time, values)
        message = deserialize_message(raw, codec.message_type)
        np.testing.assert_array_equal(codec.decode(message), values)
        sample = reader(raw)
        np.testing.assert_array_equal(sample.values, values)
        if hasattr(message, 'header'):
            assert sample.time == time == leading_stamp(raw)
        else:
            assert sample.time is None


@pytest.mark.parametrize('name', TURNED)
@given(angle=st.floats(-3.1, 3.1), other=st.floats(-3.1, 3.1))
def test_angles_come_back_through_the_quaternion(name, angle, other):
    codec = SignalCodec(TURNED[name])
    raw = over_the_wire(codec, 0, [other, angle])
    np.testing.assert_allclose(WireReader(codec)(raw).values, [other, angle], atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_three_angles_are_those_of_rotations_about_fixed_axes(roll, pitch, yaw):
    """REP-103: about x, then y, then z, of axes that do not turn."""
    angles = ('orientation.roll', 'orientation.pitch', 'orientation.yaw')
    codec = SignalCodec(Signal('a', 'sensor_msgs/Imu', angles))
    q = codec.encode(0, np.array([roll, pitch, yaw])).orientation
    found = Rotation.from_quat([q.x, q.y, q.z, q.w])
    expected = Rotation.from_euler('xyz', [roll, pitch, yaw])
    np.testing.assert_allclose((found.inv() * expected).magnitude(), 0.0, atol=1e-12)
    raw = over_the_wire(codec, 0, [roll, pitch, yaw])
    np.testing.assert_allclose(WireReader(codec)(raw).values, [roll, pitch, yaw], atol=1e-7)


VECTOR = ('orientation.rx', 'orientation.ry', 'orientation.rz')


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_a_rotation_vector_is_that_of_the_quaternion(vector):
    codec = SignalCodec(Signal('a', 'sensor_msgs/Imu', VECTOR))
    q = codec.encode(0, np.array(vector)).orientation
    expected = Rotation.from_rotvec(vector)
    found = Rotation.from_quat([q.x, q.y, q.z, q.w])
    np.testing.assert_allclose((found.inv() * expected).magnitude(), 0.0, atol=1e-12)
    raw = over_the_wire(codec, 0, vector)
    np.testing.assert_allclose(WireReader(codec)(raw).values, vector, rtol=1e-14, atol=1e-150)


def test_a_quaternion_of_any_sign_and_length_is_a_rotation_of_at_most_pi():
    codec = SignalCodec(Signal('a', 'sensor_msgs/Imu', VECTOR))
    message = codec.message_type()
    q = message.orientation
    for numbers in ((0.0, 0.0, -2.0, -2.0), (0.0, 0.0, 0.0, -1.0), (0.0, 3.0, 0.0, 0.0)):
        q.x, q.y, q.z, q.w = numbers
        expected = Rotation.from_quat(numbers).as_rotvec()
        np.testing.assert_allclose(codec.decode(message), expected, atol=1e-15)
    q.x, q.y, q.z, q.w = 0.0, 0.0, 0.0, 0.0
    assert np.isnan(codec.decode(message)).all()


@pytest.mark.parametrize(
    'fields', [VECTOR[:2], (*VECTOR, 'orientation.yaw'), ('orientation.rz', 'orientation.yaw')]
)
def test_a_rotation_vector_is_whole_and_no_angle_beside_it(fields):
    with pytest.raises(ValueError, match=r"fields: 'orientation.r.' goes with rx, ry, rz alone"):
        SignalCodec(Signal('a', 'sensor_msgs/Imu', fields))


def test_errors_of_a_rotation_are_the_fixed_axes_of_a_pose():
    """geometry_msgs/PoseWithCovariance: rows 3 to 5 are turns about fixed axes."""
    fields = tuple(f'pose.pose.orientation.{name}' for name in ('rx', 'ry', 'rz'))
    codec = SignalCodec(Signal('a', 'nav_msgs/Odometry', fields))
    P = np.diag([1.0, 2.0, 3.0]) + 0.1
    message = codec.encode(0, np.zeros(3), P)
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6)[3:, 3:], P)


@pytest.mark.parametrize(
    'name', ['odometry', 'pose', 'imu', 'attitude', 'heading', 'rotation', 'pressure']
)
def test_covariance_blocks_come_back(name):
    codec = SignalCodec({**PLAIN, **TURNED, **WHOLE}[name])
    reader = WireReader(codec)
    rng = np.random.default_rng(0)
    for _ in range(3):
        root = rng.normal(size=(codec.size, codec.size))
        P = root @ root.T
        raw = over_the_wire(codec, 5, rng.uniform(-1.0, 1.0, codec.size), P)
        found = codec.decode_covariance(deserialize_message(raw, codec.message_type))
        np.testing.assert_array_equal(found[found != 0.0], P[found != 0.0])
        np.testing.assert_array_equal(np.diag(found), np.diag(P))
        np.testing.assert_array_equal(reader(raw).covariance, found)


def test_a_covariance_that_stays_is_one_array_that_nobody_can_change():
    codec = SignalCodec(PLAIN['pose'])
    reader, n = WireReader(codec), codec.size
    first, second = np.eye(n), 2.0 * np.eye(n)
    given = [first, first, first, second, second, first]
    raw = [over_the_wire(codec, k, np.full(n, float(k)), P) for k, P in enumerate(given)]
    found = [reader(each) for each in raw]  # the first is decoded, and its layout learnt
    for k, (sample, P) in enumerate(zip(found, given)):
        np.testing.assert_array_equal(sample.values, np.full(n, float(k)))
        np.testing.assert_array_equal(sample.covariance, P)
    assert found[1].covariance is found[2].covariance
    assert found[3].covariance is found[4].covariance
    assert not found[3].covariance.flags.writeable


def test_the_covariance_of_odometry_is_where_the_standard_says():
    codec = SignalCodec(STATE)
    P = np.arange(16.0).reshape(4, 4)
    P = P + P.T
    raw = over_the_wire(codec, 0, np.zeros(4), P)
    message = deserialize_message(raw, codec.message_type)
    pose, twist = (part.covariance.reshape(6, 6) for part in (message.pose, message.twist))
    np.testing.assert_array_equal(pose[:2, :2], P[np.ix_([0, 2], [0, 2])])
    np.testing.assert_array_equal(twist[:2, :2], P[np.ix_([1, 3], [1, 3])])
    assert np.count_nonzero(pose) + np.count_nonzero(twist) == np.count_nonzero(pose[:2, :2]) + 4


def test_frames_are_filled_in():
    message = SignalCodec(STATE, 'map', 'base_link').encode(1_500_000_000, np.zeros(4))
    assert message.header.frame_id == 'map'
    assert message.child_frame_id == 'base_link'
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert message.pose.pose.orientation.w == 1.0


def test_a_reader_follows_when_names_or_lengths_change():
    one = SignalCodec(PLAIN['joints'])
    reader = WireReader(one)
    np.testing.assert_array_equal(reader(over_the_wire(one, 1, [1.0, 2.0])).values, [1.0, 2.0])
    message = one.encode(2, np.array([3.0, 4.0]))
    other = type(message)(
        name=['wheel', 'knee', 'hip'], position=[7.0, 8.0, 9.0], velocity=[4.0, 5.0, 6.0]
    )
    np.testing.assert_array_equal(reader(bytes(serialize_message(other))).values, [9.0, 5.0])
    np.testing.assert_array_equal(reader(over_the_wire(one, 3, [1.0, 2.0])).values, [1.0, 2.0])


def test_several_publishers_of_one_topic_each_have_a_layout(monkeypatch):
    """Up to four layouts are kept, so that each is learnt once; of more, the newest."""
    learnt, learn = [], wire.learn
    monkeypatch.setattr(wire, 'learn', lambda *given: learnt.append(given) or learn(*given))
    codecs = [SignalCodec(PLAIN['pose'], 'x' * 8 * k) for k in range(5)]
    reader = WireReader(codecs[0])

    def read(count):
        for turn in range(3):
            for k, codec in enumerate(codecs[:count]):
                sample = reader(over_the_wire(codec, turn, [float(k), 0.5 * turn]))
                np.testing.assert_array_equal(sample.values, [k, 0.5 * turn])
                assert sample.time == turn
        return len(learnt)

    assert read(4) == 4
    assert read(5) == 4 + 1 + 2 * 5


def test_a_name_or_element_that_is_not_there_is_a_lookup_error():
    joints = message_type('sensor_msgs/JointState')(name=['wheel'], position=[1.0])
    with pytest.raises(LookupError, match="no 'hip' among \\(wheel\\)"):
        WireReader(SignalCodec(PLAIN['joints']))(bytes(serialize_message(joints)))
    array = message_type('std_msgs/Float64MultiArray')(data=[1.0])
    with pytest.raises(LookupError):
        WireReader(SignalCodec(PLAIN['array']))(bytes(serialize_message(array)))


def test_an_explicit_covariance_path():
    signal = Signal('a', 'sensor_msgs/JointState', ('position[x]', 'position[v]'), 'effort')
    codec = SignalCodec(signal)
    P = np.array([[2.0, 0.5], [0.5, 1.0]])
    raw = over_the_wire(codec, 0, [1.0, 2.0], P)
    np.testing.assert_array_equal(WireReader(codec)(raw).covariance, P)


@pytest.mark.parametrize(
    ('type_', 'field', 'says'),
    [
        ('geometry_msgs/PoseStamped', 'pose.positon.x', "no 'positon' in Pose .* it has position"),
        ('geometry_msgs/PoseStamped', 'pose.position', "'pose.position' is not a number"),
        ('geometry_msgs/PoseStamped', 'header.frame_id', 'is not a number'),
        ('geometry_msgs/PoseStamped', 'pose..x', 'expected a path such as'),
        ('geometry_msgs/PoseStamped', 'pose.position.x[hip]', 'needs a message with an array'),
        ('sensor_msgs/JointState', 'position', 'is not a number'),
        ('sensor_msgs/JointState', 'name[0]', 'is not in an array of numbers'),
        (
            'geometry_msgs/PoseArray',
            'poses[0].positon.x',
            "no 'positon' in Pose .* it has position",
        ),
        ('geometry_msgs/PoseArray', 'poses[a].position.x', 'is no place in an array of messages'),
        ('geometry_msgs/PoseArray', 'poses.position.x', "no 'position' in list .* an array"),
        ('geometry_msgs/PoseArray', 'poses[999999].position.x', 'expected an index below'),
        ('geometry_msgs/PoseArray', 'header[0].stamp.sec', 'is no place in an array of messages'),
        ('sensor_msgs/MultiDOFJointState', 'twist[0]', 'is not in an array of numbers'),
        ('sensor_msgs/Imu', 'orientation_covariance[9]', 'expected an index below 9'),
        ('shape_msgs/SolidPrimitive', 'dimensions[3]', 'expected an index below 3'),
        ('std_msgs/ByteMultiArray', 'data[0]', 'is not in an array of numbers'),
        ('geometry_msgs/Nothing', 'x', "has no message 'Nothing'"),
        ('nowhere_msgs/Thing', 'x', "'nowhere_msgs' is not installed"),
        ('Pose', 'x', "expected 'package/Name', got 'Pose'"),
        ('os/../path', 'x', "expected 'package/Name'"),
    ],
)
def test_a_wrong_signal_says_what_and_where(type_, field, says):
    with pytest.raises(ValueError, match=says) as error:
        SignalCodec(Signal('somewhere', type_, (field,)))
    assert "signal 'somewhere'" in str(error.value)


@pytest.mark.parametrize(
    ('type_', 'field', 'value', 'read'),
    [
        ('std_msgs/Int32', 'data', 2.6, 3.0),
        ('std_msgs/Int8', 'data', 1e9, 127.0),
        ('std_msgs/UInt16', 'data', -3.0, 0.0),
        ('std_msgs/UInt64', 'data', np.nan, 0.0),
        ('std_msgs/Int64', 'data', np.inf, 2.0**63),
        ('std_msgs/Bool', 'data', 0.7, 1.0),
        ('std_msgs/Float32', 'data', 0.5, 0.5),
        ('std_msgs/Int32MultiArray', 'data[2]', -7.4, -7.0),
        ('std_msgs/UInt8MultiArray', 'data[0]', 300.0, 255.0),
        ('std_msgs/Float32MultiArray', 'data[1]', 0.25, 0.25),
    ],
)
def test_whole_numbers_are_written_as_the_nearest(type_, field, value, read):
    codec = SignalCodec(Signal('somewhere', type_, (field,)))
    raw = over_the_wire(codec, 0, [value])
    np.testing.assert_array_equal(WireReader(codec)(raw).values, [read])
    written = WireWriter(codec)(0, np.array([value]))
    if not isinstance(written, bytes):
        np.testing.assert_array_equal(codec.decode(written), [read])


@pytest.mark.parametrize(
    ('type_', 'fields'),
    [
        ('geometry_msgs/PoseArray', ('poses[1].position.x', 'poses[1].orientation.yaw')),
        ('sensor_msgs/MultiDOFJointState', ('twist[0].linear.x', 'transforms[2].rotation.roll')),
        ('trajectory_msgs/JointTrajectory', ('points[1].positions[2]', 'points[0].effort[0]')),
        ('visualization_msgs/MarkerArray', ('markers[0].pose.position.z', 'markers[0].scale.x')),
    ],
)
def test_fields_of_messages_in_arrays(type_, fields):
    codec = SignalCodec(Signal('somewhere', type_, fields))
    reader, writer = WireReader(codec), WireWriter(codec)
    for values in ([0.5, -1.25], [2.0, 0.75]):
        raw = over_the_wire(codec, 0, values)
        np.testing.assert_allclose(reader(raw).values, values, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(codec.decode(writer(0, np.array(values))), values, atol=1e-15)
    empty = bytes(serialize_message(codec.message_type()))
    with pytest.raises(LookupError):
        reader(empty)


def test_named_values():
    signal = named(Signal('state', '', ()), ('x', 'v'))
    message = SignalCodec(signal).encode(0, np.array([1.0, 2.0]))
    assert list(message.name) == ['x', 'v']
    assert list(message.position) == [1.0, 2.0]


@given(times)
def test_stamps_come_back(time):
    stamp = message_type('geometry_msgs/PoseStamped')().header.stamp
    write_stamp(stamp, time)
    assert nanoseconds(stamp) == time


@pytest.mark.parametrize(
    ('time', 'held'), [(10**25, 2**31 * 10**9 - 1), (-(10**25), -(2**31) * 10**9)]
)
def test_a_time_that_no_stamp_holds_becomes_the_nearest_that_one_does(time, held):
    stamp = message_type('geometry_msgs/PoseStamped')().header.stamp
    write_stamp(stamp, time)
    assert nanoseconds(stamp) == held
    written = WireWriter(SignalCodec(STATE))(time, np.zeros(4), np.eye(4))
    assert leading_stamp(written) == held


@pytest.mark.parametrize('name', PLAIN)
def test_another_stamp_and_other_numbers_are_read_without_objects(name, monkeypatch):
    """What a message costs is mostly its conversion; once is enough to learn its layout."""
    codec = SignalCodec(PLAIN[name], 'map', 'base_link')
    reader = WireReader(codec)

    def padded(time, values, garbage):
        """Return a message whose padding holds what the publisher's memory held before."""
        data = over_the_wire(codec, time, values)
        message = deserialize_message(data, codec.message_type)
        used = without_padding(b'\xff' * len(data), message)
        return bytes(byte if is_used else garbage for byte, is_used in zip(data, used))

    reader(padded(1, np.zeros(codec.size), 0x00))
    later = padded(2_000_000_003, np.arange(1.0, codec.size + 1.0), 0xCD)
    monkeypatch.setattr(wire, 'decode', None)
    sample = reader(later)
    np.testing.assert_array_equal(sample.values, np.arange(1.0, codec.size + 1.0))
    assert sample.time in (2_000_000_003, None)


def test_a_layout_is_learnt_whatever_is_in_the_padding(monkeypatch):
    """Half a mark of an earlier message beside a number that is equal to the other half."""
    codec = SignalCodec(PLAIN['joints'], 'map', 'base_link')

    def padded(message):
        data = bytes(serialize_message(message))
        used = without_padding(b'\xff' * len(data), message)
        upper = struct.pack('<I', layout._FIRST_MARK >> 32)
        return bytes(b if used[i] else upper[i % 4] for i, b in enumerate(data))

    monkeypatch.setattr(layout, 'serialize_message', padded)
    for stamp in range(3):
        data = over_the_wire(codec, stamp, np.zeros(2))
        message = deserialize_message(data, codec.message_type)
        assert layout.learn(codec, message, padded(message)) is not None


def test_a_single_variance_is_written_for_its_own_field():
    """Beside a field without one, whose place comes first."""
    signal = Signal('a', 'sensor_msgs/FluidPressure', ('header.stamp.sec', 'fluid_pressure'))
    message = SignalCodec(signal).encode(0, np.zeros(2), np.array([[7.0, 0.0], [0.0, 3.0]]))
    assert message.variance == 3.0


@pytest.mark.parametrize('name', [*PLAIN, *TURNED])
def test_a_writer_says_what_the_codec_does(name):
    signal = {**PLAIN, **TURNED}[name]
    codec, write = (
        SignalCodec(signal, 'map', 'body'),
        WireWriter(SignalCodec(signal, 'map', 'body')),
    )
    rng = np.random.default_rng(0)
    for time in (7, 1_500_000_001, 2**31 * 10**9 - 1):
        values, root = rng.uniform(-1.0, 1.0, codec.size), rng.normal(size=(codec.size,) * 2)
        written = write(time, values, root @ root.T)
        if isinstance(written, bytes):
            written = deserialize_message(written, codec.message_type)
        assert written == codec.encode(time, values, root @ root.T)


def test_writers_leave_nothing_to_what_memory_held_before():
    writers = [WireWriter(SignalCodec(STATE, 'map', 'a_link')) for _ in range(20)]
    assert len({write(5, np.ones(4), np.eye(4)) for write in writers}) == 1


@pytest.mark.parametrize('name', [*PLAIN, *TURNED])
def test_only_padding_is_cleaned(name):
    codec = SignalCodec({**PLAIN, **TURNED}[name], 'carte_é_ü', 'a_link')
    message = codec.encode(3_000_000_007, np.linspace(0.1, 0.9, codec.size))
    data = bytes(serialize_message(message))
    clean = without_padding(data, message)
    assert deserialize_message(clean, codec.message_type) == message
    changed = [place for place, (a, b) in enumerate(zip(data, clean)) if a != b]
    assert all(clean[place] == 0 for place in changed)
    dirty = bytearray(data)
    for place in changed:
        dirty[place] ^= 0xFF
    assert without_padding(bytes(dirty), message) == clean


def joints(count):
    message = JointState(name=['a', 'b'], position=[0.5] * count)
    return bytes(serialize_message(message))


JOINTS = Signal('joints', 'sensor_msgs/JointState', ('position[b]', 'position[a]'))


def test_learning_takes_time_in_proportion_to_the_length():
    """The old way took 5.5 s for 60 000 numbers, and 280 times that for a million."""
    start = process_time()
    for count in (60_000, 120_000):
        read = WireReader(SignalCodec(JOINTS))
        first, again = read(joints(count)), read(joints(count))
        np.testing.assert_array_equal(first.values, [0.5, 0.5])
        np.testing.assert_array_equal(again.values, [0.5, 0.5])
        assert read._templates
    assert process_time() - start < 2.0


def test_a_missing_name_is_one_line_however_long_the_array():
    data = bytes(serialize_message(JointState(name=['c' * 1000] * 1000, position=[0.0] * 1000)))
    with pytest.raises(LookupError, match="no 'b' among") as raised:
        WireReader(SignalCodec(JOINTS))(data)
    assert len(str(raised.value)) < 300


def test_a_message_in_the_other_byte_order_is_read_as_its_writer_meant_it():
    # header, one name, one position, no velocity and no effort; numbers are aligned behind 4 bytes
    data = struct.pack('>BBHiII4x', 0, 0, 0, 5, 7, 1)
    data += struct.pack('>II2s2xI', 1, 2, b'a\0', 1)
    data += bytes(-(len(data) - 4) % 8) + struct.pack('>dII', 2.5, 0, 0)
    assert leading_stamp(data) == 5_000_000_007
    signal = Signal('joints', 'sensor_msgs/JointState', ('position[a]',))
    read = WireReader(SignalCodec(signal))
    for _ in range(3):
        sample = read(data)
        assert sample.values.tolist() == [2.5]
        assert sample.time == 5_000_000_007


@pytest.mark.parametrize('frame', ['', 'a', 'abc', 'abcd', 'world'])  # whatever the padding
@pytest.mark.parametrize('child', ['', 'b', '/base_link'])
def test_the_frames_of_a_message_are_read_from_its_bytes(frame, child):
    message = Odometry(child_frame_id=child)
    message.header.frame_id = frame
    data = bytes(serialize_message(message))
    assert leading_frame(data) == frame
    for of_child, name in ((False, frame), (True, child)):
        found, end = frame_and_end(data, of_child=of_child)
        assert found == name.lstrip('/')
        assert data[:end].endswith(name.encode() + b'\0')


@pytest.mark.parametrize('size', [0, 3, 4, 11, 12, 20])
def test_a_truncated_message_is_undecodable(size):
    data = joints(2)[:size]
    with pytest.raises(UndecodableError):
        WireReader(SignalCodec(JOINTS))(data)
    with pytest.raises(UndecodableError):
        read_tick(write_tick(5, ('position',))[:size])


def test_the_middleware_says_no_more_than_a_line_a_second_of_what_it_cannot_read(capfd):
    data = struct.pack('<BBHI', 0, 1, 0, 0) + struct.pack('<IIII', 0, 0, 2**31, 7)
    start = monotonic()
    for _ in range(200):
        with pytest.raises(UndecodableError):
            WireReader(SignalCodec(JOINTS))(data)
    seconds = monotonic() - start
    assert len(capfd.readouterr().err.splitlines()) <= 1 + seconds
    os.write(2, b'heard again')
    assert capfd.readouterr().err == 'heard again'


def test_a_package_whose_libraries_are_missing_is_refused_in_one_line(monkeypatch):
    class Built(type):
        _TYPE_SUPPORT = None

        @classmethod
        def __import_type_support__(cls):
            raise UnsupportedTypeSupport('built_msgs')

    package = SimpleNamespace(Thing=Built('Thing', (), {}))
    monkeypatch.setitem(sys.modules, 'built_msgs', SimpleNamespace(msg=package))
    monkeypatch.setitem(sys.modules, 'built_msgs.msg', package)
    with pytest.raises(ValueError, match="cannot load the libraries of 'built_msgs'"):
        message_type('built_msgs/Thing')


@pytest.mark.parametrize(
    ('low', 'high', 'read', 'reason'),
    [
        (0.5, 2.0, 5.0, 'range 5 is outside of 0.5 to 2'),
        (0.5, 2.0, 0.25, 'range 0.25 is outside of 0.5 to 2'),
        (0.5, 2.0, inf, 'range inf is outside of 0.5 to 2'),
        (0.5, 2.0, 2.0, ''),
        (0.5, 2.0, 0.5, ''),
        (0.5, inf, 80.0, ''),
        (0.0, 0.0, 5.0, ''),
    ],
)
def test_a_range_beyond_the_limits_of_its_message_is_none(low, high, read, reason):
    codec = SignalCodec(Signal('range', 'sensor_msgs/Range', ('range',)))
    message = codec.message_type(min_range=low, max_range=high, range=read)
    if reason:
        with pytest.raises(AbsentError, match=f'^{reason}$'):
            codec.decode(message)
        with pytest.raises(AbsentError):
            WireReader(codec)(bytes(serialize_message(message)))
    else:
        assert codec.decode(message) == [read]
        assert WireReader(codec)(bytes(serialize_message(message))).values == [read]


def test_a_range_that_is_no_number_is_left_to_the_filter_to_refuse():
    codec = SignalCodec(Signal('range', 'sensor_msgs/Range', ('range',)))
    message = codec.message_type(min_range=0.5, max_range=2.0, range=nan)
    assert np.isnan(codec.decode(message)).all()
