# SPDX-License-Identifier: Apache-2.0
"""Which covariance of a reading is used: that of the message, or that of the configuration."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix

from kalman_ros import scenario
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Signal
from kalman_ros.core.geodesy import Origin
from kalman_ros.pipeline.reading_reader import InputReader, ReadingReader

CONFIGURED = 0.05**2


@pytest.mark.parametrize(
    ('policy', 'carried', 'used'),
    [
        ('message', 0.1 * CONFIGURED, 0.1 * CONFIGURED),
        ('message', 10.0 * CONFIGURED, 10.0 * CONFIGURED),
        ('configuration', 0.1 * CONFIGURED, None),
        ('configuration', 10.0 * CONFIGURED, None),
        ('larger', 0.1 * CONFIGURED, None),
        ('larger', 10.0 * CONFIGURED, 10.0 * CONFIGURED),
    ],
)
def test_covariance_from(policy, carried, used):
    source = replace(scenario.build({}).sensors['position'], covariance_from=policy)
    data = WireWriter(SignalCodec(source.signal))(1, np.zeros(2), carried * np.eye(2))
    found = ReadingReader(source.signal).read(data, source).covariance
    if used is None:  # that of the configuration is to be used
        assert found is None
    else:
        np.testing.assert_allclose(found, used * np.eye(2))


def test_a_covariance_of_zeros_is_unknown():
    source = scenario.build({}).sensors['position']
    mixed = np.diag([0.0, 4.0])
    for carried, used in (
        (np.zeros((2, 2)), source.sensor.covariance),
        (mixed, np.diag([CONFIGURED, 4.0])),
        (np.array([[0.0, 0.1], [0.1, 4.0]]), np.array([[0.0, 0.1], [0.1, 4.0]])),  # nonsense
    ):
        data = WireWriter(SignalCodec(source.signal))(1, np.zeros(2), carried)
        found = ReadingReader(source.signal).read(data, source).covariance
        np.testing.assert_allclose(found, used)


def fix(latitude, covariance, kind=2, altitude=100.0):
    message = NavSatFix(latitude=latitude, longitude=20.0, altitude=altitude)
    message.status.status = 0
    message.position_covariance = list(np.ravel(covariance))
    message.position_covariance_type = kind
    return bytes(serialize_message(message))


@pytest.mark.parametrize(
    ('fields', 'covariance', 'altitude'),
    [
        (('east', 'north'), np.full(9, np.nan), 100.0),
        (('east', 'north'), np.full(9, -1.0), 100.0),
        (('east', 'north', 'up'), np.eye(3), np.nan),
    ],
)
def test_a_fix_that_cannot_be_used_is_no_datum(fields, covariance, altitude):
    source = scenario.build(
        {
            'model': 'constant_velocity' if len(fields) == 2 else 'robot_3d',
            'sensors': ['gnss'],
            'gnss.kind': 'states',
            'gnss.measures': ['x', 'y', 'z'][: len(fields)],
            'gnss.noise': [1.0] * len(fields),
            'gnss.type': 'sensor_msgs/NavSatFix',
            'gnss.fields': list(fields),
        }
    ).sensors['gnss']
    origin = Origin()
    read = ReadingReader(source.signal, origin).read
    read(fix(10.0, covariance, altitude=altitude), source)
    assert origin.plane is None
    found = read(fix(11.0, np.eye(3)), source)
    np.testing.assert_allclose(found.values, 0.0, atol=1e-9)
    assert origin.plane.datum == (11.0, 20.0, 100.0)
    read(fix(12.0, covariance, altitude=altitude), source)
    assert origin.plane.datum == (11.0, 20.0, 100.0)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'type': 'Odometry'}, "type: expected 'package/Name', got 'Odometry'"),
        ({'pose': 'differential', 'fields': ('twist.twist.linear.x',)}, 'pose: expected fields'),
    ],
)
def test_which_of_several_sensors_is_wrong_is_named(change, says):
    signal = Signal('wheels', 'nav_msgs/Odometry', ('pose.pose.position.x',))
    with pytest.raises(ValueError, match=f"^signal 'wheels': {says}"):
        ReadingReader(replace(signal, **change))


def stamped(stamp, offset, values=(0.0, 0.0)):
    """Return what is read from a position whose message has this stamp."""
    source = scenario.build({'position.stamp_offset': offset}).sensors['position']
    data = WireWriter(SignalCodec(source.signal))(stamp, np.array(values), 0.01 * np.eye(2))
    return ReadingReader(source.signal).read(data, source)


def test_an_offset_is_added_to_stamps():
    assert stamped(5_000_000_000, -0.1).time == 4_900_000_000
    assert stamped(5_000_000_000, 0.25).time == 5_250_000_000
    assert stamped(0, -0.1).time == 0  # no stamp


def test_an_offset_takes_messages_with_stamps():
    array = {'position.type': 'std_msgs/Float64MultiArray'}
    fields = {'position.fields': ['data[0]', 'data[1]']}
    built = scenario.build({**array, **fields, 'position.stamp_offset': 0.1})
    with pytest.raises(ValueError, match='stamp_offset: expected messages with a stamp'):
        ReadingReader(built.sensors['position'].signal)


@pytest.mark.parametrize(('stamp', 'read'), [(5_000_000_000, 4_300_000_000), (0, 0)])
def test_an_offset_is_added_to_stamps_of_the_input(stamp, read):
    signal = scenario.build({'input.stamp_offset': -0.7}).input
    data = WireWriter(SignalCodec(signal))(stamp, np.array([1.0, 2.0]))
    sample = InputReader(signal).read(data)
    assert (sample.time, sample.values.tolist()) == (read, [1.0, 2.0])
