# SPDX-License-Identifier: Apache-2.0
"""The live page without a browser: the real nodes, and a tab that speaks the page's protocol."""

import json
import os
import signal
import socket
import subprocess
import time
from contextlib import suppress
from itertools import pairwise

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('websockets')

from websockets.sync.client import connect

from kalman_ros.harness import executables

pytestmark = pytest.mark.real_time


class Page:
    """A live page and one tab of it."""

    def __init__(self, *arguments):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]
        command = [str(executables.executable('live')), '--no-browser', '--port', str(self.port)]
        self.process = subprocess.Popen(
            [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        self.sections, self.frames, self.count = {}, [], 0

    def __enter__(self):
        line = self.process.stdout.readline()
        assert f':{self.port}/' in line, line + self.process.stdout.read()
        self.tab = self.open()
        return self

    def open(self):
        origin = f'http://127.0.0.1:{self.port}'
        # without a limit: messages that nobody reads yet must not hold back the answers to pings
        return connect(
            f'ws://127.0.0.1:{self.port}/socket', origin=origin, max_size=None, max_queue=None,
            proxy=None,
        )  # fmt: skip

    def __exit__(self, *_):
        self.tab.close()
        os.killpg(self.process.pid, signal.SIGTERM)
        try:
            self.rest, _ = self.process.communicate(timeout=20)
        finally:
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)

    def until(self, condition, seconds=40):
        """Read messages until a condition on a frame or a section holds; return that one."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            message = json.loads(self.tab.recv(timeout=max(0.1, end - time.monotonic())))
            if message['kind'] == 'frames':
                found = message['frames']
                self.frames += found
            else:
                self.sections[message['kind']] = message
                found = [message]
            for each in found:
                if condition(each):
                    return each
        raise AssertionError('it did not happen')

    def do(self, **command):
        """Send a command and return its answer."""
        self.count += 1
        self.tab.send(json.dumps({**command, 'n': self.count}))
        return self.until(lambda m: m.get('answer', {}).get('n') == self.count)['answer']

    def node(self, name):
        """Return the number of the process of a node."""
        program = str(executables.executable(name))
        children = subprocess.run(
            ['pgrep', '-f', program, '-P', str(self.process.pid)], capture_output=True, text=True
        ).stdout.split()
        assert len(children) == 1
        return int(children[0])

    def until_no_more(self, part, period=0.5, seconds=20):
        """Read messages until a period has no frame with a part."""
        end = time.monotonic() + seconds
        last = time.monotonic()
        while time.monotonic() < last + period:
            assert time.monotonic() < end, f'{part} does not cease'
            with suppress(TimeoutError):
                message = json.loads(self.tab.recv(timeout=0.1))
                if any(part in frame for frame in message.get('frames', ())):
                    last = time.monotonic()

    def seen(self, kind, test, seconds=40):
        held = self.sections.get(kind)
        if held is not None and test(held):
            return held
        return self.until(lambda m: m.get('kind') == kind and test(m), seconds)

    def framed(self, test):
        return next(filter(test, self.frames), None) or self.until(test)


def std_of_position(frame):
    return frame['estimate'][-1][3] if 'estimate' in frame else None


def test_a_tab_sees_the_loop_and_changes_it():
    with Page('mass_spring_damper') as page:
        first = page.until(lambda m: 'estimate' in m and 'truth' in m and 'readings' in m)
        assert all(len(row) == 1 + 2 + 2 + 1 for row in first['estimate'])
        settled = page.until(lambda m: 'estimate' in m and m['estimate'][-1][0] > 2.0)
        before = page.seen('theory', lambda m: m.get('regulator'))

        # a weight: the gain of the running controller is that of the theory
        assert page.do(do='set', key='controller/state_cost/0', value=400.0)['error'] == ''
        after = page.seen(
            'theory', lambda m: m['regulator']['gain'] != before['regulator']['gain']
        )
        page.seen('theory', lambda m: m['version'] == page.sections['values']['version'])
        gain = after['regulator']['gain'][0][0]
        shown = page.seen('status', lambda m: m['gain'] and f'{gain:.3f}' in m['gain'])
        assert shown['nodes']['controller']['message'] == 'running'
        page.framed(lambda m: m.get('latency', {}).get('ms'))

        # believed noise: the estimator's deviation grows, the readings stay as they are
        assert page.do(do='set', key='estimator/position.noise/0', value=2.0)['error'] == ''
        wide = 2.0 * std_of_position(settled)
        page.until(lambda m: 'estimate' in m and std_of_position(m) > wide)

        # a push
        assert page.do(do='push', input=0, share=5.0)['error'] == ''
        page.until(lambda m: 'truth' in m and abs(m['truth'][-1][2]) > 0.8)

        # what is refused changes nothing
        for command, why in (
            ({'do': 'set', 'key': 'plant/model', 'value': 1.0}, 'unknown control'),
            ({'do': 'set', 'key': 'plant/position.rate', 'value': 0.0}, 'position.rate'),
            ({'do': 'choose', 'what': 'filter', 'value': 'os:system'}, 'unknown filter'),
            ({'do': 'choose', 'what': 'model', 'value': 'x'}, 'choose: expected'),
            ({'do': 'poles', 'poles': [[1.0, 0.0]]}, 'regulator_poles: expected at most'),
            ({'do': 'push', 'input': 7}, 'push: expected'),
            ({'do': 'push', 'input': 0.0}, 'push: input cannot be'),
            ({'do': 'push', 'input': True}, 'push: input cannot be'),
            ({'do': 'speed', 'value': 1e9}, 'speed: expected'),
            ({'do': 'nonsense'}, 'unknown command'),
        ):
            assert why in page.do(**command)['error']

        # two tabs see the same values
        page.do(do='set', key='plant/actuator_gain/0', value=1.5)
        other = page.open()
        found = {}
        while '[1.5]' not in found.get('share', {}).get('yaml', ''):
            message = json.loads(other.recv(timeout=20))
            found[message['kind']] = message
        assert found['values']['values']['plant/actuator_gain/0'] == 1.5
        other.close()
    assert page.process.returncode == 128 + signal.SIGTERM
    assert 'Traceback' not in page.rest


def test_pause_poles_filter_and_single_steps():
    with Page('mass_spring_damper') as page:
        page.until(lambda m: 'estimate' in m and m['estimate'][-1][0] > 1.0)
        assert page.do(do='poles', of='regulator', poles=[[-3, 2], [-3, -2]])['error'] == ''
        placed = [[-3.0, -2.0], [-3.0, 2.0]]
        page.seen('theory', lambda m: m['regulator']['poles'] == placed)
        page.seen('values', lambda m: m['chosen']['law'] == 'placement')
        assert page.do(do='choose', what='filter', value='ukf')['error'] == ''
        page.until(lambda m: 'estimate' in m)

        page.do(do='pause')
        page.seen('status', lambda m: m['paused'])
        page.until_no_more('truth')
        page.frames.clear()
        page.do(do='resume')
        page.until(lambda m: 'truth' in m)

        # one at a time: predict, then update
        page.frames.clear()
        page.do(do='step')
        page.seen('status', lambda m: m['lockstep'] and m['paused'] and not m['message'])
        page.framed(lambda m: 'estimate' in m and m['estimate'][0][0] == 0.0)
        times = []
        for _ in range(6):
            page.frames.clear()
            page.do(do='step')
            prior = page.framed(lambda m: 'prior' in m)['prior']
            assert not any('estimate' in frame for frame in page.frames)
            page.do(do='step')
            found = page.framed(lambda m: 'estimate' in m)
            assert len(found['estimate']) == 1
            times.append(found['estimate'][0][0])
            if 'readings' in found:
                assert all(p <= q for p, q in zip(found['estimate'][0][3:5], prior['std']))
        assert [round(100 * (b - a)) for a, b in pairwise(times)] == [1] * 5


def test_frames_go_on_while_a_command_waits_for_a_node():
    with Page('mass_spring_damper') as page:
        first = page.until(lambda m: 'truth' in m and m['truth'][-1][0] > 1.0)['truth'][-1][0]
        estimator = page.node('estimator')
        change = {'do': 'set', 'key': 'estimator/position.noise/0', 'value': 0.1, 'n': 1}
        os.kill(estimator, signal.SIGSTOP)
        try:
            page.frames.clear()
            page.tab.send(json.dumps(change))
            page.until(lambda m: 'truth' in m and m['truth'][-1][0] > first + 1.0)
            assert not any('answer' in frame for frame in page.frames)
        finally:
            os.kill(estimator, signal.SIGCONT)
        assert page.framed(lambda m: 'answer' in m)['answer']['error'] == ''
        rows = [row[0] for frame in page.frames for row in frame.get('truth', ())]
        assert max(b - a for a, b in pairwise(rows)) < 0.2


@pytest.mark.parametrize('name', ['cart_pole', 'two_bearings', 'submersible', 'sound_tracker'])
def test_a_scenario_moves(name):
    with Page(name) as page:
        page.until(lambda m: 'estimate' in m and m['estimate'][-1][0] > 1.0)
        page.until(lambda m: 'readings' in m)
        assert set(page.sections['scene']['sensors']) >= set(page.frames[-1].get('readings', ()))


def test_the_law_changes_while_the_system_is_pushed():
    poles = [[-2.6, 0.0], [-4.0, 0.0], [-5.5, 0.0], [-7.0, 0.0]]
    with Page('cart_pole') as page:
        page.until(lambda m: 'truth' in m and m['truth'][-1][0] > 2.0)
        page.frames.clear()
        changes = [{'do': 'choose', 'what': 'law', 'value': law} for law in ('mpc', 'lqi', 'lqr')]
        for k, change in enumerate(changes * 2):
            for command in (change, {'do': 'poles', 'of': 'regulator', 'poles': poles}):
                page.tab.send(f'{{"do": "push", "share": {0.2 * (-1) ** k}}}')
                assert page.do(**command)['error'] == ''
                begin = page.until(lambda m: 'truth' in m)['truth'][-1][0]
                page.until(lambda m: 'truth' in m and m['truth'][-1][0] > begin + 0.6)  # noqa: B023
        leans = [abs(row[3]) for frame in page.frames for row in frame.get('truth', ())]
    assert 0.05 < max(leans) < 0.8


def test_a_node_that_dies_is_reported_and_started_again():
    with Page('mass_spring_damper') as page:
        page.until(lambda m: 'estimate' in m)
        os.kill(page.node('estimator'), signal.SIGKILL)
        assert 'estimator died' in page.seen('status', lambda m: m['failed'])['message']
        page.tab.send('{"do": "restart"}')
        page.seen('scene', lambda m: m['run'] == 2)
        page.until(lambda m: 'estimate' in m)


@pytest.mark.parametrize(
    'arguments, why',
    [
        (['mass_sprin_damper'], "unknown scenario 'mass_sprin_damper'; did you mean"),
        (['--listen', 'here'], "--listen: expected an IP address, got 'here'"),
        (['--port', '0'], '--port: expected 1 to 65535, got 0'),
        (['-p', 'state_cost:=[1.0]'], 'state_cost'),
        (['-p', 'nonsense:=1'], "unknown parameter 'nonsense'"),
    ],
)
def test_a_mistake_is_one_line(arguments, why):
    command = [str(executables.executable('live')), '--no-browser', *arguments]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert found.returncode == 2
    assert why in found.stderr
    assert found.stderr.count('\n') == 1 and found.stderr.startswith('live: ')
