# SPDX-License-Identifier: Apache-2.0
"""A signal ends a process at once, or the caller does where it has said so."""

import signal
from threading import Event

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware.interruption import ENDING, Interruption


@pytest.fixture
def interruption():
    """What takes the signals of this process; they are given back afterwards."""
    handlers = {number: signal.getsignal(number) for number in ENDING}
    before = signal.set_wakeup_fd(-1)
    found = Interruption()
    yield found
    signal.set_wakeup_fd(before)
    for number, handler in handlers.items():
        signal.signal(number, handler)
    found._wake.send(bytes([signal.SIGUSR1]))  # its thread may still wait for one
    found._wake.close()


def asked(interruption):
    """Return whether the end is asked for within some seconds."""
    ended = Event()
    interruption.asked.add_done_callback(lambda _: ended.set())
    return ended.wait(10.0)


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_ends_the_process_at_once_and_further_ones_do_nothing(interruption, number):
    with pytest.raises(SystemExit):
        signal.raise_signal(number)
    signal.raise_signal(number)
    signal.raise_signal(signal.SIGALRM)
    assert asked(interruption)


def test_who_defers_it_is_asked_to_end_and_goes_on_until_then(interruption):
    interruption.defer()
    assert not interruption.asked.done()
    signal.raise_signal(signal.SIGTERM)
    assert asked(interruption)
    signal.raise_signal(signal.SIGTERM)  # impatience ends nothing sooner


def test_who_defers_it_after_a_signal_ends_at_once(interruption):
    with pytest.raises(SystemExit):
        signal.raise_signal(signal.SIGTERM)
    assert asked(interruption)
    with pytest.raises(SystemExit):
        interruption.defer()
