# SPDX-License-Identifier: Apache-2.0
"""Recordings keep the order in which messages are handed over."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.nodes.middleware.reception import ReceptionTimes
from kalman_ros.nodes.middleware.watcher import waiting_with_times

SECOND = 1_000_000_000


def test_a_message_that_was_sent_again_delays_those_that_wait_for_it():
    received = ReceptionTimes()
    assert [received(time) for time in (10, 14, 11, 12, 15)] == [10, 14, 14, 14, 15]


def test_a_clock_that_goes_back_takes_the_times_with_it():
    received = ReceptionTimes()
    assert [received(time * SECOND) for time in (3600, 10, 11)] == [
        3600 * SECOND, 10 * SECOND, 11 * SECOND,
    ]  # fmt: skip


def test_a_recording_has_the_order_of_the_messages_that_were_taken(tmp_path):
    # the second was lost once: the third and the fourth were there before it
    times = [100, 400, 200, 300, 500]
    taken = iter(
        (
            str(number).encode(),
            {
                'received_timestamp': time * SECOND // 1000,
                'source_timestamp': number,
                'publication_sequence_number': number + 1,
            },
        )
        for number, time in enumerate(times)
    )
    subscription = SimpleNamespace(
        handle=SimpleNamespace(take_message=lambda *_: next(taken, None)),
        msg_type=None,
        qos_profile=SimpleNamespace(depth=10),
        losses=SimpleNamespace(numbered=lambda _: None),
        received=ReceptionTimes(),
    )
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/a', 'std_msgs/msg/String')
        for data, (received, published) in waiting_with_times(subscription):
            writer.write('/a', received, data, published)
    found = [message.data for message in Bag(tmp_path / 'bag').messages(['/a'])]
    assert found == [b'0', b'1', b'2', b'3', b'4']
