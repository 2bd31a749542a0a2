# SPDX-License-Identifier: Apache-2.0
"""Runs the nodes of a live page: their topics to the board, commands to the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any

from kalman_ros.core import Array
from kalman_ros.core.one_line import one_line
from kalman_ros.harness import NodeError
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from .adjustments import Adjustments
from .board import Board
from .controls import controls
from .live_commands import LiveCommands, answer
from .live_nodes import FOREVER, LiveNodes
from .pace import Pace
from .page_command import Command
from .scene import scene
from .share import parameter_file
from .streams import Streams
from .theory_worker import TheoryWorker

#: Seconds between two frames, two status reports, and two updates of theory and shared file.
_FRAME, _STATUS, _CHANGES = 0.05, 0.5, 0.1
#: The most commands that wait.
_WAITING = 200


class LiveLoop:
    """The loop behind a page.

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
        self._controls = controls(self._adjustments)
        self._seed, self._board = seed, board
        self._queue: SimpleQueue[tuple[Command, float]] = SimpleQueue()
        self._pace = Pace.usual(self._adjustments)
        self._carried: dict[str, dict[str, Any]] | None = None
        self._runs = 0
        self._fixed_gains: dict[str, list[float]] = {}
        self._theory = TheoryWorker(self._on_theory)

    def _on_theory(self, found: dict[str, Any]) -> None:
        """Show the theory; a thread of the worker calls this."""
        self._fixed_gains = (found.get('estimator') or {}).get('gains', {})
        self._board.put('theory', found)

    def command(self, command: Command, arrival: float) -> None:
        """Queue a command from a tab; any thread may call this."""
        if self._queue.qsize() >= _WAITING:
            answer(self._board, command, 'too many commands are waiting', arrival)
        else:
            self._queue.put((command, arrival))

    def run(self) -> None:
        """Run the nodes until a signal; one that dies is reported, and all restart on request.

        Raises
        ------
        NodeError
            If they cannot be started at first.
        """
        with self._theory:
            while True:
                self._status('starting the nodes')
                try:
                    with self._nodes() as nodes:
                        self._serve(nodes)
                except NodeError as error:
                    if not self._runs:
                        raise
                    self._status(one_line(str(error)), failed=True)
                    self._carried = None
                    self._until_restart()

    def _nodes(self) -> LiveNodes:
        found, carried = self._adjustments, self._carried or {}
        only = {
            node: {**found.changes.get(node, {}), **carried.get(node, {})}
            for node in {*found.changes, *carried}
        }
        shared = {**found.shared, 'seed': self._seed}
        return LiveNodes(found.file, shared, only, lockstep=self._pace.lockstep)

    def _serve(self, nodes: LiveNodes) -> None:
        """Pass topics and commands on until the nodes must restart."""
        self._runs += 1
        pace, streams = self._pace, Streams(nodes.scenario)
        pace.restart()
        commands = LiveCommands(
            nodes, streams, self._adjustments, self._controls, pace, self._board
        )
        commands.carried = self._carried
        self._follow()
        self._board.clear()
        self._board.put('scene', {**scene(self._adjustments, self._controls), 'run': self._runs})
        if not pace.paused or pace.lockstep:
            nodes.run_until(0.0 if pace.lockstep else FOREVER)
        framed = reported = followed = 0.0
        while not commands.restart:
            nodes.spin_until(_FRAME, lambda: not self._queue.empty())
            for _ in range(self._queue.qsize()):
                commands.carry_out(*self._queue.get())
                reported = 0.0
            now = monotonic()
            if now - framed >= 0.9 * _FRAME:  # the wait may be slightly shorter
                passed = min(now - framed, 4 * _FRAME)
                target = pace.target(streams.elapsed, passed, 1.0 / nodes.scenario.rate)
                if target is not None:
                    nodes.run_until(target)
                commands.end_push()
                frame = streams.frame(nodes.take(), *self._judged, self._fixed_gains)
                if frame is not None:
                    self._board.add(frame)
                framed = now
            if commands.changed and now - followed >= _CHANGES:
                commands.changed = False
                self._follow()
                followed = now
            if now - reported >= _STATUS:
                self._status('', nodes)
                reported = now
        self._pace, self._carried = commands.pace, commands.carried

    def _status(
        self, message: str, nodes: LiveNodes | None = None, *, failed: bool = False
    ) -> None:
        """Show the pace, and a message or the reports of the nodes."""
        pace = self._pace
        found: dict[str, Any] = {
            'run': self._runs, 'lockstep': pace.lockstep, 'paused': pace.paused,
            'speed': pace.speed, 'failed': failed, 'message': message, 'nodes': {},
        }  # fmt: skip
        if nodes is not None:
            found['missed'] = nodes.reported('plant', 'missed steps')
            found['gain'] = nodes.reported('controller', 'gain')
            found['nodes'] = {
                name: {'level': int.from_bytes(status.level, 'big'), 'message': status.message}
                for name, status in sorted(nodes.diagnostics.items())
            }
        self._board.put('status', found)

    def _until_restart(self) -> None:
        """Wait for a person's request to start again."""
        while True:
            try:
                command, arrival = self._queue.get(timeout=0.2)
            except Empty:  # a signal is delivered between two waits
                continue
            restart = command.do == 'restart'
            answer(self._board, command, '' if restart else 'a node has ended: restart', arrival)
            if restart:
                return

    def _follow(self) -> None:
        """Show the parameters in use, and compute the theory of them."""
        found = self._adjustments
        weight: Array | None = None
        if found.driven:
            weight = price(found.scenario('controller')).weight
        #: What the estimator believes, and the weight of the cost.
        self._judged: tuple[Scenario, Array | None] = (found.scenario('estimator'), weight)
        self._board.put('values', {
            'values': {key: control.read(found) for key, control in self._controls.items()},
            'chosen': {
                'filter': found.value('estimator', 'filter'),
                **({'law': found.value('controller', 'law')} if found.driven else {}),
            },
        })  # fmt: skip
        self._board.put('share', {'yaml': parameter_file(found), 'name': found.file.stem})
        self._theory.request(found)
