# SPDX-License-Identifier: Apache-2.0
"""Run of the nodes, from start to stop."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.task import Future
from std_srvs.srv import Trigger

from kalman_ros.codecs.messages import message_type
from kalman_ros.core import Signal
from kalman_ros.nodes.middleware.diagnostics import NUMBER
from kalman_ros.nodes.middleware.published import SERVICE
from kalman_ros.simulation.trajectory import Trajectory

from .confirmation import WINDOW, Confirmation
from .launched_nodes import LaunchedNodes, NodeError
from .node_set import NodeSet
from .progress import Progress
from .recorder import Recorder
from .run_recording import RunRecording
from .to_trajectory import signals, to_trajectory

#: Largest duration in seconds that a single check of the nodes counts.
_LOOK = 0.1
#: Time limit in seconds for the last answer if a node was killed and may have lost it.
_PATIENCE = 2.0
#: Time in seconds without any message after which missing messages count as lost.
_SILENCE = 20.0
#: Time in seconds without a step after which an error of the plant is final. Until then, the plant
#: repeats its request.
_STALL = 5.0


class Run(LaunchedNodes):
    """The nodes of a scenario as processes, and their topics as arrays.

    A run is a context manager: the nodes start on entry and have ended after exit.

    Parameters
    ----------
    scenario
        Name of a scenario in ``config/``, path of a parameter file, or the parameters.
    overrides
        Parameters for every node, which override those of the file:
        ``{'input_cost': [2.0, 2.0]}``.
    only
        Parameters for single nodes: ``{'estimator': {'initial_std': [...]}}``.
    seed
        Seed of all noise.
    lockstep
        Whether the nodes run in lockstep, reproducibly and as fast as possible; otherwise they run
        in real time.
    nodes
        Names of the nodes to start, in this order; by default all that the scenario needs.
    record
        Further signals to record, by topic.
    also
        Further nodes by name, each of an existing kind: ``{'observer': 'estimator'}``.
        Their outputs need a remap, or they mix with those of other nodes.
    remaps
        Other names for topics of one node: ``{'controller': {'estimate': 'ground_truth'}}``.
    recording
        A folder for a recording of all these topics, in the format of rosbag2; an earlier one in
        it is replaced.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> with kr.Run('mass_spring_damper') as run:
    ...     run.advance(10.0)
    ...     found = run.trajectory()
    >>> found.estimate.shape, found.covariance[-1].diagonal().round(4)
    ((1001, 2), array([0.0004, 0.0126]))
    """

    def __init__(
        self,
        scenario: str | Mapping[str, Any] = 'mass_spring_damper_2d',
        overrides: Mapping[str, Any] | None = None,
        *,
        only: Mapping[str, Mapping[str, Any]] | None = None,
        seed: int = 0,
        lockstep: bool = True,
        nodes: Sequence[str] | None = None,
        record: Mapping[str, Signal] | None = None,
        also: Mapping[str, str] | None = None,
        remaps: Mapping[str, Mapping[str, str]] | None = None,
        recording: str | Path | None = None,
    ) -> None:
        shared = {'seed': seed, 'lockstep': lockstep, 'run_until': -1.0, **(overrides or {})}
        if lockstep:
            shared.setdefault('lockstep_window', WINDOW)
        super().__init__(NodeSet(scenario, shared, only or {}, nodes, also or {}, remaps or {}))
        self.scenario = self._node_set.scenario
        self.lockstep = lockstep
        self._recording_folder = recording
        self._recording: RunRecording | None = None
        self._record = {**signals(self.scenario), **(record or {})}
        self._progress = Progress(self.scenario)
        self._until = -1.0
        self.drained = 0.0

    def __enter__(self) -> Run:
        self.open(sockets=not self.lockstep)
        with self.starting():
            self.launch(self._record_topics(), patience=120.0)
        return self

    def close(self) -> None:
        """Stop every node, and complete the recording."""
        try:
            super().close()
        finally:
            if self._recording is not None:
                self._recording.close()

    @property
    def names(self) -> Sequence[str]:
        """Names of the nodes that take part."""
        return self._node_set.names

    def spin(self, seconds: float = 0.05, until: Future | None = None) -> None:
        """Process messages for ``seconds``, check the nodes, and write the recording."""
        super().spin(seconds, until)
        if self._recording is not None:
            self._recording.flush()

    def _record_topics(self) -> Sequence[str]:
        """Begin the record of a run, and return its topics."""
        self.recorder = Recorder(self.node, self._record)
        self.recorder.on_message = self._progress.update
        if self._recording_folder is not None:
            self._recording = RunRecording(self.node, self._recording_folder)
            self.recorder.write_to(self._recording)
        self._confirmation: Confirmation | None = None
        if self.lockstep:
            self._confirmation = Confirmation(self.node, self.scenario, self.recorder)
            if self._recording is not None:
                self._confirmation.write_to(self._recording)
            return [*self.recorder.topics, self._confirmation.topic]
        return self.recorder.topics

    def advance(self, seconds: float, progress: Callable[[float], None] | None = None) -> None:
        """Let the plant continue for ``seconds`` of simulated time, and record all messages.

        Parameters
        ----------
        seconds
            Simulated duration, which is rounded to whole steps.
        progress
            Receives the simulated seconds of this call that are done.

        Raises
        ------
        NodeError
            If a node dies or does not answer.
        """
        start = max(self._until, 0.0)
        rate = self.scenario.rate
        self._until = start + round(seconds * rate) / rate
        self.set_parameter('run_until', self._until)
        loop_progress = self._progress
        loop_progress.aim(self._until)
        silence, last_step = 0.0, loop_progress.last
        while not loop_progress.arrived:
            start_of_spin = time.monotonic()
            self.spin(until=loop_progress.reached)
            # limited, since the loop is not late while this process gets no processor time
            silence += min(time.monotonic() - start_of_spin, _LOOK)
            if loop_progress.last != last_step:
                silence, last_step = 0.0, loop_progress.last
            elif silence > 1.0:
                self._raise_if_stuck(silence)
            if progress is not None:
                progress(max(0.0, self.elapsed - start))
        self._drain()

    @property
    def elapsed(self) -> float:
        """Simulated time in seconds since the first step, without pauses in real time."""
        return self._progress.elapsed

    def _raise_if_stuck(self, silence: float) -> None:
        plant = self.diagnostics.get('plant')
        if silence > _STALL and plant is not None and plant.level == DiagnosticStatus.ERROR:
            raise NodeError(plant.message)
        if silence > _SILENCE:
            statuses = '; '.join(
                f'{name}: {status.message}' for name, status in sorted(self.diagnostics.items())
            )
            raise NodeError(f'nothing received from the loop for {silence:.0f} s ({statuses})')

    def _drain(self) -> None:
        """Receive pending messages; in lockstep, all published messages without repetitions."""
        start = time.monotonic()
        if self.lockstep:
            end = start + (_PATIENCE if self._interrupted else _SILENCE)
            while self._behind() and time.monotonic() < end:
                self.spin()
            if self._behind() and not self._interrupted:
                raise NodeError('the last step was not answered')
            self.complete()
        else:
            count = -1
            while count != self.recorder.count():
                count = self.recorder.count()
                self.spin(0.1)
        if self._confirmation is not None and not self._interrupted:
            self._confirmation.drop_repeated()
        self.drained = time.monotonic() - start

    def complete(self) -> None:
        """Receive messages until all published messages are recorded.

        The counts of a killed node are unknown, so nothing is checked after a node was killed.

        Raises
        ------
        NodeError
            If messages are missing; the error has the numbers of recorded and published ones.
        """
        if self._interrupted:
            self.spin(_LOOK)
            return
        published = self._published()
        silence, count = 0.0, -1
        while self.recorder.missing(published):
            began = time.monotonic()
            self.spin(0.02)
            silence += min(time.monotonic() - began, _LOOK)
            if count != self.recorder.count():
                silence, count = 0.0, self.recorder.count()
            if silence > _SILENCE:
                raise NodeError(_incomplete(self.recorder.missing(published)))

    def _published(self) -> Counter[str]:
        """Return the number of messages that all nodes have published, by full topic name."""
        counts: Counter[str] = Counter()
        for name in self.processes:
            counts.update(self._published_by(name))
        return counts

    def _published_by(self, name: str) -> dict[str, int]:
        answer = self.call(Trigger, f'{name}/{SERVICE}', Trigger.Request())
        return dict(json.loads(answer.message))

    def _behind(self) -> bool:
        """Return whether the last answer, or the estimate after it, is still missing."""
        topic, raw = self.scenario.state.topic, self.recorder.raw
        covariances = len(raw[f'{topic}/covariance'])
        return not self._progress.answered or covariances < len(raw[topic])

    def refresh(self, *nodes: str) -> None:
        """Request current `diagnostics` from nodes.

        Nodes publish them when one of their topics has a new subscriber: for the plant the truth,
        for estimator and controller the estimate. Earlier reports, which a busy machine may
        deliver late, do not count.
        """
        state = self.scenario.state
        kind = message_type(state.type)
        earlier = {node: self._published_by(node)['/diagnostics'] for node in nodes}
        topics = {'ground_truth' if node == 'plant' else state.topic for node in nodes}
        listeners = [self.node.create_subscription(kind, t, lambda _: None, 1) for t in topics]

        def silent() -> list[str]:
            return [node for node in nodes if self._report_number(node) < earlier[node]]

        try:
            self.wait(
                lambda: not silent(), 10.0, lambda: f'nothing received from {", ".join(silent())}'
            )
        finally:
            for listener in listeners:
                self.node.destroy_subscription(listener)

    def _report_number(self, node: str) -> int:
        return int(self.reported(node, NUMBER) or -1)

    def trajectory(self) -> Trajectory:
        """Return the run so far as arrays with one row per step."""
        return to_trajectory(self.scenario, self.recorder, self._progress.first)


def _incomplete(missing: Mapping[str, tuple[int, int]]) -> str:
    """Return the error text of a run with lost messages."""
    counts = ', '.join(f'{topic} {got} of {sent}' for topic, (got, sent) in missing.items())
    return f'the record is incomplete: {counts} messages'
