# SPDX-License-Identifier: Apache-2.0
"""Nodes of a live page, whose topics are decoded as they are received."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.srv import SetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.task import Future

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.core import Array, Signal
from kalman_ros.harness.launched_nodes import LaunchedNodes
from kalman_ros.harness.node_set import NodeSet
from kalman_ros.harness.recorder import QUEUE
from kalman_ros.harness.to_trajectory import signals
from kalman_ros.nodes.controller.motions import PATH
from kalman_ros.scenario import Scenario

#: Largest number of samples of a topic between two calls of `take`; older samples are dropped.
_MOST = 5000
#: Interval in seconds of checks of the condition of `spin_until`.
_LOOK = 0.01
#: Number of paths that wait for the controller.
_PATHS = 10
#: Simulated time in seconds that is never reached.
FOREVER = 1e9


class LiveNodes(LaunchedNodes):
    """The nodes of a scenario as paused processes; a context manager.

    Parameters
    ----------
    file
        Parameter file.
    shared
        Parameters for every node, which override those of the file.
    only
        Parameters for single nodes, which override the others.
    lockstep
        Whether the nodes run in lockstep; otherwise they run in real time.
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
        #: Function that is called for each input of the plant.
        self.on_input: Callable[[], None] = lambda: None
        self._condition: Callable[[], bool] = lambda: False
        self._wake = Future()

    def __enter__(self) -> LiveNodes:
        self.open(sockets=True)
        watched = signals(self.scenario, self.scenario.sensors)
        with self.starting():
            topics = [self._watch(topic, signal) for topic, signal in watched.items()]
            self._push = self._create_disturbance()
            self._paths = self.node.create_publisher(PathMessage, PATH, _PATHS)
            self.call_every(_LOOK, self._check_condition)
            self.launch(topics)
        return self

    def _watch(self, topic: str, signal: Signal) -> str:
        """Decode every message of a topic; return the full name of the topic."""
        codec = codec_of(signal)
        samples = self._samples[topic] = deque(maxlen=_MOST)
        keep = partial(_append_sample, WireReader(codec), samples)

        def take(data: bytes) -> None:
            keep(data)
            if topic == self.scenario.input.topic:
                self.on_input()

        return str(self.node.watch(codec.message_type, topic, take, QUEUE).topic_name)

    def _create_disturbance(self) -> tuple[WireWriter, Any] | None:
        if not self.scenario.input.fields:
            return None
        write = WireWriter(codec_of(self.scenario.input))
        return write, self.node.create_publisher(write.message_type, 'disturbance', 10)

    def call_every(self, seconds: float, callback: Callable[[], None]) -> None:
        """Call a function at an interval in real time, also while a service is waited for."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(seconds, callback, clock=steady)

    def take(self) -> dict[str, list[Sample]]:
        """Return the samples of each topic that were received since the last call."""
        received = {topic: list(samples) for topic, samples in self._samples.items()}
        for samples in self._samples.values():
            samples.clear()
        return received

    def spin_until(self, seconds: float, condition: Callable[[], bool]) -> None:
        """Process messages for ``seconds``, or until a condition holds.

        Each wait of the executor leaks a few bytes, so a loop should call this rarely.
        """
        self._condition, self._wake = condition, Future()
        self.spin(seconds, until=self._wake)

    def _check_condition(self) -> None:
        if not self._wake.done() and self._condition():
            self._wake.set_result(None)

    def push(self, disturbance: Array) -> None:
        """Add a disturbance (m,) to the input of the plant from now on; zero ends it."""
        if self._push is not None:
            write, publisher = self._push
            publisher.publish(write(self.node.get_clock().now().nanoseconds, disturbance))

    def follow(self, points: Array) -> None:
        """Publish a path through points (K, 3), in metres, for the controller to follow."""
        path = PathMessage()
        for x, y, z in points.tolist():
            pose = PoseStamped()
            pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, z
            path.poses.append(pose)
        self._paths.publish(path)

    def run_until(self, seconds: float) -> None:
        """Let the plant continue to a simulated time (s), without waiting for its response."""
        service = 'plant/set_parameters'
        if service not in self._clients:
            self._clients[service] = self.node.create_client(SetParameters, service)
        message = Parameter('run_until', value=float(seconds)).to_parameter_msg()
        self._clients[service].call_async(SetParameters.Request(parameters=[message]))

    def reconfigure(self, node: str, values: Mapping[str, Any]) -> None:
        """Change parameters that a node reads only during its configuration.

        The state of the node is lost.

        Raises
        ------
        ValueError
            If the node cannot be configured with the values, with the reason.
        """
        for transition in ('deactivate', 'cleanup'):
            self.change_state(node, transition)
        self.set_parameters(values, node)
        if not (self.change_state(node, 'configure') and self.change_state(node, 'activate')):
            self.spin(0.2)
            status = self.diagnostics.get(node)
            raise ValueError(status.message if status else f'the {node} cannot be configured')


def _append_sample(read: WireReader, samples: deque[Sample], data: bytes) -> None:
    try:
        samples.append(read(data))
    except (LookupError, ValueError):  # an array in the message is too short
        return
