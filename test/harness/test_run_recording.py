# SPDX-License-Identifier: Apache-2.0
"""A recording of a run is written where an error ends the program in one line."""

import errno
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from std_msgs.msg import Float64

from kalman_ros import entry
from kalman_ros.bags.mcap_writer import McapWriter
from kalman_ros.bags.reading import Bag
from kalman_ros.harness import run_recording
from kalman_ros.harness.run_recording import RunRecording
from kalman_ros.programs import demo


def recording(folder):
    """Return a recording with one topic."""
    made = RunRecording(SimpleNamespace(times=(1, 1)), folder)
    made.add(SimpleNamespace(msg_type=Float64, topic_name='/t'))
    return made


def fill_disk(monkeypatch):
    def put(*_):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(McapWriter, '_put', put)


def test_what_receives_a_message_does_not_write_it(tmp_path, monkeypatch):
    """An exception in a callback makes rclpy log a traceback."""
    monkeypatch.setattr(run_recording, '_PERIOD', -1.0)
    made = recording(tmp_path)
    made.write('/t', bytes(12))
    made.flush()
    assert len([*Bag(tmp_path).messages({'/t'})]) == 1
    fill_disk(monkeypatch)
    made.write('/t', bytes(12))
    with pytest.raises(OSError, match='No space left'):
        made.flush()


def test_between_two_writes_there_is_a_while(tmp_path, monkeypatch):
    made = recording(tmp_path)
    fill_disk(monkeypatch)
    made.write('/t', bytes(12))
    made.flush()


def test_a_program_on_a_full_disk_ends_in_one_line(tmp_path, monkeypatch):
    def perform(*_):
        made = recording(tmp_path)
        try:
            fill_disk(monkeypatch)
            made.write('/t', bytes(12))
        finally:
            made.close()

    monkeypatch.setattr(demo, 'perform', perform)
    monkeypatch.setattr('sys.argv', ['demo', 'level'])
    monkeypatch.setattr(entry.signal, 'signal', lambda *_: None)
    with pytest.raises(SystemExit) as caught:
        entry.demo()
    assert caught.value.code == 'demo: cannot write: No space left on device'
