# SPDX-License-Identifier: Apache-2.0
"""What all tests share: their domain, how widely they search, which are quick, and reruns."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# nothing that a test starts may be heard outside this machine
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

# continuous integration tries the same examples each time; a person tries other ones each time
settings.register_profile('fixed', derandomize=True, deadline=None, max_examples=100)
settings.register_profile('fresh', derandomize=False, deadline=None, max_examples=200)
settings.load_profile('fresh')

SCENARIOS = Path(__file__).with_name('scenarios')


def pytest_addoption(parser):
    """Add the option for a quick look."""
    parser.addoption('--fast', action='store_true', help='leave out what is slow or in real time')


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
        left_out = [item for item in items if any(map(item.get_closest_marker, SLOW))]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


#: The marks of what `--fast` leaves out.
SLOW = ('slow', 'real_time')


def pytest_terminal_summary(terminalreporter):
    """Name each test that was tried again, with the failure that the second try hid."""
    reruns = terminalreporter.stats.get('rerun', [])
    if reruns:
        terminalreporter.section(f'{len(reruns)} tried again')
    for report in reruns:
        cause = getattr(report.longrepr, 'reprcrash', report.longrepr)
        message = str(getattr(cause, 'message', cause)).partition('\n')[0]
        terminalreporter.line(f'{report.nodeid}: {message}')
