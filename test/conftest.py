# SPDX-License-Identifier: Apache-2.0
"""What all tests share: their domain, how widely they search, which are quick, and reruns."""

import json
import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# nothing that a test starts may be heard outside this machine
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

# continuous integration tries the same examples each time; a person tries other ones each time
settings.register_profile('fixed', derandomize=True, deadline=None, max_examples=100)
settings.register_profile('fresh', derandomize=False, deadline=None, max_examples=200)
settings.register_profile('quick', derandomize=False, deadline=None, max_examples=50)
settings.load_profile('fresh')

SCENARIOS = Path(__file__).with_name('scenarios')


def pytest_addoption(parser):
    """Add the options for a quick look, and for two processes side by side."""
    parser.addoption('--fast', action='store_true', help='leave out what is slow or in real time')
    parser.addoption('--part', choices=PARTS, help='of those that side_by_side.py runs')
    parser.addoption('--counts', type=Path, help='a file to write to how many tests did what')


def pytest_configure(config):
    """Hold the quick tests to their promise, and let them search for less long."""
    if config.getoption('fast'):
        sys.addaudithook(no_process)
        if not config.getoption('hypothesis_profile', None):
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
        keep(config, items, lambda item: not any(map(item.get_closest_marker, SLOW)))
    if part := config.getoption('part'):
        files = in_parts(items)
        keep(config, items, lambda item: item.path in files[part])


def in_parts(items):
    """Return the files of each part: those with nodes, and every other one of the rest."""
    nodes = {
        item.path
        for item in items
        if SCENARIOS in item.path.parents or item.get_closest_marker('real_time')
    }
    others = sorted({item.path for item in items} - nodes)
    return dict(zip(PARTS, (others[::2], others[1::2], nodes)))


def keep(config, items, wanted):
    """Leave out all items but those wanted."""
    left_out = [item for item in items if not wanted(item)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if wanted(item)]


#: The marks of what `--fast` leaves out.
SLOW = ('slow', 'real_time')
#: Of `side_by_side.py`.
PARTS = ('even', 'odd', 'nodes')
#: What starts a process, by its audit event.
STARTS = ('subprocess.Popen', 'os.fork', 'os.forkpty', 'os.posix_spawn', 'os.system', 'os.exec')


def pytest_terminal_summary(terminalreporter, config):
    """Name each test that was tried again, with the failure that the second try hid."""
    if file := config.getoption('counts'):
        stats = terminalreporter.stats
        file.write_text(json.dumps({name: len(found) for name, found in stats.items() if name}))
    reruns = terminalreporter.stats.get('rerun', [])
    if reruns:
        terminalreporter.section(f'{len(reruns)} tried again')
    for report in reruns:
        cause = getattr(report.longrepr, 'reprcrash', report.longrepr)
        message = str(getattr(cause, 'message', cause)).partition('\n')[0]
        terminalreporter.line(f'{report.nodeid}: {message}')
