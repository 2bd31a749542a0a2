# SPDX-License-Identifier: Apache-2.0
"""Commands of the live page on a running loop."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.core.one_line import one_line
from kalman_ros.harness import NodeError
from kalman_ros.scenario.law import kept, limits_of_states

from .adjustments import Adjustments
from .board import Board
from .controls import Control
from .drawn_path import DrawnPath, described, points_of
from .ghost import Ghost
from .limits import limited
from .live_nodes import FOREVER, LiveNodes
from .pace import Pace
from .page_command import Command, are_numbers
from .scene import force_scale, places
from .streams import Streams

#: Duration of a push in seconds, and its largest multiple of the typical input.
_PUSH, _MOST = 0.2, 10.0
#: Largest real or imaginary part of a pole, in 1/s.
_FASTEST = 1e9
#: Largest magnitude of a state to which the plant is carried.
_FAR = 1e6
#: Time in seconds for which a ghost continues after a tab has last shown it.
_LEASE = 10.0
#: Node that owns each parameter that can be chosen.
_OWNERS = {'filter': 'estimator', 'law': 'controller'}


def answer(board: Board, command: Command, error: str, arrival: float) -> None:
    """Show the result of a command that arrived at a monotonic time."""
    milliseconds = round(1e3 * (monotonic() - arrival), 1)
    board.add({'answer': {'n': command.number, 'error': error, 'ms': milliseconds}})


class LiveCommands:
    """An executor of commands on the nodes of one run.

    Parameters
    ----------
    nodes, streams
        Nodes, and the streams of their topics.
    adjustments, controls
        Parameters, and the controls for them.
    pace
        Pace of the loop.
    board
        Board for the answers.
    """

    def __init__(
        self,
        nodes: LiveNodes,
        streams: Streams,
        adjustments: Adjustments,
        controls: Mapping[str, Control],
        pace: Pace,
        board: Board,
    ) -> None:
        self._nodes, self._streams, self._board = nodes, streams, board
        self._adjustments, self._controls = adjustments, controls
        self._scale = force_scale(adjustments)
        #: Pace of this run, or of the next run.
        self.pace = pace
        #: Whether the nodes must restart, and the parameters with which they continue from here.
        self.restart = False
        self.carried: dict[str, dict[str, Any]] | None = None
        #: Whether a parameter has changed since this attribute was reset.
        self.changed = False
        #: Whether the plant starts elsewhere than at its initial state after a reset.
        self._is_carried = False
        #: Parameters of the belief with which the estimator has gone on after a pause.
        self._resumed: tuple[str, ...] = ()
        #: Path that was drawn last.
        self.path = DrawnPath(lambda key: nodes.reported('controller', key))
        self._ghost_estimator: Ghost | None = None
        self._ghost_shown = 0.0
        #: Number of steps whose prediction is shown.
        self._steps = 1
        self._push_end: float | None = None
        self._command_time: float | None = None
        self._handlers: dict[str, Callable[[Mapping[str, Any], float], None]] = {
            'set': self._set,
            'choose': self._choose,
            'poles': self._poles,
            'carry': self._carry,
            'place': self._place,
            'limit': self._limit,
            'path': self._path,
            'push': self._push,
            'reset': self._reset,
            'pause': self._pause,
            'resume': self._resume,
            'step': self._step,
            'mode': self._mode,
            'speed': self._speed,
            'restart': self._restart,
            'ghost': self._ghost,
        }
        nodes.on_input = self._on_input

    def carry_out(self, command: Command, arrival: float) -> None:
        """Carry out a command that arrived at a monotonic time, and answer it.

        Raises
        ------
        NodeError
            If a node has died. Any other error is the answer to the command.
        """
        error = command.error
        try:
            if not error:
                self._handlers[command.do](command.fields, arrival)
        except NodeError:
            raise
        except Exception as reason:
            error = one_line(str(reason)) or type(reason).__name__
        answer(self._board, command, error, arrival)

    @property
    def ghost(self) -> Ghost | None:
        """Ghost of the estimator; None unless a tab has shown it recently."""
        if monotonic() - self._ghost_shown > _LEASE:
            self._ghost_estimator = None
        return self._ghost_estimator

    def end_push(self) -> None:
        """End the push when its duration is over."""
        if self._push_end is not None and self._push_clock() >= self._push_end:
            self._nodes.push(np.zeros(self._nodes.scenario.model.input.size))
            self._push_end = None

    @property
    def pushing(self) -> bool:
        """Whether a push has not ended yet."""
        return self._push_end is not None

    def _push_clock(self) -> float:
        """Return the clock of a push: simulated time in lockstep, else monotonic time."""
        return self._streams.elapsed if self.pace.lockstep else monotonic()

    def _on_input(self) -> None:
        """Show the latency from a command to the first input with the new parameters."""
        if self._command_time is not None:
            milliseconds, self._command_time = (
                round(1e3 * (monotonic() - self._command_time), 1),
                None,
            )
            self._board.add({'latency': {'ms': milliseconds}})

    def _set(self, command: Mapping[str, Any], arrival: float) -> None:
        """Move a slider or a switch."""
        control = self._controls.get(str(command.get('key')))
        if control is None:
            raise ValueError(f'unknown control {json.dumps(command.get("key"))[:60]}')
        value = control.value_of(command.get('value'), self._adjustments)
        first, *others = control.nodes
        self._command_time = None
        self._apply({first: {control.parameter: value}})
        self._command_time = arrival
        self._apply({node: {control.parameter: value} for node in others})

    def _apply(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change parameters of running nodes; raise ValueError if a node refuses them."""
        self.changed = True
        for node, values in changes.items():
            previous = dict(self._adjustments.changes.get(node, {}))
            is_running = node in self._nodes.processes
            self._adjustments.change(node, values, tried=is_running)
            if not is_running:
                continue
            try:
                self._nodes.set_parameters(values, node)
            except ValueError:
                self._adjustments.forget(node, previous)
                raise
            if node in ('plant', 'estimator'):
                self._streams.watch.restart(skip=2)  # its last report may be outdated

    def _reconfigure(self, node: str, values: Mapping[str, Any]) -> None:
        """Change parameters that a node reads only during its configuration."""
        self._adjustments.change(node, values)
        self.changed = True
        self._nodes.reconfigure(node, values)

    def _choose(self, command: Mapping[str, Any], _: float) -> None:
        """Choose another filter or control law."""
        choice = str(command.get('what'))
        if choice not in _OWNERS or (choice == 'law' and not self._adjustments.driven):
            raise ValueError(f'choose: expected {" or ".join(_OWNERS)}, got {json.dumps(choice)}')
        value = str(command.get('value'))
        if choice == 'law':
            changes = self._adjustments.changes.get('controller', {})
            self._apply({'controller': kept({**limits_of_states(changes), 'law': value})})
        else:
            self._reconfigure(_OWNERS[choice], {choice: value})

    def _poles(self, command: Mapping[str, Any], _: float) -> None:
        """Place the poles of the regulator or of a Luenberger observer."""
        pairs = command.get('poles') or []
        if not pairs or not all(are_numbers(pair, 2, _FASTEST) for pair in pairs):
            raise ValueError('poles: expected pairs of finite numbers up to 1e9')
        real, imaginary = ([float(part) for part in parts] for parts in zip(*pairs))
        if command.get('of') == 'estimator':
            values = {'observer_poles': real, 'observer_frequencies': imaginary}
            if self._adjustments.value('estimator', 'filter') == 'luenberger':
                self._apply({'estimator': values})
            else:
                self._reconfigure('estimator', {'filter': 'luenberger', **values})
            return
        if not self._adjustments.driven:
            raise ValueError('poles: there is no regulator')
        values = {'regulator_poles': real, 'regulator_frequencies': imaginary}
        self._apply({'controller': {'law': 'placement', **values}})

    def _limit(self, command: Mapping[str, Any], arrival: float) -> None:
        """Move a limit of an input or of a state; without a value, there is none."""
        of, name, side = (str(command.get(key, '')) for key in ('of', 'name', 'side'))
        value = command.get('value')
        number = None if value is None else float(value)
        values = limited(self._adjustments, of, name, side, number)
        self._command_time = None
        self._apply({'controller': values})
        self._command_time = arrival

    def _path(self, command: Mapping[str, Any], _: float) -> None:
        """Send a path to the controller, which plans its motion."""
        reason = described(self._adjustments)['reason']
        if reason:
            raise ValueError(f'path: {reason}')
        points = command.get('points') or []
        path = points_of(self._nodes.scenario, points)
        self.path.draw(points)
        self._nodes.follow(path)

    def _push(self, command: Mapping[str, Any], _: float) -> None:
        """Disturb an input, or all inputs by their ``shares``, for a short time."""
        size = self._nodes.scenario.model.input.size
        if not size:
            raise ValueError('push: the model has no input')
        index, share = command.get('input', 0), float(command.get('share', 1.0))
        shares = command.get('shares')
        if shares is None and type(index) is int and index in range(size):
            shares = [share if k == index else 0.0 for k in range(size)]
        if not are_numbers(shares, size, _MOST):
            expected = f'the number of an input, and a share up to {_MOST:g}'
            raise ValueError(f'push: expected {expected}')
        self._nodes.push(np.array(shares, dtype=float) * self._scale)
        self._push_end = self._push_clock() + _PUSH

    def _carry(self, command: Mapping[str, Any], _: float) -> None:
        """Carry the plant to other values of some states, which no other node knows."""
        names, values = command.get('names') or [], command.get('values') or []
        state, truth = self._nodes.scenario.model.state, self._truth_to_change('carry')
        known = all(isinstance(name, str) and name in state.names for name in names)
        if not names or not known or not are_numbers(values, len(names), _FAR):
            raise ValueError(f'carry: expected names of states and finite numbers up to {_FAR:g}')
        place = truth.copy()
        place[[state.names.index(name) for name in names]] = values
        self._nodes.reconfigure('plant', {'initial_state': place.tolist()})
        self._is_carried = True

    def _truth_to_change(self, what: str) -> Array:
        """Return the state in which to configure the plant again; ValueError without one."""
        truth = self._streams.truth
        if self.pace.lockstep:
            why = 'since lockstep begins at its first step'
            raise ValueError(f'{what}: expected real time, {why}')
        if truth is None or not np.isfinite(truth).all():
            raise ValueError(f'{what}: the plant has published no finite state')
        return truth

    def _place(self, command: Mapping[str, Any], _: float) -> None:
        """Move a sensor, which no other node knows."""
        name, place = str(command.get('sensor')), [command.get('x'), command.get('y')]
        truth = self._truth_to_change('place')
        if name not in places(self._adjustments) or not are_numbers(place, 2, _FAR):
            raise ValueError(f'place: expected a sensor on the map and numbers up to {_FAR:g}')
        values = {f'{name}.position': [float(command[axis]) for axis in 'xy']}
        self._adjustments.change('plant', values)
        self.changed = True
        self._nodes.reconfigure('plant', {**values, 'initial_state': truth.tolist()})
        self._is_carried = True
        self._streams.watch.restart(skip=2)

    def _reset(self, command: Mapping[str, Any], arrival: float) -> None:
        """Reset the loop to the initial state and belief of the file."""
        if self.carried is not None:
            self._restart(command, arrival)
            return
        if self._is_carried:
            start = self._adjustments.value('plant', 'initial_state')
            self._nodes.reconfigure('plant', {'initial_state': start})
            self._is_carried = False
        else:
            self._nodes.trigger('plant/reset')
        if self._resumed:
            initial = {name: self._adjustments.value('estimator', name) for name in self._resumed}
            self._nodes.reconfigure('estimator', initial)
            self._resumed = ()
        else:
            self._nodes.trigger('estimator/reset')
        if self._ghost_estimator is not None:
            self._ghost_estimator.reset()
        if self._adjustments.driven:
            self._nodes.trigger('controller/reset')  # ends a motion
            self.path.draw([])
        self._streams.restart(self._nodes.take())
        self._board.add({'fresh': True})

    def _pause(self, _: Mapping[str, Any], __: float) -> None:
        self.pace.paused, self.pace.predicted = True, False
        if not self.pace.lockstep:
            self._nodes.run_until(-1.0)

    def _resume(self, _: Mapping[str, Any], __: float) -> None:
        """Continue after a pause; in real time, the estimator starts from its last belief."""
        was_paused, self.pace.paused = self.pace.paused, False
        if not was_paused or self.pace.lockstep:
            return
        belief = self._streams.carried().get('estimator')
        if belief:
            self._nodes.reconfigure('estimator', belief)
            self._resumed = tuple(belief)
        else:
            self._nodes.trigger('estimator/reset')
        self._streams.watch.restart(skip=2)
        self._nodes.run_until(FOREVER)

    def _step(self, command: Mapping[str, Any], arrival: float) -> None:
        """Show the prediction of the next step, or take the step if that is already shown.

        With the name of a sensor as ``reading``, it leads to the next reading of that sensor.
        """
        pace, streams = self.pace, self._streams
        if not pace.lockstep:
            self._mode({'lockstep': True, 'paused': True}, arrival)
            return
        pace.paused = True
        if not pace.predicted and streams.estimate is not None:
            believed = self._adjustments.scenario('estimator')
            self._steps = self._steps_to_reading(str(command.get('reading', '')))
            self._board.add({'prior': streams.prior(believed, self._steps)})
            pace.predicted = True
            return
        steps = self._steps if pace.predicted else 1
        pace.predicted = False
        # half a step later than the last step, so that rounding cannot add another step
        target = max(streams.elapsed, 0.0) + (steps + 0.5) / self._nodes.scenario.rate
        self._nodes.run_until(target)

    def _steps_to_reading(self, sensor: str) -> int:
        """Return the number of steps to the next reading of a sensor, 1 if there is none."""
        if sensor not in self._adjustments.sensors:
            return 1
        return self._streams.steps_to_reading(
            sensor, self._adjustments.value('plant', f'{sensor}.rate')
        )

    def _mode(self, command: Mapping[str, Any], _: float) -> None:
        """Change between real time and lockstep; the nodes restart from the current state."""
        lockstep = command.get('lockstep')
        if not isinstance(lockstep, bool):
            raise ValueError('mode: expected lockstep, true or false')
        if lockstep != self.pace.lockstep:
            paused = bool(command.get('paused', False))
            self.pace = Pace.changed(lockstep=lockstep, paused=paused)
            self.carried = self._streams.carried()
            self.restart = True

    def _speed(self, command: Mapping[str, Any], _: float) -> None:
        """Set the speed of simulated time in lockstep."""
        self.pace.set_speed(float(command.get('value', 1.0)))

    def _ghost(self, command: Mapping[str, Any], arrival: float) -> None:
        """Start a ghost with the current values, say that it is still shown, or end it.

        With ``filter``, '' for the current one, a new ghost starts from the newest belief.
        """
        filter, shown = command.get('filter'), command.get('shown', True)
        if filter is not None and shown:
            ghost = Ghost(self._adjustments.estimator_settings(filter))
            streams = self._streams
            if streams.estimate is not None and streams.estimate_time is not None:
                ghost.start(streams.estimate_time, Gaussian(*streams.estimate), streams.input)
                ghost.fuse(streams.samples)
            self._ghost_estimator = ghost
        if not shown:
            self._ghost_estimator = None
        self._ghost_shown = arrival

    def _restart(self, _: Mapping[str, Any], __: float) -> None:
        """Restart the nodes from the initial state."""
        self.carried, self.restart = None, True
