# SPDX-License-Identifier: Apache-2.0
"""One run of the nodes, from start to stop."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from kalman_ros.codecs.wire import leading_stamp
from kalman_ros.core import Signal
from kalman_ros.nodes.diagnostics import HEARD_BY, HEARS
from kalman_ros.simulation import scenario as scenarios
from kalman_ros.simulation.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from . import executables
from .domain import Domain
from .gather import signals, trajectory
from .interrupts import deferred
from .parameters import from_file, yaml_value
from .process import NodeProcess, isolated
from .recorder import Recorder

NODES = ('estimator', 'controller', 'monitor', 'plant')


class NodeError(RuntimeError):
    """A node died, would not start, or did not answer; the message names it and says why."""


class Run:
    """The nodes of a scenario as processes, and their topics as arrays.

    Use as a context manager: the nodes start on entry and are gone after exit.

    Parameters
    ----------
    scenario
        The name of a scenario in ``config/``, or the path of a parameter file.
    overrides
        Parameters for every node, over those of the file: ``{'input_cost': [2.0, 2.0]}``.
    only
        Parameters for one node: ``{'estimator': {'initial_std': [...]}}``.
    seed
        Of all noise.
    lockstep
        Step in turns, reproducibly and as fast as it goes; else in real time.
    nodes
        Which nodes to start, in this order.
    record
        Further signals to gather, by topic.
    """

    def __init__(
        self,
        scenario: str = 'mass_spring_damper_2d',
        overrides: Mapping[str, Any] | None = None,
        *,
        only: Mapping[str, Mapping[str, Any]] | None = None,
        seed: int = 0,
        lockstep: bool = True,
        nodes: Sequence[str] = NODES,
        record: Mapping[str, Signal] | None = None,
    ) -> None:
        self.file = executables.config(scenario)
        shared = {'seed': seed, 'lockstep': lockstep, 'run_until': -1.0, **(overrides or {})}
        self._parameters = {name: {**shared, **(only or {}).get(name, {})} for name in NODES}
        self.scenario: Scenario = scenarios.build(
            {**from_file(self.file, 'plant'), **self._parameters['plant']}
        )
        self.lockstep = lockstep
        self._names = tuple(nodes)
        self._record = {**signals(self.scenario), **(record or {})}
        self.processes: dict[str, NodeProcess] = {}
        self.diagnostics: dict[str, DiagnosticStatus] = {}
        self._until = -1.0
        self._goal = 0
        self._reached = Future()
        self.drained = 0.0
        self._last = self._first = self._answered = -1

    def __enter__(self) -> Run:
        self._domain = Domain()
        self._folder = tempfile.TemporaryDirectory(prefix='kalman_ros_')
        self._environment = isolated(self._domain.id)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=self._domain.id)
        try:
            self._listen()
            for name in self._names:
                self.start(name)
            self._until_ready()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def domain(self) -> int:
        """The ROS domain that the nodes run in."""
        return self._domain.id

    def _listen(self) -> None:
        self._node = rclpy.create_node(
            'harness', context=self._context, start_parameter_services=False
        )
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.recorder = Recorder(self._node, self._record)
        self.recorder.on_message = self._on_message
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 50)
        self._parameter_clients: dict[str, AsyncParameterClient] = {}

    def _on_message(self, topic: str, data: bytes) -> None:
        if topic == self.scenario.input.topic:
            self._answered = leading_stamp(data)
        elif topic == 'ground_truth':
            self._last = leading_stamp(data)
            if self._first < 0:
                self._first = self._last
                self._goal += self._first
            if self._last >= self._goal and not self._reached.done():
                self._reached.set_result(None)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = status

    def start(self, name: str) -> None:
        """Start a node; one that was killed may be started again."""
        command = [str(executables.executable(name)), '--ros-args']
        command += ['--params-file', str(self.file)]
        for key, value in self._parameters[name].items():
            command += ['-p', f'{key}:={yaml_value(value)}']
        log = Path(self._folder.name) / f'{name}.log'
        with deferred():
            self.processes[name] = NodeProcess(name, command, self._environment, log)

    def kill(self, name: str, number: int = 9) -> None:
        """Send a signal to a node, SIGKILL unless told otherwise, and wait for its end."""
        process = self.processes.pop(name)
        process.signal(number)
        if not process.wait(10.0):
            raise NodeError(f'the {name} did not end within 10 s of signal {number}')

    def spin(self, seconds: float = 0.05, until: Future | None = None) -> None:
        """Take in what comes for so long, and see whether every node is still there.

        It ends sooner when the future ``until`` is done.
        """
        done = until or Future()
        with deferred(lambda: done.done() or done.set_result(None)):
            self._executor.spin_until_future_complete(done, seconds)
        for name, process in self.processes.items():
            if process.exit_code is not None:
                raise NodeError(f'the {name} died: {process.last_words()}')

    def wait(
        self, condition: Callable[[], bool], seconds: float, trouble: Callable[[], str]
    ) -> None:
        """Take in what comes until ``condition`` holds; NodeError after so many seconds."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise NodeError(f'{trouble()} within {seconds:g} s')
            self.spin(0.02)

    def _until_ready(self) -> None:
        """Wait until every publisher has found all who listen: what comes earlier is lost."""
        self.wait(lambda: not self._unready(), 30.0, lambda: f'not ready: {self._unready()}')

    def _unready(self) -> str:
        """Return what is still missing; nothing if every connection is there."""
        silent = [name for name in self._names if name not in self.diagnostics]
        if silent:
            return f'no word from {", ".join(silent)}'
        connections = [
            (value.key, int(value.value))
            for name in self._names
            for value in self.diagnostics[name].values
            if value.key.startswith((HEARD_BY, HEARS))
        ]
        listeners = Counter(self.recorder.topics)
        listeners.update(key[len(HEARS) :] for key, _ in connections if key.startswith(HEARS))
        for key, count in connections:
            topic = key[len(HEARD_BY) :]
            if key.startswith(HEARD_BY) and count < listeners[topic]:
                return f'{count} of {listeners[topic]} hear {topic}'
        return ''

    def advance(self, seconds: float, progress: Callable[[float], None] | None = None) -> None:
        """Let the plant go on for so many simulated seconds and gather all that comes of it.

        Parameters
        ----------
        seconds
            How long; in real time it takes as long.
        progress
            Called now and then with the simulated seconds of this call that are done.

        Raises
        ------
        NodeError
            If a node dies, or one does not answer.
        """
        start = max(self._until, 0.0)
        self._until = start + seconds
        self.set_parameter('run_until', self._until)
        self._goal = max(self._first, 0) + round((self._until - 0.5 / self.scenario.rate) * 1e9)
        self._reached = Future()
        last_news = time.monotonic()
        seen = self._last
        while self.elapsed < self._until - 0.5 / self.scenario.rate:
            self.spin(until=self._reached)
            if self._last != seen:
                seen, last_news = self._last, time.monotonic()
            elif time.monotonic() - last_news > 1.0:
                self._complain(time.monotonic() - last_news)
            if progress is not None:
                progress(max(0.0, self.elapsed - start))
        self._drain()

    @property
    def elapsed(self) -> float:
        """Simulated seconds since the first step."""
        return (self._last - self._first) * 1e-9

    def _complain(self, silence: float) -> None:
        plant = self.diagnostics.get('plant')
        if plant is not None and plant.level == DiagnosticStatus.ERROR:
            raise NodeError(plant.message)
        if silence > 20.0:
            said = '; '.join(
                f'{name}: {status.message}' for name, status in sorted(self.diagnostics.items())
            )
            raise NodeError(f'nothing came from the loop for {silence:.0f} s ({said})')

    def _drain(self) -> None:
        """Take in what is still under way: the last answer, and all until nothing comes."""
        start = time.monotonic()
        end = start + 2.0
        while self.lockstep and self._answered < self._last and time.monotonic() < end:
            self.spin()
        count = -1
        while count != self.recorder.count():
            count = self.recorder.count()
            self.spin(0.1)
        self.drained = time.monotonic() - start

    @property
    def node(self) -> Any:
        """The `rclpy` node of this process in the run's domain, to publish and subscribe with."""
        return self._node

    def set_parameter(self, name: str, value: Any, node: str = 'plant') -> None:
        """Change a parameter of a node; ValueError with the reason if it is refused."""
        client = self._parameter_clients.setdefault(node, AsyncParameterClient(self._node, node))
        self.wait(client.services_are_ready, 20.0, lambda: f'the {node} was not reached')
        future = client.set_parameters([Parameter(name, value=value)])
        self.spin(1.0, until=future)
        self.wait(future.done, 10.0, lambda: f'the {node} did not take {name}')
        result = future.result().results[0]
        if not result.successful:
            raise ValueError(result.reason)

    def reported(self, node: str, key: str) -> str:
        """Return a value that a node last said of itself on ``/diagnostics``, '' if it did not."""
        status = self.diagnostics.get(node)
        values = [] if status is None else status.values
        return next((str(value.value) for value in values if value.key == key), '')

    def trajectory(self) -> Trajectory:
        """Return the run so far as arrays, step by step."""
        return trajectory(self.scenario, self.recorder, self._first)

    def close(self) -> None:
        """Stop every node and give everything back; a signal meanwhile waits until it is done."""
        with deferred():
            self._close()

    def _close(self) -> None:
        for process in self.processes.values():
            process.signal(2)
        for process in self.processes.values():
            process.wait(3.0)
            process.stop()
        if hasattr(self, '_node'):
            self._executor.shutdown()
            self._node.destroy_node()
        self._context.try_shutdown()
        self._folder.cleanup()
        self._domain.close()
