# SPDX-License-Identifier: Apache-2.0
"""What a person may do to a running loop: every command of the page, checked."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.core.one_line import one_line
from kalman_ros.harness import NodeError

from .adjustments import Adjustments
from .board import Board
from .controls import Control
from .live_nodes import FOREVER, LiveNodes
from .pace import Pace
from .page_command import Command
from .scene import force_scale
from .streams import Streams

#: Seconds that a push lasts, and its largest share of the usual input.
_PUSH, _MOST = 0.2, 10.0
#: The largest part of a pole, in 1/s.
_FASTEST = 1e9
#: Which node has what can be chosen.
_OWNERS = {'filter': 'estimator', 'law': 'controller'}


def answer(board: Board, command: Command, error: str, arrival: float) -> None:
    """Show what became of a command that arrived at a monotonic time."""
    taken = round(1e3 * (monotonic() - arrival), 1)
    board.add({'answer': {'n': command.number, 'error': error, 'ms': taken}})


class LiveCommands:
    """Carries out commands on the nodes of one run.

    Parameters
    ----------
    nodes, streams
        The nodes, and what they publish.
    adjustments, controls
        The parameters, and which of them have controls.
    pace
        Of the loop.
    board
        For answers.
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
        #: The pace of this run, or of the next one.
        self.pace = pace
        #: Whether the nodes must restart, and with which parameters to continue from here.
        self.restart = False
        self.carried: dict[str, dict[str, Any]] | None = None
        #: Whether a parameter has changed since this was set to False.
        self.changed = False
        self._push_end: float | None = None
        self._asked: float | None = None
        self._do: dict[str, Callable[[Mapping[str, Any], float], None]] = {
            'set': self._set,
            'choose': self._choose,
            'poles': self._poles,
            'push': self._push,
            'reset': self._reset,
            'pause': self._pause,
            'resume': self._resume,
            'step': self._step,
            'mode': self._mode,
            'speed': self._speed,
            'restart': self._restart,
        }
        nodes.on_input = self._on_input

    def carry_out(self, command: Command, arrival: float) -> None:
        """Carry out a command that arrived at a monotonic time, and answer it.

        Raises
        ------
        NodeError
            If a node has died. Whatever else goes wrong is the answer.
        """
        error = command.error
        try:
            if not error:
                self._do[command.do](command.fields, arrival)
        except NodeError:
            raise
        except Exception as reason:
            error = one_line(str(reason)) or type(reason).__name__
        answer(self._board, command, error, arrival)

    def end_push(self) -> None:
        """End the disturbance when its time is over."""
        if self._push_end is not None and self._time() >= self._push_end:
            self._nodes.push(np.zeros(self._nodes.scenario.model.input.size))
            self._push_end = None

    def _time(self) -> float:
        """Return the time by which a push ends: simulated in lockstep."""
        return self._streams.elapsed if self.pace.lockstep else monotonic()

    def _on_input(self) -> None:
        """Show how long after a command the first input by the new parameters was received."""
        if self._asked is not None:
            taken, self._asked = round(1e3 * (monotonic() - self._asked), 1), None
            self._board.add({'latency': {'ms': taken}})

    def _set(self, command: Mapping[str, Any], arrival: float) -> None:
        """Move a slider or a switch."""
        control = self._controls.get(str(command.get('key')))
        if control is None:
            raise ValueError(f'unknown control {json.dumps(command.get("key"))[:60]}')
        value = control.value_of(command.get('value'), self._adjustments)
        first, *others = control.nodes
        self._asked = None
        self._apply({first: {control.parameter: value}})
        self._asked = arrival
        self._apply({node: {control.parameter: value} for node in others})

    def _apply(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change live parameters of running nodes; ValueError if one is refused."""
        self.changed = True
        for node, values in changes.items():
            before = dict(self._adjustments.changes.get(node, {}))
            runs = node in self._nodes.processes
            self._adjustments.change(node, values, tried=runs)
            if not runs:
                continue
            try:
                self._nodes.set_parameters(values, node)
            except ValueError:
                self._adjustments.forget(node, before)
                raise

    def _reconfigure(self, node: str, values: Mapping[str, Any]) -> None:
        """Change parameters that a node reads only when it is configured."""
        self._adjustments.change(node, values)
        self.changed = True
        self._nodes.reconfigure(node, values)

    def _choose(self, command: Mapping[str, Any], _: float) -> None:
        """Choose another filter or law."""
        what = str(command.get('what'))
        if what not in _OWNERS or (what == 'law' and not self._adjustments.driven):
            raise ValueError(f'choose: expected {" or ".join(_OWNERS)}, got {json.dumps(what)}')
        self._reconfigure(_OWNERS[what], {what: str(command.get('value'))})

    def _poles(self, command: Mapping[str, Any], _: float) -> None:
        """Place the poles of the regulator, or those of a Luenberger observer."""
        pairs = command.get('poles') or []
        if not pairs or not all(map(_is_pole, pairs)):
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
        if self._adjustments.value('controller', 'law') == 'placement':
            self._apply({'controller': values})
        else:
            self._reconfigure('controller', {'law': 'placement', **values})

    def _push(self, command: Mapping[str, Any], _: float) -> None:
        """Disturb an input for a moment."""
        size = self._nodes.scenario.model.input.size
        if not size:
            raise ValueError('push: the model has no input')
        index, share = command.get('input', 0), float(command.get('share', 1.0))
        if type(index) is not int or index not in range(size) or not abs(share) <= _MOST:
            expected = f'the number of an input, and a share up to {_MOST:g}'
            raise ValueError(f'push: expected {expected}')
        push = np.zeros(size)
        push[index] = share * self._scale
        self._nodes.push(push)
        self._push_end = self._time() + _PUSH

    def _reset(self, command: Mapping[str, Any], arrival: float) -> None:
        """Start again at the initial state and belief of the file."""
        if self.carried is not None:
            self._restart(command, arrival)
            return
        self._nodes.trigger('plant/reset')
        self._nodes.trigger('estimator/reset')
        self._streams.restart_cost()

    def _pause(self, _: Mapping[str, Any], __: float) -> None:
        self.pace.paused, self.pace.predicted = True, False
        if not self.pace.lockstep:
            self._nodes.run_until(-1.0)

    def _resume(self, _: Mapping[str, Any], __: float) -> None:
        """Continue; in real time the belief of before the pause is too old."""
        was, self.pace.paused = self.pace.paused, False
        if was and not self.pace.lockstep:
            self._nodes.trigger('estimator/reset')
            self._nodes.run_until(FOREVER)

    def _step(self, command: Mapping[str, Any], arrival: float) -> None:
        """Show the prediction of the next step, then take the step: predict, update."""
        pace, streams = self.pace, self._streams
        if not pace.lockstep:
            self._mode({'lockstep': True, 'paused': True}, arrival)
            return
        pace.paused = True
        if not pace.predicted and streams.estimate is not None:
            believed = self._adjustments.scenario('estimator')
            self._board.add({'prior': streams.prior(believed)})
            pace.predicted = True
            return
        pace.predicted = False
        # the next step, and not the one after it, however their times are rounded
        self._nodes.run_until(max(streams.elapsed, 0.0) + 1.5 / self._nodes.scenario.rate)

    def _mode(self, command: Mapping[str, Any], _: float) -> None:
        """Change between real time and lockstep: the nodes restart where they are."""
        lockstep = command.get('lockstep')
        if not isinstance(lockstep, bool):
            raise ValueError('mode: expected lockstep, true or false')
        if lockstep != self.pace.lockstep:
            paused = bool(command.get('paused', False))
            self.pace = Pace.changed(lockstep=lockstep, paused=paused)
            self.carried = self._streams.carried()
            self.restart = True

    def _speed(self, command: Mapping[str, Any], _: float) -> None:
        """Set the speed of lockstep."""
        self.pace.set_speed(float(command.get('value', 1.0)))

    def _restart(self, _: Mapping[str, Any], __: float) -> None:
        """Restart the nodes from the initial state."""
        self.carried, self.restart = None, True


def _is_pole(pair: Any) -> bool:
    """Return whether a value is a list of a real and an imaginary part."""
    return (
        isinstance(pair, list)
        and len(pair) == 2
        and all(type(part) in (int, float) and abs(part) <= _FASTEST for part in pair)
    )
