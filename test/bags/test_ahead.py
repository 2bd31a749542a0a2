# SPDX-License-Identifier: Apache-2.0
"""Messages that are taken together give the replay of messages taken one by one."""

from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import Twist, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from tools.strangers.injected.bag import write_bag
from tools.strangers.injected.recordings import Injection

from kalman_ros.bags import feed
from kalman_ros.bags.blocks import Message, Messages
from kalman_ros.bags.feed import Feed
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import _blocks, replay
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader
from kalman_ros.compiled import is_available
from kalman_ros.core import Signal
from kalman_ros.pipeline.input_timeout import InputTimeout
from kalman_ros.pipeline.reading_reader import ReadingReader, SensorReader
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file

GATED = {'joint_states.gate': 0.99, 'gate_recover_after': 5}
OUTLYING = Injection({'joint_states': {'outliers': 0.02, 'nan': 0.01, 'reordering': 0.01}})
#: Messages carry another covariance than the sensor has, and readings behind late ones are fused
#: again.
LOUDER = {'imu.covariance_from': 'message', 'imu.noise': [0.3, 0.3]}
LATE = Injection({'gnss': {'delay': 0.1}})
#: Scenario, parameters over its file, faults, and the least share that is taken together, which is
#: small where sensors have the same stamps and come in any order.
CASES = [
    ('cart_pole', {}, Injection(), 0.9),
    ('cart_pole', GATED, OUTLYING, 0.2),
    ('cart_pole', {'filter': 'iterated_ekf'}, Injection(), 0.0),
    ('cart_pole', {'arithmetic': 'c', 'filter': 'ukf'}, Injection(), 0.9),
    ('diff_drive', {'imu.bias_std': [0.1]}, Injection({'imu': {'dropout': 0.1}}), 0.0),
    ('gnss_imu', {'arithmetic': 'c'}, Injection({'gnss': {'delay': 0.1}}), 0.5),
    ('gnss_imu', {'imu.covariance_from': 'message'}, Injection(), 0.5),
    ('gnss_imu', LOUDER, LATE, 0.3),
    ('robot_3d', {}, Injection(), 0.9),
    ('mass_spring_damper_2d', {'arithmetic': 'c', 'filter': 'kf'}, Injection(), 0.3),
]


def both(bag, scenario, values, monkeypatch):
    """Return the replay of messages together, one by one, and the share that was together."""
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    taken, first = [], Feed._take_first
    with monkeypatch.context() as patch:
        patch.setattr(Feed, '_take_first', lambda feed, *given: taken.append(first(feed, *given))
                      or taken[-1])  # fmt: skip
        together = replay(bag, scenario, values)
    with monkeypatch.context() as patch:
        patch.setattr(Feed, 'take', lambda feed, messages: [feed(each) for each in messages])
        alone = replay(bag, scenario, values)
    messages = sum(len(sensor.nis) for sensor in alone.sensors.values())
    return together, alone, sum(taken) / (messages + len(alone.inputs.received))


def assert_same(one, other):
    for record, again in [
        (one.beliefs, other.beliefs), (one.inputs, other.inputs),
        *((sensor, other.sensors[name]) for name, sensor in one.sensors.items()),
    ]:  # fmt: skip
        assert [*vars(record)] == [*vars(again)]
        for name, value in vars(record).items():
            if isinstance(value, np.ndarray):
                np.testing.assert_array_equal(value, getattr(again, name), err_msg=name)
            else:
                assert value == getattr(again, name), name
    for name in ('restarts', 'repairs', 'duration', 'notes', 'arithmetic', 'biases'):
        assert str(getattr(one, name)) == str(getattr(other, name)), name


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
@pytest.mark.parametrize(('scenario', 'values', 'faults', 'least'), CASES)
def test_together_is_as_one_by_one(scenario, values, faults, least, tmp_path, monkeypatch):
    write_bag(tmp_path / 'bag', scenario, faults, 8.0, 5)
    together, alone, share = both(tmp_path / 'bag', scenario, values, monkeypatch)
    assert_same(together, alone)
    assert share >= least


def joints(folder, change=lambda k, message: None, received=lambda k: 10**9 + k * 10**7):
    """Write 3 s of the cart-pole's joints with a change of each message."""
    rng = np.random.default_rng(3)
    with RecordingWriter(folder) as writer:
        writer.add('/joint_states', 'sensor_msgs/msg/JointState')
        writer.add('/force', 'geometry_msgs/msg/WrenchStamped')
        pushed = WrenchStamped()
        write_stamp(pushed.header.stamp, 10**9 - 1)
        writer.write('/force', received(0), bytes(serialize_message(pushed)))
        for k in range(300):
            message = JointState(name=['cart', 'pole'], position=rng.normal(scale=0.01, size=2))
            write_stamp(message.header.stamp, 10**9 + k * 10**7)
            data = bytes(serialize_message(message)) if change(k, message) is None else b'none'
            writer.write('/joint_states', received(k), data)
    return folder


def cut(k, message):
    message.header.frame_id = 'rail'  # what is known decides about nothing else
    return None if k % 40 < 20 else b''


def outsize(k, message):
    if k == 150:
        message.position = [1e200, 0.0]


def framed(k, message):
    message.header.frame_id = 'rail'


def long(k, message):
    message.header.frame_id = 'rail' * (100 if k % 40 < 3 else 1)


def lacking(k, message):
    if k == 200:
        message.name, message.position = ['cart'], message.position[:1]


def _joint(name, state, joint='pole'):
    known = {
        'kind': 'states', 'measures': [state], 'noise': [0.01], 'rate': 100.0,
        'type': 'sensor_msgs/JointState', 'topic': 'joint_states',
        'fields': [f'position[{joint}]'],
    }  # fmt: skip
    return {f'{name}.{key}': value for key, value in known.items()}


#: Two sensors that read the same messages.
SHARED = {
    'sensors': ['joint_states', 'pole'],
    **_joint('joint_states', 'x', 'cart'),
    **_joint('pole', 'theta'),
}
#: The second of which is often refused, after the first was fused.
REFUSED = {**SHARED, 'pole.gate': 0.5, 'gate_recover_after': 0}

HOSTILE = [
    *((change, None, SHARED) for change in (outsize, framed, cut, lacking)),
    (long, None, {**SHARED, 'max_message_size': 300}),
    (long, None, {'max_message_size': 300}),
    (lambda k, message: None, None, REFUSED),
    (lambda k, message: None, None, {**SHARED, 'joint_states.gate': 0.5, 'gate_recover_after': 3}),
    (outsize, None, {}),
    (cut, None, {}),
    (framed, None, {}),
    (lambda k, message: None, lambda k: 0, {'input_timeout': 0.05}),
    (lambda k, message: None, lambda k: 10**9 + k * 10**7 if k < 250 else 2**63 + k, {}),
    (lambda k, message: None, None, {'joint_states.gate': 0.5, 'gate_recover_after': 0}),
    (lambda k, message: None, None, {'initial_std': [1e-7, 1e3, 1e-7, 1e3]}),
    (lambda k, message: None, None, {'joint_states.zero': True}),
]


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
@pytest.mark.parametrize(('change', 'received', 'values'), HOSTILE)
@pytest.mark.parametrize('arithmetic', ['compiled', 'c'])
def test_odd_recordings_are_the_same(change, received, values, arithmetic, tmp_path, monkeypatch):
    times = {} if received is None else {'received': received}
    bag = joints(tmp_path / 'bag', change, **times)
    values = {**values, 'arithmetic': arithmetic}
    together, alone, _ = both(bag, 'cart_pole', values, monkeypatch)
    assert_same(together, alone)


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
def test_messages_that_two_sensors_read_are_taken_together(tmp_path, monkeypatch):
    bag = joints(tmp_path / 'bag', lambda k, message: None)
    together, alone, share = both(bag, 'cart_pole', SHARED, monkeypatch)
    assert_same(together, alone)
    assert share > 0.8
    assert len(together.beliefs.time) == 600


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
def test_what_cannot_be_decoded_is_not_tried_again(tmp_path, monkeypatch):
    bag, tried, read = joints(tmp_path / 'bag', cut), [], SensorReader.read
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    monkeypatch.setattr(
        SensorReader,
        'read',
        lambda self, data, *given: tried.append(data) or read(self, data, *given),
    )
    replayed = replay(bag, 'cart_pole')
    assert replayed.sensors['joint_states'].undecodable == 140
    assert sum(data == b'none' for data in tried) <= 140


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
def test_a_sum_of_states_is_read_one_by_one(tmp_path, monkeypatch):
    write_bag(tmp_path / 'bag', 'gnss_imu', Injection(), 4.0, 5)
    C = np.random.default_rng(0).normal(size=16).tolist()
    together, alone, _ = both(tmp_path / 'bag', 'gnss_imu', {'imu.C': C}, monkeypatch)
    assert_same(together, alone)


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
def test_the_recording_of_what_is_published_is_the_same(tmp_path, monkeypatch):
    write_bag(tmp_path / 'bag', 'cart_pole', OUTLYING, 5.0, 5)
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    replay(tmp_path / 'bag', 'cart_pole', GATED, out=tmp_path / 'together')
    monkeypatch.setattr(Feed, 'take', lambda feed, messages: [feed(one) for one in messages])
    replay(tmp_path / 'bag', 'cart_pole', GATED, out=tmp_path / 'alone')
    one, other = (Bag(tmp_path / folder) for folder in ('together', 'alone'))
    assert len(one.topics) >= 4
    assert [*one.messages(one.topics)] == [*other.messages(other.topics)]


@pytest.mark.slow
@pytest.mark.skipif(not is_available(), reason='CasADi is not installed')
@pytest.mark.parametrize(('filter', 'long'), [('kf', 'C'), ('ukf', 'c')])
def test_a_filter_of_a_long_recording_is_c_as_a_whole_if_its_steps_are_not(
    filter, long, tmp_path, monkeypatch
):
    write_bag(tmp_path / 'bag', 'mass_spring_damper', Injection(), 5.0, 5)
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    short = replay(tmp_path / 'bag', 'mass_spring_damper', {'filter': filter})
    monkeypatch.setattr(feed, '_LONG', 200)
    replayed = replay(tmp_path / 'bag', 'mass_spring_damper', {'filter': filter})
    assert (short.arithmetic, replayed.arithmetic) == ('C', long)
    part = replay(tmp_path / 'bag', 'mass_spring_damper', {'filter': filter}, start=4.0)
    assert part.arithmetic == 'C'
    np.testing.assert_allclose(replayed.beliefs.mean, short.beliefs.mean, atol=1e-12)
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'numpy')
    again = replay(tmp_path / 'bag', 'mass_spring_damper', {'filter': filter})
    assert again.arithmetic == 'numpy'


def test_without_c_all_are_taken_one_by_one(tmp_path, monkeypatch):
    write_bag(tmp_path / 'bag', 'mass_spring_damper', Injection(), 5.0, 5)
    together, alone, share = both(tmp_path / 'bag', 'mass_spring_damper', {}, monkeypatch)
    assert_same(together, alone)
    assert share == 0.0


# --- decoding ---------------------------------------------------------------------------------

YAW_RATE = Signal('imu', 'sensor_msgs/Imu', ('angular_velocity.z',))
PLACE = Signal('odom', 'nav_msgs/Odometry', ('pose.pose.position.x', 'pose.pose.position.y'))


def imus(rng, count, covariance=0.01):
    for k in range(count):
        message = Imu()
        write_stamp(message.header.stamp, 10**18 + k)
        message.header.frame_id = 'base_link'
        message.angular_velocity.z = rng.normal()
        message.angular_velocity_covariance[8] = covariance * (1 + k // 3)
        yield message


def places(rng, count):
    for k in range(count):
        message = Odometry()
        write_stamp(message.header.stamp, 7 * k)
        message.pose.pose.position.x, message.pose.pose.position.y = rng.normal(size=2)
        message.pose.covariance[[0, 7]] = 0.5, np.nan if k == 4 else 0.5
        yield message


@pytest.mark.parametrize(
    ('signal', 'messages'),
    [
        (YAW_RATE, imus(np.random.default_rng(0), 20)),
        (PLACE, places(np.random.default_rng(1), 20)),
    ],
)
def test_messages_decoded_together_are_those_decoded_one_by_one(signal, messages):
    data = [bytes(serialize_message(message)) for message in messages]
    many = WireReader(codec_of(signal)).read_all(data)
    assert many is not None
    read = WireReader(codec_of(signal))
    for k, one in enumerate(map(read, data)):
        assert many.time[k] == one.time
        np.testing.assert_array_equal(many.values[k], one.values)
        np.testing.assert_array_equal(many.covariances[many.which[k]], one.covariance)


def test_messages_without_a_stamp_have_none():
    signal = Signal('cmd_vel', 'geometry_msgs/Twist', ('linear.x', 'angular.z'))
    message = Twist()
    message.linear.x, message.angular.z = 1.0, 2.0
    many = WireReader(codec_of(signal)).read_all([bytes(serialize_message(message))] * 3)
    assert (many.time, many.values.tolist(), list(many.covariances)) == (None, [[1, 2]] * 3, [])


@pytest.mark.parametrize(
    'change',
    [
        lambda data: data[:-1],
        lambda data: b'\0\0' + data[2:],
        lambda data: data.replace(b'base_link', b'base_sink'),
        lambda data: bytes(serialize_message(JointState())),
    ],
)
def test_a_message_of_another_layout_is_not_decoded_with_others(change):
    data = [bytes(serialize_message(each)) for each in imus(np.random.default_rng(0), 5)]
    read = WireReader(codec_of(YAW_RATE))
    assert len(read.read_all(data).values) == 5
    assert read.read_all([*data[:4], change(data[4])]) is None


def test_a_message_that_declares_absence_is_not_decoded_with_others():
    data = [bytes(serialize_message(each)) for each in imus(np.random.default_rng(0), 5)]
    absent = next(imus(np.random.default_rng(0), 1))
    absent.angular_velocity_covariance[0] = -1.0
    read = WireReader(codec_of(YAW_RATE))
    assert read.read_all(data) is not None
    assert read.read_all([*data, bytes(serialize_message(absent))]) is None


def test_a_sensor_that_is_always_zero_has_its_covariance_whatever_its_messages_carry():
    source = build(from_file(shipped.file('diff_drive'), 'estimator')).sensors['imu']
    signal = replace(source.signal, zero=True)
    reader = ReadingReader(signal)
    data = [bytes(serialize_message(each)) for each in imus(np.random.default_rng(0), 8)]
    reader.read(data[0], source)
    many = reader.read_all(data, source)
    assert many.values.tolist() == [[0.0]] * 8
    np.testing.assert_array_equal(many.covariance, [source.sensor.covariance] * 8)


@pytest.mark.parametrize('begin', [0, -5_000_000_000, 10**18])
def test_an_input_ends_before_the_same_message_as_one_by_one(begin):
    rng = np.random.default_rng(1)
    for _ in range(50):
        time = begin + np.cumsum(rng.integers(0, 120, 40)) * 1_000_000
        now, acts = time + rng.integers(-50, 50, 40) * 1_000_000, rng.random(40) < 0.3
        alone, many = (InputTimeout(0.1, np.zeros(1)) for _ in range(2))
        expected = len(time)
        for k in range(len(time)):
            if alone.ended_by(min(int(time[k]), int(now[k]))):
                expected = k
                break
            if acts[k]:
                alone.on_input(int(time[k]))
        assert many.before_end(time, now, acts) == expected


def test_messages_are_taken_in_blocks_of_a_number_and_of_some_bytes():
    many = [Messages.of(Message(k, 'a', bytes(9)) for k in range(7))]
    for batches in (many, [many[0].some(slice(k, k + 1)) for k in range(7)]):
        blocks = [*_blocks(batches, iter([2, 3, 3]))]
        assert [block.time for block in blocks] == [[0, 1], [2, 3, 4], [5, 6]]
    large = [Messages.of(Message(k, 'a', bytes(9_000_000)) for k in range(3))]
    assert [len(block) for block in _blocks(large, repeat(100))] == [2, 1]
