# SPDX-License-Identifier: Apache-2.0
"""A recording is played whole, in order and at its pace; a viewer pauses, seeks and hurries it."""

import threading
import time

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from std_msgs.msg import Float64

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.live.bag_player import BagPlayer

SECOND = 10**9
COUNT = 21
DATA = bytes(serialize_message(Float64(data=1.0)))


class EndedError(Exception):
    """Ends a player."""


class Screen:
    """Notes what is played; one that has ended ends the player, unless it goes on."""

    def __init__(self):
        self.subscribed, self.messages, self.positions = set(), [], []
        self.looks, self.changed = 0, threading.Condition()
        self.stop = threading.Event()
        self.goes_on = False

    @property
    def wanted(self):
        with self.changed:
            self.looks += 1
            self.changed.notify_all()
        return self.subscribed

    def publish(self, topic, data, time):
        assert data == DATA
        with self.changed:
            self.messages.append((topic, time))
            self.changed.notify_all()

    def until(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, 10.0)

    def report(self, position):
        with self.changed:
            self.positions.append(position)
            self.changed.notify_all()
        if self.stop.is_set() or (position.ended and not self.goes_on):
            raise EndedError


class Waits(threading.Condition):
    """Says when it has been waited for several times, as a player that is paused does."""

    def __init__(self):
        super().__init__()
        self.count, self.several = 0, threading.Event()

    def wait(self, timeout=None):
        self.count += 1
        if self.count > 3:
            self.several.set()
        return super().wait(timeout)


@pytest.fixture
def bag(tmp_path):
    """Twenty-one messages in one second, and one of a type that is not installed."""
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/x', 'std_msgs/msg/Float64')
        writer.add('/strange', 'no_msgs/msg/Such')
        for index in range(COUNT):
            writer.write('/x', SECOND + index * SECOND // (COUNT - 1), DATA)
        writer.write('/strange', SECOND, b'1234')
    return Bag(tmp_path / 'bag')


def run(player, screen):
    def play():
        with pytest.raises(EndedError):
            player.run(screen)

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    return thread


@pytest.mark.slow
def test_it_waits_for_a_viewer_and_plays_all_at_the_pace_of_the_recording(bag):
    player, screen = BagPlayer(bag), Screen()
    assert player.topics == {'/x': 'std_msgs/msg/Float64'}
    assert player.refused == {'/strange': 'its type no_msgs/msg/Such is not installed'}
    thread = run(player, screen)
    screen.until(lambda: screen.looks > 3)
    assert screen.messages == []
    screen.subscribed = {'/x'}
    screen.until(lambda: screen.messages)
    start = time.monotonic()
    thread.join(10.0)
    assert time.monotonic() - start > 0.8
    times = [time for _, time in screen.messages]
    assert times == [SECOND + index * SECOND // (COUNT - 1) for index in range(COUNT)]
    assert screen.positions[-1].ended
    assert screen.positions[-1].time == 2 * SECOND


@pytest.mark.slow
def test_a_viewer_pauses_seeks_and_hurries(bag):
    player, screen = BagPlayer(bag), Screen()
    screen.subscribed, screen.goes_on = {'/x'}, True
    player._changed = Waits()
    assert not player.control(playing=False, speed=1.0, seek=None).playing
    thread = run(player, screen)
    assert player._changed.several.wait(10.0)
    assert screen.messages == []
    found = player.control(playing=True, speed=100.0, seek=SECOND + SECOND // 2)
    assert (found.time, found.speed, found.playing) == (SECOND + SECOND // 2, 100.0, True)
    screen.until(lambda: screen.positions and screen.positions[-1].ended)
    assert len(screen.messages) == COUNT // 2 + 1
    screen.messages.clear()
    # once it has ended, it starts again
    assert player.control(playing=True, speed=100.0, seek=None).time == SECOND
    screen.until(lambda: len(screen.messages) == COUNT)
    screen.stop.set()
    player.control(playing=True, speed=1.0, seek=None)
    thread.join(10.0)
    assert not thread.is_alive()


@pytest.mark.parametrize('speed', [0.0, -1.0, float('nan'), float('inf')])
def test_a_speed_that_is_none_leaves_it_as_it_was(bag, speed):
    player = BagPlayer(bag)
    assert player.control(playing=False, speed=speed, seek=10**18).speed == 1.0
    assert player.control(playing=False, speed=1e9, seek=-5) == (SECOND, 100.0, False, False)
