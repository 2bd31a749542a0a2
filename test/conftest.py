# SPDX-License-Identifier: Apache-2.0
"""Settings of all tests: which of them run, on which examples, and how reruns are reported."""

import os
import platform
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import nursery
import pytest
from hypothesis import settings

# messages of tests must stay on this machine
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# asked for by hand; processes that share the tests see it, too
os.environ.setdefault('KALMAN_ROS_TESTED', os.environ.get('KALMAN_ROS_ARITHMETIC', ''))
os.environ.setdefault('KALMAN_ROS_ARITHMETIC', 'numpy')

# asked by a process, once, as by h5py where a quick test may start none
platform.processor()

# the same examples each time where the tests decide, new ones each time by hand
settings.register_profile('fixed', derandomize=True, deadline=None, max_examples=50)
settings.register_profile('fresh', derandomize=False, deadline=None, max_examples=200)
settings.register_profile('quick', derandomize=False, deadline=None, max_examples=50)

SCENARIOS = Path(__file__).with_name('scenarios')
#: Marks of the tests that run only where they are named, or with ``--all``.
BY_HAND = {'thorough', 'real_time'}
#: What a thorough test may take, on a machine that others use, too.
THOROUGH_SECONDS = 1800


def pytest_addoption(parser):
    """Add the options that choose tests."""
    parser.addoption('--fast', action='store_true', help='only quick tests without processes')
    parser.addoption(
        '--all', action='store_true', help='also tests that are thorough or real_time'
    )


def left_out(config):
    """Return the marks whose tests do not run: whoever names tests gets all that are named."""
    options = config.option
    named = config.args_source is config.ArgsSource.ARGS or options.keyword or options.markexpr
    if options.fast:
        return BY_HAND | {'slow'}
    return set() if options.all or named else BY_HAND


def pytest_configure(config):
    """Choose the examples of hypothesis, unless the command line has chosen; quick tests first."""
    if left_out(config) == BY_HAND and not hasattr(config, 'workerinput'):
        config.pluginmanager.register(QuickFirst(config))
    if not config.getoption('hypothesis_profile', None):
        decides = left_out(config) == BY_HAND
        settings.load_profile('quick' if config.option.fast else 'fixed' if decides else 'fresh')


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Use all processors under colcon, whose users give pytest no arguments."""
    worker = hasattr(config, 'workerinput')
    if 'COLCON' in os.environ and not worker and getattr(config.option, 'numprocesses', 0) is None:
        config.option.numprocesses = 'auto'


#: Whether the test that runs is a quick one.
RUNNING = {'quick': False}


def refuse_process(event, _):
    """Fail where a quick test starts a process."""
    if RUNNING['quick'] and event in STARTS:
        raise RuntimeError(f'{event}: a quick test starts no process; mark it slow')


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark the tests that start processes, leave out what does not run, allow for reruns."""
    rerun = config.pluginmanager.hasplugin('rerunfailures')
    for item in items:
        if SCENARIOS in item.path.parents:
            item.add_marker('slow')
        # the machine may have been in the way
        if rerun and item.get_closest_marker('real_time'):
            item.add_marker(pytest.mark.flaky(reruns=1))
        if item.get_closest_marker('thorough') and not item.get_closest_marker('timeout'):
            item.add_marker(pytest.mark.timeout(THOROUGH_SECONDS))
    marks = left_out(config)
    deselected = [item for item in items if any(map(item.get_closest_marker, marks))]
    if deselected:
        config.hook.pytest_deselected(items=deselected)
        items[:] = [item for item in items if item not in set(deselected)]
    items.sort(key=is_slow)  # what fails is known as soon as possible
    sys.addaudithook(refuse_process)


def is_slow(item):
    """Return whether a test may start processes and take its time."""
    return any(map(item.get_closest_marker, ('slow', *BY_HAND)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Let no quick test start a process."""
    RUNNING['quick'] = not is_slow(item)
    yield
    RUNNING['quick'] = False


class QuickFirst:
    """Ends a run before the first slow test where a quick one has failed."""

    def __init__(self, config):
        self.config, self.failed = config, False

    def pytest_sessionstart(self, session):
        """Keep the session, which is asked to stop where there are no workers."""
        self.session = session

    def pytest_runtest_logreport(self, report):
        """Count failures of quick tests, and stop at the first report of another."""
        slow = 'slow' in report.keywords
        self.failed = self.failed or (report.failed and not slow)
        if slow and self.failed:
            runs = self.config.pluginmanager.getplugin('dsession') or self.session
            runs.shouldstop = 'a quick test failed: the slow ones did not run'


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Fork nodes where no process is the subject, which saves their imports.

    Quick tests compute by numpy: the same to the last bit whether CasADi is installed or not. Slow
    ones compute as users do, unless all tests run, which they do with either arithmetic.
    """
    usual = 'compiled' if is_slow(item) and not item.config.option.all else 'numpy'
    os.environ['KALMAN_ROS_ARITHMETIC'] = os.environ['KALMAN_ROS_TESTED'] or usual
    if item.get_closest_marker('slow') and find_spec('rclpy'):
        nursery.choose(any(map(item.get_closest_marker, ('executables', 'real_time'))))


#: What starts a process, by its audit event.
STARTS = ('subprocess.Popen', 'os.fork', 'os.forkpty', 'os.posix_spawn', 'os.system', 'os.exec')


def pytest_terminal_summary(terminalreporter):
    """Count the tests that were skipped by their reasons, and name each that was tried again."""
    skipped = (report.longrepr for report in terminalreporter.stats.get('skipped', []))
    reasons = Counter(str(why[2]).removeprefix('Skipped: ') for why in skipped if why)
    if reasons:
        terminalreporter.section('skipped')
    for reason, count in reasons.most_common():
        terminalreporter.line(f'{count:4}  {reason}')
    reruns = terminalreporter.stats.get('rerun', [])
    if reruns:
        terminalreporter.section(f'{len(reruns)} tried again')
    for report in reruns:
        cause = getattr(report.longrepr, 'reprcrash', report.longrepr)
        message = str(getattr(cause, 'message', cause)).partition('\n')[0]
        terminalreporter.line(f'{report.nodeid}: {message}')
