# SPDX-License-Identifier: Apache-2.0
"""Loop of a live page, which passes topics to the board and commands to the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from math import ceil
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import Any

from kalman_ros.core import Array
from kalman_ros.core.one_line import one_line
from kalman_ros.harness import NodeError
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from .adjustments import Adjustments
from .board import Board
from .controls import controls
from .limits import limits
from .live_commands import LiveCommands, answer
from .live_nodes import FOREVER, LiveNodes
from .pace import Pace
from .page_command import Command
from .scene import chosen, placed, places, scene
from .share import parameter_file
from .streams import Streams
from .theory_worker import TheoryWorker

#: Intervals in seconds of frames, of status reports, and of updates of theory and shared file.
_FRAME, _STATUS, _CHANGES = 0.029, 0.5, 0.1
#: The longest wait while no tab is open, and the interval at which tabs and commands are noticed.
_DOZE, _NAP = 0.5, 0.02
#: Largest number of commands that wait.
_WAITING = 200


class LiveLoop:
    """The loop of nodes behind a live page.

    Parameters
    ----------
    file
        Parameter file.
    parameters
        Parameters for every node, which override those of the file.
    seed
        Seed of all noise.
    board
        Board that the tabs show.

    Raises
    ------
    ValueError
        If a parameter is unknown or invalid.
    """

    def __init__(self, file: Path, parameters: Mapping[str, Any], seed: int, board: Board) -> None:
        self._adjustments = Adjustments(file, parameters)
        self._controls = controls(self._adjustments)
        #: That with which the page starts.
        self._initial = self._changeable()
        self._seed, self._board = seed, board
        self._queue: SimpleQueue[tuple[Command, float]] = SimpleQueue()
        self._pace = Pace.usual(self._adjustments)
        self._continuation: dict[str, dict[str, Any]] | None = None
        self._runs = self._changes = 0
        self._frame_time = 0.0
        self._fixed_gains: dict[str, list[float]] = {}
        self._theory = TheoryWorker(self._on_theory)

    def _on_theory(self, theory: dict[str, Any]) -> None:
        """Show the theory; called in a thread of the worker."""
        self._fixed_gains = (theory.get('estimator') or {}).get('gains', {})
        self._board.put('theory', theory)

    def command(self, command: Command, arrival: float) -> None:
        """Queue a command of a tab; callable from any thread."""
        if self._queue.qsize() >= _WAITING:
            answer(self._board, command, 'too many commands are waiting', arrival)
        else:
            self._queue.put((command, arrival))

    def run(self) -> None:
        """Run the nodes until a signal ends the process.

        If a node dies, it is reported, and all nodes restart on request.

        Raises
        ------
        NodeError
            If the nodes cannot be started for the first time.
        """
        with self._theory:
            while True:
                self._report_status('starting the nodes')
                try:
                    with self._build_nodes() as nodes:
                        self._serve(nodes)
                except NodeError as error:
                    if not self._runs:
                        raise
                    self._report_status(one_line(str(error)), failed=True)
                    self._continuation = None
                    self._wait_for_restart()

    def _build_nodes(self) -> LiveNodes:
        adjustments, carried = self._adjustments, self._continuation or {}
        only = {
            node: {**adjustments.at_start(node), **carried.get(node, {})}
            for node in {*adjustments.changes, *carried}
        }
        shared = {**adjustments.shared, 'seed': self._seed}
        return LiveNodes(adjustments.file, shared, only, lockstep=self._pace.lockstep)

    def _serve(self, nodes: LiveNodes) -> None:
        """Pass on topics and commands until the nodes must restart."""
        self._runs += 1
        pace, streams = self._pace, Streams(nodes.scenario)
        pace.restart()
        commands = LiveCommands(
            nodes, streams, self._adjustments, self._controls, pace, self._board
        )
        commands.carried = self._continuation
        self._publish_parameters()
        self._board.clear()
        self._board.put('scene', {
            **scene(self._adjustments, self._controls),
            'run': self._runs, 'initial': self._initial,
        })  # fmt: skip
        if self._adjustments.driven:
            _load_laws(nodes, str(self._adjustments.value('controller', 'law')))
        if not pace.paused or pace.lockstep:
            nodes.run_until(0.0 if pace.lockstep else FOREVER)
        # on a timer, so that a command that waits for a node does not hold up the frames
        frames = partial(self._publish_frame, nodes, streams, commands)
        nodes.call_every(_FRAME, frames)
        self._frame_time = monotonic()
        status_time = change_time = 0.0
        while not commands.restart:
            if not pace.lockstep and not commands.pushing:
                self._doze()
            is_short = commands.changed or not self._board.readers
            wait = _FRAME if is_short else _STATUS / 2.0
            nodes.spin_until(wait, lambda: not self._queue.empty())
            for _ in range(self._queue.qsize()):
                commands.carry_out(*self._queue.get())
                status_time = 0.0
            now = monotonic()
            if commands.changed and now - change_time >= _CHANGES:
                commands.changed = False
                self._publish_parameters()
                change_time = now
            if now - status_time >= _STATUS:
                self._report_status('', nodes, streams)
                self._board.put('path', commands.path.described())
                ghost = commands.ghost
                self._board.put('ghost', {'filter': '' if ghost is None else ghost.filter})
                status_time = now
        self._pace, self._continuation = commands.pace, commands.carried

    def _doze(self) -> None:
        """Wait for a tab or a command, but not for long; meanwhile topics keep the last samples.

        So a page that nobody looks at leaves the processor to the nodes.
        """
        end = monotonic() + _DOZE
        while not self._board.readers and self._queue.empty() and monotonic() < end:
            sleep(_NAP)

    def _publish_frame(self, nodes: LiveNodes, streams: Streams, commands: LiveCommands) -> None:
        """Publish the samples since the last frame, and let the plant continue."""
        now = monotonic()
        elapsed, self._frame_time = now - self._frame_time, now
        target = self._pace.target(
            streams.elapsed, min(elapsed, 4 * _FRAME), 1.0 / nodes.scenario.rate
        )
        if target is not None:
            nodes.run_until(target)
        commands.end_push()
        samples, ghost = nodes.take(), commands.ghost
        frame = streams.frame(
            samples, *self._evaluation, self._fixed_gains, periods=ceil(elapsed / _FRAME)
        )
        if frame is not None:
            if ghost is not None:
                frame.update(streams.beliefs(ghost.fuse(samples)))
            self._board.add(frame)

    def _report_status(
        self,
        message: str,
        nodes: LiveNodes | None = None,
        streams: Streams | None = None,
        *,
        failed: bool = False,
    ) -> None:
        """Show the pace, with a message or the reports on nodes and sensors."""
        pace = self._pace
        report: dict[str, Any] = {
            'run': self._runs, 'lockstep': pace.lockstep, 'paused': pace.paused,
            'speed': pace.speed, 'failed': failed, 'message': message, 'nodes': {},
            'sensors': {},
        }  # fmt: skip
        if streams is not None:
            report['sensors'] = streams.watch.troubles(self._evaluation[0])
        if nodes is not None:
            report['missed'] = nodes.reported('plant', 'missed steps')
            report['gain'] = nodes.reported('controller', 'gain')
            report['planned_within_limits'], report['answered'] = (
                nodes.reported('controller', key)
                for key in ('inputs planned within limits', 'estimates answered')
            )
            report['nodes'] = {
                name: {'level': int.from_bytes(status.level, 'big'), 'message': status.message}
                for name, status in sorted(nodes.diagnostics.items())
            }
        self._board.put('status', report)

    def _wait_for_restart(self) -> None:
        """Wait until the user requests a restart."""
        while True:
            try:
                command, arrival = self._queue.get(timeout=0.2)
            except Empty:  # Python delivers signals between two waits
                continue
            restart = command.do == 'restart'
            answer(self._board, command, '' if restart else 'a node has ended: restart', arrival)
            if restart:
                return

    def _changeable(self) -> dict[str, Any]:
        """Return all that the tabs change: values of controls, choices, limits, placed poles."""
        adjustments = self._adjustments
        return {
            'values': {key: control.read(adjustments) for key, control in self._controls.items()},
            'chosen': chosen(adjustments),
            'limits': limits(adjustments),
            'placed': placed(adjustments),
            'places': places(adjustments),
        }

    def _publish_parameters(self) -> None:
        """Show the current parameters, and request the theory for them."""
        adjustments = self._adjustments
        weight: Array | None = None
        if adjustments.driven:
            weight = price(adjustments.scenario('controller')).weight
        #: Scenario of the estimator, and weight of the cost.
        self._evaluation: tuple[Scenario, Array | None] = (
            adjustments.scenario('estimator'),
            weight,
        )
        self._changes += 1
        self._board.put('values', {
            'version': self._changes,
            **self._changeable(),
        })  # fmt: skip
        self._board.put(
            'share', {'yaml': parameter_file(adjustments), 'name': adjustments.file.stem}
        )
        self._theory.request(adjustments, self._changes)


def _load_laws(nodes: LiveNodes, law: str) -> None:
    """Let the controller load what any law needs, while the plant waits.

    Else its first change to ``placement`` would take half a second, without a force.
    """
    for name in ('placement', law):
        with suppress(ValueError):  # such a law may not exist for the scenario
            nodes.set_parameters({'law': name}, 'controller')
