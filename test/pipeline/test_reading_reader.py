# SPDX-License-Identifier: Apache-2.0
"""Which covariance of a reading is used: that of the message, or that of the configuration."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Signal
from kalman_ros.pipeline.reading_reader import ReadingReader

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
    found = ReadingReader(source.signal)(data, source).covariance
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
        found = ReadingReader(source.signal)(data, source).covariance
        np.testing.assert_allclose(found, used)


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
    return ReadingReader(source.signal)(data, source)


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
