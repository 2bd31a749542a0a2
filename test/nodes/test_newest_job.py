# SPDX-License-Identifier: Apache-2.0
"""Work beside a loop: the newest job counts, whatever becomes of the others."""

from threading import Event
from time import monotonic, sleep

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.controller.newest_job import NewestJob


def result_of(jobs):
    end = monotonic() + 60.0
    while monotonic() < end:
        result = jobs.take()
        if result is not None:
            return result
        sleep(0.001)
    raise AssertionError('no result')


def test_the_newest_job_counts_and_its_result_is_taken_once():
    jobs, started, go = NewestJob(waits=False), Event(), Event()

    def first():
        started.set()
        go.wait(60.0)
        return 'first'

    jobs.start(first)
    assert started.wait(60.0)
    jobs.start(lambda: 'second')
    jobs.start(lambda: 'third')
    assert jobs.take() is None
    go.set()
    assert result_of(jobs) == 'third'
    assert jobs.take() is None
    jobs.start(lambda: 'fourth')
    assert result_of(jobs) == 'fourth'


def test_an_error_is_a_result():
    jobs = NewestJob(waits=False)
    jobs.start(lambda: 1 / 0)
    assert isinstance(result_of(jobs), ZeroDivisionError)


def test_in_lockstep_the_caller_waits():
    jobs = NewestJob(waits=True)
    jobs.start(lambda: 'done')
    assert jobs.take() == 'done'
    assert jobs.take() is None
