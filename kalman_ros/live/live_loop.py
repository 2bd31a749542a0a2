# SPDX-License-Identifier: Apache-2.0
"""Runs the nodes of a live page: their topics to the board, commands to the nodes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.core.one_line import one_line
from kalman_ros.harness import NodeError
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from .adjustments import Adjustments
from .board import Board
from .controls import controls
from .live_nodes import FOREVER, LiveNodes
from .scene import force_scale, scene
from .share import parameter_file
from .streams import Streams
from .theory_worker import TheoryWorker

#: Seconds between two frames, two looks at the commands, two status reports, and two
#: computations of poles, margins and costs.
_FRAME, _LOOK, _STATUS, _CHANGES = 0.05, 0.01, 0.5, 0.1
#: Seconds that a push lasts.
_PUSH = 0.2
#: Simulated seconds a second, in lockstep.
_SLOWEST, _FASTEST = 1e-3, 200.0


@dataclass
class Pace:
    """How the time of the loop passes."""

    lockstep: bool = False
    paused: bool = False
    #: In lockstep: simulated seconds a second.
    speed: float = 1.0
    #: In lockstep: the simulated time to go to.
    target: float = 0.0
    #: In lockstep, paused: whether the prediction of the next step is shown.
    predicted: bool = False


class LiveLoop:
    """The loop behind a page; `run` returns when ``stop`` is called.

    Parameters
    ----------
    file
        A parameter file.
    parameters
        For every node, over those of the file.
    seed
        Of all noise.
    board
        What the tabs show.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """

    def __init__(self, file: Path, parameters: Mapping[str, Any], seed: int, board: Board) -> None:
        self._adjustments = Adjustments(file, parameters)
        self._seed, self._board = seed, board
        self._commands: SimpleQueue[tuple[dict[str, Any], float]] = SimpleQueue()
        self._controls = controls(self._adjustments)
        self._scale = force_scale(self._adjustments)
        self._pace = _usual_pace(self._adjustments)
        self._carried: dict[str, dict[str, Any]] = {}
        self._stopped = self._restart = self._news = False
        self._runs = 0
        self._push_end: float | None = None
        self._asked: tuple[int, float] | None = None
        self._latency: dict[str, Any] = {}
        self._theory = TheoryWorker(lambda found: board.put('theory', found))
        self._do: dict[str, Callable[[LiveNodes, dict[str, Any], float], None]] = {
            'set': self._set,
            'choose': self._choose,
            'poles': self._poles,
            'push': self._on_push,
            'reset': self._reset,
            'pause': self._pause,
            'resume': self._resume,
            'step': self._step,
            'mode': self._mode,
            'speed': self._speed,
            'restart': self._on_restart,
        }

    def command(self, command: dict[str, Any], arrival: float) -> None:
        """Queue a command from a tab; any thread may call this."""
        self._commands.put((command, arrival))

    def stop(self) -> None:
        """End `run` soon."""
        self._stopped = True

    def run(self) -> None:
        """Run the nodes until `stop`; one that dies is reported, and all start again on request.

        Raises
        ------
        NodeError
            If they cannot be started at first.
        """
        with self._theory:
            while not self._stopped:
                self._announce('starting the nodes')
                try:
                    with self._nodes() as nodes:
                        self._serve(nodes)
                except NodeError as error:
                    if not self._runs:
                        raise
                    self._announce(one_line(str(error)), failed=True)
                    self._carried = {}
                    self._until_restart()

    def _nodes(self) -> LiveNodes:
        found, carried = self._adjustments, self._carried
        only = {
            node: {**found.changes.get(node, {}), **carried.get(node, {})}
            for node in {*found.changes, *carried}
            if node != 'controller' or found.driven
        }
        shared = {**found.shared, 'seed': self._seed}
        return LiveNodes(found.file, shared, only, lockstep=self._pace.lockstep)

    def _serve(self, nodes: LiveNodes) -> None:
        """Pass topics and commands on until `stop`, or until the nodes must restart."""
        self._runs += 1
        self._restart, self._push_end, self._pace.target = False, None, 0.0
        self._streams = Streams(nodes.scenario)
        nodes.on_input = self._on_input
        self._changed()
        self._board.clear()
        self._board.put('scene', {**scene(self._adjustments, self._controls), 'run': self._runs})
        if not self._pace.paused or self._pace.lockstep:
            nodes.run_until(0.0 if self._pace.lockstep else FOREVER)
        framed = reported = changed = 0.0
        while not (self._stopped or self._restart):
            nodes.spin(_LOOK)
            self._obey(nodes)
            now = monotonic()
            if now - framed >= _FRAME:
                self._advance(nodes, min(now - framed, 4 * _FRAME))
                self._frame(nodes)
                framed = now
            if self._news and now - changed >= _CHANGES:
                self._changed()
                changed = now
            if now - reported >= _STATUS:
                self._report(nodes)
                reported = now

    def _frame(self, nodes: LiveNodes) -> None:
        samples = nodes.take()
        if self._push_end is not None and self._time() >= self._push_end:
            nodes.push(np.zeros(nodes.scenario.model.input.size))
            self._push_end = None
        frame = self._streams.frame(samples, self._believed, self._weight)
        if frame is not None:
            self._board.add(frame)

    def _on_input(self) -> None:
        """Record how long after a command the first input by the new parameters was received."""
        if self._asked is not None:
            number, arrival = self._asked
            self._latency = {'n': number, 'ms': round(1e3 * (monotonic() - arrival), 1)}
            self._board.add({'latency': self._latency})
            self._asked = None

    def _time(self) -> float:
        """Return the time by which a push ends: simulated in lockstep."""
        return self._streams.elapsed if self._pace.lockstep else monotonic()

    def _advance(self, nodes: LiveNodes, seconds: float) -> None:
        """In lockstep, let the plant go on by the speed."""
        pace = self._pace
        if not pace.lockstep or pace.paused:
            return
        most = self._streams.elapsed + max(0.25 * pace.speed, 2.0 / nodes.scenario.rate)
        pace.target = min(max(pace.target, self._streams.elapsed) + seconds * pace.speed, most)
        nodes.run_until(pace.target)

    def _report(self, nodes: LiveNodes) -> None:
        pace = self._pace
        self._board.put('status', {
            'run': self._runs, 'lockstep': pace.lockstep, 'paused': pace.paused,
            'speed': pace.speed, 'failed': False, 'message': '',
            'missed': nodes.reported('plant', 'missed steps'),
            'gain': nodes.reported('controller', 'gain'),
            'latency': self._latency,
            'nodes': {
                name: {'level': int.from_bytes(status.level, 'big'), 'message': status.message}
                for name, status in sorted(nodes.diagnostics.items())
            },
        })  # fmt: skip

    def _announce(self, message: str, *, failed: bool = False) -> None:
        pace = self._pace
        self._board.put('status', {
            'run': self._runs, 'lockstep': pace.lockstep, 'paused': pace.paused,
            'speed': pace.speed, 'failed': failed, 'message': message, 'nodes': {},
        })  # fmt: skip

    def _until_restart(self) -> None:
        while not self._stopped:
            try:
                command, _ = self._commands.get(timeout=0.2)
            except Empty:
                continue
            if command.get('do') == 'restart':
                return

    def _changed(self) -> None:
        """Show the parameters in use, and compute the theory of them."""
        self._news = False
        found = self._adjustments
        self._believed: Scenario = found.scenario('estimator')
        self._weight: Array | None = None
        if found.driven:
            self._weight = price(found.scenario('controller')).weight
        self._board.put('values', {
            'values': {key: control.read(found) for key, control in self._controls.items()},
            'chosen': {
                'filter': found.value('estimator', 'filter'),
                **({'law': found.value('controller', 'law')} if found.driven else {}),
            },
        })  # fmt: skip
        self._board.put('share', {'yaml': parameter_file(found), 'name': found.file.stem})
        self._theory.request(found)

    def _obey(self, nodes: LiveNodes) -> None:
        """Carry out the commands that wait."""
        for _ in range(self._commands.qsize()):
            command, arrival = self._commands.get()
            number = command.get('n')
            try:
                do = self._do.get(str(command.get('do')))
                if do is None:
                    raise ValueError(f'unknown command {json.dumps(command.get("do"))[:40]}')
                do(nodes, command, arrival)
                answer = {'n': number, 'error': ''}
            except (ValueError, TypeError, ArithmeticError) as error:
                answer = {'n': number, 'error': one_line(str(error))}
            answer['ms'] = round(1e3 * (monotonic() - arrival), 1)
            self._board.add({'answer': answer})

    def _set(self, nodes: LiveNodes, command: dict[str, Any], arrival: float) -> None:
        """Move a slider or a switch."""
        control = self._controls.get(str(command.get('key')))
        if control is None:
            raise ValueError(f'unknown control {json.dumps(command.get("key"))[:60]}')
        value = control.value_of(command.get('value'), self._adjustments)
        number = command.get('n')
        self._asked = None
        self._apply(nodes, {node: {control.parameter: value} for node in control.nodes})
        self._asked = (number if isinstance(number, int) else 0, arrival)

    def _apply(self, nodes: LiveNodes, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change live parameters of running nodes; ValueError if one is refused."""
        for node, values in changes.items():
            before = dict(self._adjustments.changes.get(node, {}))
            self._adjustments.change(node, values, tried=node in nodes.processes)
            if node not in nodes.processes:
                continue
            try:
                nodes.set_parameters(values, node)
            except ValueError:
                self._adjustments.forget(node, before)
                self._changed()
                raise
        self._news = True

    def _reconfigure(self, nodes: LiveNodes, node: str, values: Mapping[str, Any]) -> None:
        """Change parameters that a node reads only when it is configured."""
        self._adjustments.change(node, values)
        nodes.reconfigure(node, values)
        self._news = True

    def _choose(self, nodes: LiveNodes, command: dict[str, Any], _: float) -> None:
        """Choose another filter or law."""
        owners = {'filter': 'estimator', 'law': 'controller'}
        what = str(command.get('what'))
        if what not in owners or (what == 'law' and not self._adjustments.driven):
            raise ValueError(f'choose: expected {" or ".join(owners)}, got {json.dumps(what)}')
        self._reconfigure(nodes, owners[what], {what: str(command.get('value'))})

    def _poles(self, nodes: LiveNodes, command: dict[str, Any], _: float) -> None:
        """Place the poles of the regulator, or those of a Luenberger observer."""
        poles = np.asarray(command.get('poles'), dtype=float)
        if poles.ndim != 2 or poles.shape[1] != 2 or not np.isfinite(poles).all():
            raise ValueError('poles: expected pairs of finite numbers')
        real, imaginary = poles.T.tolist()
        if command.get('of') == 'estimator':
            values = {'filter': 'luenberger', 'observer_poles': real}
            self._reconfigure(nodes, 'estimator', values)
            return
        if not self._adjustments.driven:
            raise ValueError('poles: there is no regulator')
        values = {'regulator_poles': real, 'regulator_frequencies': imaginary}
        if self._adjustments.value('controller', 'law') == 'placement':
            self._apply(nodes, {'controller': values})
        else:
            self._reconfigure(nodes, 'controller', {'law': 'placement', **values})

    def _on_push(self, nodes: LiveNodes, command: dict[str, Any], _: float) -> None:
        """Disturb an input for a moment."""
        model = nodes.scenario.model
        if not model.input.size:
            raise ValueError('push: the model has no input')
        index, share = command.get('input', 0), float(command.get('share', 1.0))
        if index not in range(model.input.size) or not abs(share) <= 10.0:
            raise ValueError('push: expected the number of an input, and a share up to 10')
        push = np.zeros(model.input.size)
        push[index] = share * self._scale
        nodes.push(push)
        self._push_end = self._time() + _PUSH

    def _reset(self, nodes: LiveNodes, _: dict[str, Any], __: float) -> None:
        """Start again at the initial state and belief."""
        if self._carried:
            self._carried, self._restart = {}, True
            return
        nodes.trigger('plant/reset')
        nodes.trigger('estimator/reset')
        self._streams.restart_cost()

    def _pause(self, nodes: LiveNodes, _: dict[str, Any], __: float) -> None:
        self._pace.paused, self._pace.predicted = True, False
        if not self._pace.lockstep:
            nodes.run_until(-1.0)
        self._report(nodes)

    def _resume(self, nodes: LiveNodes, _: dict[str, Any], __: float) -> None:
        """Continue; in real time the belief of before the pause is too old."""
        was, self._pace.paused = self._pace.paused, False
        if was and not self._pace.lockstep:
            nodes.trigger('estimator/reset')
            nodes.run_until(FOREVER)
        self._report(nodes)

    def _step(self, nodes: LiveNodes, command: dict[str, Any], arrival: float) -> None:
        """Show the prediction of the next step, then take the step: predict, update."""
        pace = self._pace
        if not pace.lockstep:
            self._mode(nodes, {'lockstep': True, 'paused': True}, arrival)
            return
        pace.paused = True
        if not pace.predicted and self._streams.estimate is not None:
            self._board.add({'prior': self._streams.prior(self._believed)})
            pace.predicted = True
            return
        pace.predicted = False
        pace.target = max(self._streams.elapsed, 0.0) + 1.0 / nodes.scenario.rate
        nodes.run_until(pace.target - 0.5 / nodes.scenario.rate)
        self._report(nodes)

    def _mode(self, nodes: LiveNodes, command: dict[str, Any], _: float) -> None:
        """Change between real time and lockstep: the nodes restart where they are."""
        lockstep = command.get('lockstep')
        if not isinstance(lockstep, bool):
            raise ValueError('mode: expected lockstep, true or false')
        paused = bool(command.get('paused', False))
        if lockstep == self._pace.lockstep:
            return
        speed = 0.05 if lockstep else 1.0
        self._pace = Pace(lockstep=lockstep, paused=paused, speed=speed)
        self._carried = self._streams.carried()
        self._restart = True

    def _speed(self, nodes: LiveNodes, command: dict[str, Any], _: float) -> None:
        """Set the speed of lockstep."""
        value = float(command.get('value', 1.0))
        if not _SLOWEST <= value <= _FASTEST:
            raise ValueError(f'speed: expected {_SLOWEST:g} to {_FASTEST:g}, got {value:g}')
        self._pace.speed = value
        self._report(nodes)

    def _on_restart(self, nodes: LiveNodes, _: dict[str, Any], __: float) -> None:
        """Restart the nodes from the initial state."""
        self._carried, self._restart = {}, True


def _usual_pace(adjustments: Adjustments) -> Pace:
    """Return real time, or for a scenario with rare readings a minute of lockstep."""
    rates = [adjustments.value('plant', f'{name}.rate') for name in adjustments.sensors]
    if max(rates, default=1.0) >= 0.5:
        return Pace()
    return Pace(lockstep=True, speed=min(max(1.0, adjustments.duration / 60.0), _FASTEST))
