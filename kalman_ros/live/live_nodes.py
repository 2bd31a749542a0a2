# SPDX-License-Identifier: Apache-2.0
"""The nodes of a live page: started together, their topics decoded as they arrive."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.task import Future

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import message_type
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.core import Array, Signal
from kalman_ros.harness.launched_nodes import LaunchedNodes
from kalman_ros.harness.node_set import NodeSet
from kalman_ros.harness.recorder import QUEUE
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.scenario import Scenario

#: The most samples of a topic between two calls of `take`; older ones are dropped.
_MOST = 5000
#: Seconds between two looks at the condition of `spin_until`.
_LOOK = 0.01
#: Seconds of simulated time that is never reached.
FOREVER = 1e9


class LiveNodes(LaunchedNodes):
    """The nodes of a scenario as processes, paused; a context manager.

    Parameters
    ----------
    file
        A parameter file.
    shared
        Parameters for every node, over those of the file.
    only
        Parameters for single nodes, over those.
    lockstep
        Whether the nodes step in turns; else they run in real time.
    """

    def __init__(
        self,
        file: Path,
        shared: Mapping[str, Any],
        only: Mapping[str, Mapping[str, Any]],
        *,
        lockstep: bool,
    ) -> None:
        shared = {**shared, 'lockstep': lockstep, 'run_until': -1.0}
        nodes = NodeSet(str(file), shared, only, None, {}, {})
        super().__init__(nodes)
        self.scenario: Scenario = nodes.scenario
        self._names = nodes.names
        self._samples: dict[str, deque[Sample]] = {}
        #: Called with each input of the plant.
        self.on_input: Callable[[], None] = lambda: None
        self._condition: Callable[[], bool] = lambda: False
        self._wake = Future()

    def __enter__(self) -> LiveNodes:
        self.open(sockets=True)
        with self.starting():
            topics = [self._watch(topic, signal) for topic, signal in _signals(self.scenario)]
            self._push = self._disturbance()
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.node.create_timer(_LOOK, self._look, clock=steady)
            self.launch(topics)
        return self

    def _watch(self, topic: str, signal: Signal) -> str:
        """Decode every message of a topic; return its full name."""
        codec = codec_of(signal)
        samples = self._samples[topic] = deque(maxlen=_MOST)
        keep = partial(_keep, WireReader(codec), samples)

        def take(data: bytes) -> None:
            keep(data)
            if topic == self.scenario.input.topic:
                self.on_input()

        return str(self.node.watch(codec.message_type, topic, take, QUEUE).topic_name)

    def _disturbance(self) -> tuple[WireWriter, Any] | None:
        if not self.scenario.input.fields:
            return None
        write = WireWriter(codec_of(self.scenario.input))
        return write, self.node.create_publisher(write.message_type, 'disturbance', 10)

    def take(self) -> dict[str, list[Sample]]:
        """Return the samples of each topic received since the last call."""
        found = {topic: list(samples) for topic, samples in self._samples.items()}
        for samples in self._samples.values():
            samples.clear()
        return found

    def spin_until(self, seconds: float, condition: Callable[[], bool]) -> None:
        """Process messages for ``seconds``, or until a condition holds.

        Each wait of the executor leaks a few bytes, so a loop should wait rarely.
        """
        self._condition, self._wake = condition, Future()
        self.spin(seconds, until=self._wake)

    def _look(self) -> None:
        if not self._wake.done() and self._condition():
            self._wake.set_result(None)

    def push(self, disturbance: Array) -> None:
        """Add a disturbance (m,) to the plant's input from now on; zero ends it."""
        if self._push is not None:
            write, publisher = self._push
            publisher.publish(write(self.node.get_clock().now().nanoseconds, disturbance))

    def run_until(self, seconds: float) -> None:
        """Let the plant continue to a simulated time, without waiting for its response."""
        service = 'plant/set_parameters'
        if service not in self._clients:
            self._clients[service] = self.node.create_client(SetParameters, service)
        message = Parameter('run_until', value=float(seconds)).to_parameter_msg()
        self._clients[service].call_async(SetParameters.Request(parameters=[message]))

    def reconfigure(self, node: str, values: Mapping[str, Any]) -> None:
        """Change parameters of a node that it reads only when it is configured.

        Its state is lost. ValueError with the reason if it cannot be configured with them.
        """
        for transition in ('deactivate', 'cleanup'):
            self.change_state(node, transition)
        self.set_parameters(values, node)
        if not (self.change_state(node, 'configure') and self.change_state(node, 'activate')):
            self.spin(0.2)
            status = self.diagnostics.get(node)
            raise ValueError(status.message if status else f'the {node} cannot be configured')


def _keep(read: WireReader, samples: deque[Sample], data: bytes) -> None:
    try:
        samples.append(read(data))
    except (LookupError, ValueError):  # an array of the message is too short
        return


def _signals(scenario: Scenario) -> list[tuple[str, Signal]]:
    """Return the topics of a loop with their signals."""
    state = scenario.state
    found = {'ground_truth': state, state.topic: state}
    whole = covariance_signal(state)
    found[whole.topic] = whole
    if scenario.input.fields:
        found[scenario.input.topic] = scenario.input
    for name, source in scenario.sensors.items():
        innovation = innovation_signal(state, name, source.sensor.output)
        found[source.signal.topic] = source.signal
        found[innovation.topic] = innovation
    for signal in found.values():
        message_type(signal.type)
    return list(found.items())
