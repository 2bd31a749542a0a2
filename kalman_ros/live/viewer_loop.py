# SPDX-License-Identifier: Apache-2.0
"""Loop that passes the topics of a ROS graph to the viewers that subscribe to them."""

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

#: Intervals in seconds of checks for messages, of the subscriptions of viewers, and of the graph.
_MESSAGES, _SUBSCRIPTIONS, _GRAPH = 0.02, 0.1, 0.5
#: Topic of the changes of parameters.
_EVENTS = OfferedTopic(
    '/parameter_events', 'rcl_interfaces/msg/ParameterEvent', (qos_profile_parameter_events,), ''
)


class ViewerLoop:
    """A loop that serves a graph until a signal ends the process.

    A topic is subscribed to only while a viewer is subscribed to it, except for changes of
    parameters.

    Parameters
    ----------
    graph
        Topics of the graph.
    server
        Server of the viewers.
    """

    def __init__(self, graph: GraphTopics, server: ViewerServer) -> None:
        self._graph, self._server = graph, server
        self._offered: dict[str, OfferedTopic] = {}
        graph.subscribe(_EVENTS)
        self._new_subscriptions: SimpleQueue[str] = SimpleQueue()
        server.on_subscription = self._new_subscriptions.put

    def run(self, check: Callable[[], None] = lambda: None) -> None:
        """Pass on messages; call ``check`` regularly, which may end the loop by an exception."""
        graph_checked = subscriptions_checked = 0.0
        while True:
            now = time.monotonic()
            if now - graph_checked >= _GRAPH:
                graph_checked = now
                check()
                for topic in self._graph.new():
                    self._offered[topic.name] = topic
                    self._server.offer(topic.name, topic.kind)
            if now - subscriptions_checked >= _SUBSCRIPTIONS:
                subscriptions_checked = now
                self._update_subscriptions()
            self._forward_messages()
            idle = self._graph.subscribed == [_EVENTS.name]
            time.sleep(_SUBSCRIPTIONS if idle else _MESSAGES)

    def _update_subscriptions(self) -> None:
        """Subscribe to the topics to which viewers are subscribed, and to no other topic.

        The messages of a latched topic, such as static transforms, are received again for each new
        viewer.
        """
        for _ in range(self._new_subscriptions.qsize()):
            topic = self._offered[self._new_subscriptions.get()]
            if topic.kept and topic.name in self._graph.subscribed:
                self._graph.unsubscribe(topic)
        requested, subscribed = self._server.wanted, {*self._graph.subscribed}
        for name, topic in self._offered.items():
            if name == _EVENTS.name or (name in requested) == (name in subscribed):
                continue
            if name in requested:
                self._graph.subscribe(topic)
            else:
                self._graph.unsubscribe(topic)

    def _forward_messages(self) -> None:
        for message in self._graph.take():
            if message.topic == _EVENTS.name:
                self._show_changes(message.data)
            if message.topic in self._offered:
                self._server.publish(message.topic, message.data, message.received)

    def _show_changes(self, data: bytes) -> None:
        """Show the parameters that an event reports as changed."""
        try:
            event = decode(data, ParameterEvent)
        except UndecodableError:
            return
        self._server.show(dict(changed(event)))
