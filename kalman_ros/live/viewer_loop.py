# SPDX-License-Identifier: Apache-2.0
"""Passes the topics of a ROS graph on to viewers: those that a viewer is subscribed to."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import SimpleQueue

from rcl_interfaces.msg import ParameterEvent
from rclpy.qos import qos_profile_parameter_events

from kalman_ros.codecs.messages import UndecodableError, decode
from kalman_ros.harness.graph_topics import GraphTopics, OfferedTopic

from .graph_parameters import changed
from .viewer_server import ViewerServer

#: Seconds between two looks for messages, at the subscriptions of viewers, and at the graph.
_MESSAGES, _SUBSCRIPTIONS, _GRAPH = 0.02, 0.1, 0.5
#: What nodes publish when a parameter changes.
_EVENTS = OfferedTopic(
    '/parameter_events', 'rcl_interfaces/msg/ParameterEvent', (qos_profile_parameter_events,), ''
)


class ViewerLoop:
    """Serves a graph until a signal.

    Nothing is subscribed to without a viewer that is, except to changes of parameters.

    Parameters
    ----------
    graph
        The topics.
    server
        Of the viewers.
    """

    def __init__(self, graph: GraphTopics, server: ViewerServer) -> None:
        self._graph, self._server = graph, server
        self._offered: dict[str, OfferedTopic] = {}
        graph.subscribe(_EVENTS)
        self._asked: SimpleQueue[str] = SimpleQueue()
        server.on_subscription = self._asked.put

    def run(self, check: Callable[[], None] = lambda: None) -> None:
        """Pass messages on; call ``check`` now and then, to end by an exception."""
        looked = followed = 0.0
        while True:
            now = time.monotonic()
            if now - looked >= _GRAPH:
                looked = now
                check()
                for topic in self._graph.new():
                    self._offered[topic.name] = topic
                    self._server.offer(topic.name, topic.kind)
            if now - followed >= _SUBSCRIPTIONS:
                followed = now
                self._follow()
            self._pass_on()
            idle = self._graph.subscribed == [_EVENTS.name]
            time.sleep(_SUBSCRIPTIONS if idle else _MESSAGES)

    def _follow(self) -> None:
        """Subscribe to what viewers are subscribed to, and to nothing else.

        What is kept for later subscribers, such as fixed transforms, is received once more for
        each viewer.
        """
        for _ in range(self._asked.qsize()):
            topic = self._offered[self._asked.get()]
            if topic.kept and topic.name in self._graph.subscribed:
                self._graph.unsubscribe(topic)
        wanted, subscribed = self._server.wanted, {*self._graph.subscribed}
        for name, topic in self._offered.items():
            if name == _EVENTS.name or (name in wanted) == (name in subscribed):
                continue
            if name in wanted:
                self._graph.subscribe(topic)
            else:
                self._graph.unsubscribe(topic)

    def _pass_on(self) -> None:
        for message in self._graph.take():
            if message.topic == _EVENTS.name:
                self._show(message.data)
            if message.topic in self._offered:
                self._server.publish(message.topic, message.data, message.received)

    def _show(self, data: bytes) -> None:
        """Show the parameters that have changed."""
        try:
            event = decode(data, ParameterEvent)
        except UndecodableError:
            return
        self._server.show(dict(changed(event)))
