# SPDX-License-Identifier: Apache-2.0
"""Nodes go before other processes where the system permits it, and do without where not."""

import os
import resource
import subprocess
import sys
import threading

import pytest

from kalman_ros.nodes.middleware.priority import take_priority

#: Says whether it was permitted, and the policy and priority of each of its threads.
PROGRAM = """
import os, sys, threading
from kalman_ros.nodes.middleware.priority import take_priority
{before}
done = threading.Event()
threading.Thread(target=done.wait).start()
print(take_priority(20))
threading.Thread(target=done.wait).start()
for thread in threading.enumerate():
    number = thread.native_id
    print(os.sched_getscheduler(number), os.sched_getparam(number).sched_priority)
done.set()
"""


def said(before=''):
    program = PROGRAM.format(before=before)
    found = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert not found.stderr
    permitted, *threads = found.stdout.splitlines()
    return permitted == 'True', {tuple(map(int, each.split())) for each in threads}


@pytest.mark.slow
def test_every_thread_has_it_those_to_come_too():
    permitted, threads = said()
    if not permitted:
        pytest.skip('this user may not ask for real-time priority')
    assert threads == {(os.SCHED_FIFO, 20)}


@pytest.mark.slow
def test_without_permission_all_stays_as_it_was():
    give_up = 'os.setgid(65534); os.setuid(65534)'
    if os.getuid() != 0:
        if resource.getrlimit(resource.RLIMIT_RTPRIO)[0]:
            pytest.skip('this user may ask for real-time priority')
        give_up = ''
    permitted, threads = said(give_up)
    assert not permitted
    assert threads == {(os.SCHED_OTHER, 0)}


def test_a_system_that_knows_no_policies_is_no_trouble(monkeypatch):
    monkeypatch.delattr(os, 'sched_setscheduler')
    assert not take_priority(20)
    assert threading.active_count()
