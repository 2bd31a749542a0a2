# SPDX-License-Identifier: Apache-2.0
"""Message types by name, their stamps, and bytes that are no message."""

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from kalman_ros.codecs import messages
from kalman_ros.codecs.messages import UndecodableError, decode, full_type, nanoseconds, stamp_of


def test_what_was_serialised_is_decoded():
    header = Header(stamp=Time(sec=3, nanosec=4), frame_id='map')
    assert decode(serialize_message(header), Header) == header


def test_failures_are_logged_once_a_second(monkeypatch):
    """The first of each second in which there are any; those until its end are silent."""
    now, silenced = [0.0], []

    class Silence:
        def __enter__(self):
            silenced.append(now[0])

        def __exit__(self, *_):
            pass

    monkeypatch.setattr(messages, 'monotonic', lambda: now[0])
    monkeypatch.setattr(messages, '_failed', -1.0)
    monkeypatch.setattr(messages, '_Silence', Silence)
    times = [100.0, 100.1, 100.9, 101.0, 101.5, 101.99, 102.1]
    for now[0] in times:
        with pytest.raises(UndecodableError, match='2 bytes are no Header'):
            decode(b'\x00\x01', Header)
    assert silenced == [100.1, 100.9, 101.5, 101.99]


def test_stamps_are_whole_nanoseconds():
    assert nanoseconds(Time(sec=2, nanosec=999_999_999)) == 2_999_999_999
    assert nanoseconds(Time(sec=-1, nanosec=1)) == -999_999_999
    header = Header(stamp=Time(sec=1, nanosec=5))
    assert stamp_of(header) is None
    assert stamp_of(type('Stamped', (), {'header': header})()) == 1_000_000_005


def test_a_type_has_a_long_name_and_a_short_one():
    assert (
        full_type('std_msgs/Header') == full_type('std_msgs/msg/Header') == 'std_msgs/msg/Header'
    )
    for name in ('std_msgs/Header', 'std_msgs/msg/Header'):
        assert messages.message_type(name) is Header


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('Header', "type: expected 'package/Name', got 'Header'"),
        ('std_msgs/', "type: expected 'package/Name', got 'std_msgs/'"),
        ('std msgs/Header', "type: expected 'package/Name'"),
        ('no_such_msgs/Header', "type: the message package 'no_such_msgs' is not installed"),
        ('std_msgs/Haeder', "type: the package 'std_msgs' has no message 'Haeder'"),
    ],
)
def test_what_is_no_type_is_refused(name, reason):
    with pytest.raises(ValueError, match=f'^{reason}'):
        messages.message_type(name)


@pytest.mark.parametrize(
    ('type', 'has'), [('std_msgs/Float64', False), ('sensor_msgs/msg/Range', True)]
)
def test_a_type_has_a_header_or_not(type, has):
    assert messages.has_header(type) is has
