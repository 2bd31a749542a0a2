# SPDX-License-Identifier: Apache-2.0
"""Work beside a loop: the newest job counts, whatever becomes of the others."""

from threading import Event
from time import monotonic, sleep

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.controller import newest_job
from kalman_ros.nodes.controller.newest_job import NewestJob


def result_of(jobs):
    end = monotonic() + 60.0
    while monotonic() < end:
        result = jobs.take()
        if result is not None:
            return result
        sleep(0.001)
    raise AssertionError('no result')


def gated(result):
    """Return what prepares a job, and the events that it has started and may end."""
    started, go = Event(), Event()

    def job(interrupt):
        started.set()
        go.wait(60.0)
        interrupt()
        return result

    return (lambda: job), started, go


def test_a_result_is_delivered_and_then_that_of_the_newest_job_that_waited():
    jobs, (first, started, go) = NewestJob(waits=False), gated('first')
    jobs.start(first)
    assert started.wait(60.0)
    jobs.start(lambda: lambda _: 'second')
    jobs.start(lambda: lambda _: 'third')
    assert jobs.take() is None and jobs.is_waiting
    go.set()
    assert result_of(jobs) == 'first'
    assert result_of(jobs) == 'third'
    assert jobs.take() is None and not jobs.is_waiting


def test_a_job_is_prepared_once_the_result_before_it_was_taken():
    jobs, (first, _, go) = NewestJob(waits=False), gated('first')
    taken = []
    jobs.start(first)
    jobs.start(lambda: (lambda before: lambda _: before)([*taken]))
    go.set()
    taken.append(result_of(jobs))
    assert result_of(jobs) == ['first']
    assert jobs.took >= 0.0


def test_a_long_job_is_given_up_for_a_newer_one_and_not_without(monkeypatch):
    monkeypatch.setattr(newest_job, '_PATIENCE', 0.0)
    for newer in (False, True):
        jobs, (first, started, go) = NewestJob(waits=False), gated('first')
        jobs.start(first)
        assert started.wait(60.0)
        if newer:
            jobs.start(lambda: lambda _: 'second')
        go.set()
        assert result_of(jobs) == ('second' if newer else 'first')


def test_of_two_long_jobs_in_a_row_the_second_is_not_given_up(monkeypatch):
    monkeypatch.setattr(newest_job, '_PATIENCE', 0.0)
    jobs, (first, started, go) = NewestJob(waits=False), gated('first')
    second, second_started, second_go = gated('second')
    jobs.start(first)
    assert started.wait(60.0)
    jobs.start(second)
    go.set()
    end = monotonic() + 60.0
    while not second_started.wait(0.001) and monotonic() < end:
        assert jobs.take() is None  # the first was given up
    jobs.start(lambda: lambda _: 'third')
    second_go.set()
    assert result_of(jobs) == 'second'
    assert result_of(jobs) == 'third'


def test_what_is_forgotten_has_no_result():
    jobs, (first, started, go) = NewestJob(waits=False), gated('first')
    jobs.start(first)
    assert started.wait(60.0)
    jobs.forget()
    jobs.start(lambda: lambda _: 'second')
    go.set()
    assert result_of(jobs) == 'second'


@pytest.mark.parametrize('error', [ZeroDivisionError, SystemExit, KeyboardInterrupt])
def test_an_error_is_a_result_and_the_next_job_is_done(error):
    def fail(_):
        raise error('why')

    jobs = NewestJob(waits=False)
    jobs.start(lambda: fail)
    assert 'why' in str(result_of(jobs))
    jobs.start(lambda: lambda _: 'next')
    assert result_of(jobs) == 'next'


def test_in_lockstep_the_caller_waits():
    jobs = NewestJob(waits=True)
    jobs.start(lambda: lambda _: 'done')
    assert jobs.take() == 'done'
    assert jobs.take() is None
