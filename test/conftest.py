# SPDX-License-Identifier: Apache-2.0
"""Settings of all tests: discovery range, hypothesis profiles, `--fast` and reruns."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# messages of tests must stay on this machine
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

# the same examples each time in continuous integration, new ones each time by hand
settings.register_profile('fixed', derandomize=True, deadline=None, max_examples=100)
settings.register_profile('fresh', derandomize=False, deadline=None, max_examples=200)
settings.register_profile('quick', derandomize=False, deadline=None, max_examples=50)
settings.load_profile('fresh')

SCENARIOS = Path(__file__).with_name('scenarios')


def pytest_addoption(parser):
    """Add the option for the inner loop."""
    parser.addoption('--fast', action='store_true', help='leave out what is slow or in real time')


def pytest_configure(config):
    """Let the quick tests search for less long."""
    if config.getoption('fast') and not config.getoption('hypothesis_profile', None):
        settings.load_profile('quick')


def no_process(event, _):
    """Refuse to start one."""
    if event in STARTS:
        raise RuntimeError(f'{event}: --fast starts no process; mark the test slow')


def pytest_collection_modifyitems(config, items):
    """Mark the tests that start processes, leave out what is not fast, and allow for reruns."""
    for item in items:
        if SCENARIOS in item.path.parents:
            item.add_marker(pytest.mark.slow)
        # the machine may have been in the way
        if item.get_closest_marker('real_time') and config.pluginmanager.hasplugin(
            'rerunfailures'
        ):
            item.add_marker(pytest.mark.flaky(reruns=1))
    if config.getoption('fast'):
        slow = [item for item in items if any(map(item.get_closest_marker, SLOW))]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in slow]
        sys.addaudithook(no_process)


#: The marks of what `--fast` leaves out.
SLOW = ('slow', 'real_time')
#: What starts a process, by its audit event.
STARTS = ('subprocess.Popen', 'os.fork', 'os.forkpty', 'os.posix_spawn', 'os.system', 'os.exec')


def pytest_terminal_summary(terminalreporter):
    """Name each test that was tried again, with the failure that the second try hid."""
    reruns = terminalreporter.stats.get('rerun', [])
    if reruns:
        terminalreporter.section(f'{len(reruns)} tried again')
    for report in reruns:
        cause = getattr(report.longrepr, 'reprcrash', report.longrepr)
        message = str(getattr(cause, 'message', cause)).partition('\n')[0]
        terminalreporter.line(f'{report.nodeid}: {message}')
