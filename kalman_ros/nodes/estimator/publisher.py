# SPDX-License-Identifier: Apache-2.0
"""The outputs of an estimator: first the estimate, then, to subscribers, the details."""

from __future__ import annotations

from typing import Any

from kalman_ros.core import Gaussian, Signal, Space
from kalman_ros.core.geodesy import Origin
from kalman_ros.estimators.filter import Correction
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import HISTORY, KEPT
from kalman_ros.pipeline.datum_file import write_datum
from kalman_ros.pipeline.estimate_topics import EstimateTopics, InnovationTopic, Topic
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.global_topics import GlobalTopics
from kalman_ros.pipeline.odometry_topic import OdometryTopic
from kalman_ros.scenario import Scenario


def _publisher(node: Host, topic: Topic) -> Any:
    return node.create_publisher(topic.write.message_type, topic.name, HISTORY)


class EstimatePublisher:
    """Publishes a belief on ``estimate``, ``estimate/state`` and ``estimate/covariance``."""

    def __init__(
        self, node: Host, scenario: Scenario, options: EstimatorOptions, origin: Origin
    ) -> None:
        topics = self._topics = EstimateTopics(scenario, options.frame, options.child_frame)
        self._publisher = _publisher(node, topics.estimate)
        self._state_publisher = _publisher(node, topics.state)
        self._covariance_publisher = _publisher(node, topics.covariance)
        self._odometry = None
        if options.publish_odometry:
            self._odometry = OdometryTopic(scenario, options.frame, options.child_frame)
            kind, name = self._odometry.message_type, self._odometry.signal.topic
            self._odometry_publisher = node.create_publisher(kind, name, HISTORY)
        self._globe = GlobalPublisher(node, scenario, options, origin)
        #: The number of beliefs published.
        self.count = 0

    def publish(self, time: int, belief: Gaussian) -> None:
        """Publish a ``belief`` at ``time``, in nanoseconds."""
        self.count += 1
        topics, (x, P) = self._topics, belief
        self._publisher.publish(topics.estimate.write(time, x, P))
        if self._state_publisher.get_subscription_count():
            self._state_publisher.publish(topics.state.write(time, x))
        if self._covariance_publisher.get_subscription_count():
            self._covariance_publisher.publish(topics.covariance.write(time, P.ravel()))
        if self._odometry is not None and self._odometry_publisher.get_subscription_count():
            self._odometry_publisher.publish(self._odometry(time, belief))
        if self._globe.is_used:
            self._globe.publish(time, belief)


class GlobalPublisher:
    """Publishes the datum once it is known, and the estimate as a fix if that is requested."""

    def __init__(
        self, node: Host, scenario: Scenario, options: EstimatorOptions, origin: Origin
    ) -> None:
        topics = self._topics = GlobalTopics(scenario, options, origin)
        self._origin, self._file = origin, options.datum_file
        self._logger = node.get_logger()
        self._known = False
        #: Whether the estimate has a place on earth, or may get one.
        self.is_used = topics.datum is not None
        if topics.datum is not None:
            name, kind = topics.datum.signal.topic, topics.datum.message_type
            self._datum_publisher = node.create_publisher(kind, name, KEPT)
        if topics.fix is not None:
            name, kind = topics.fix.signal.topic, topics.fix.message_type
            self._fix_publisher = node.create_publisher(kind, name, HISTORY)
        if origin.plane is not None:
            self._file = ''  # it is there already
            self._publish_datum(node.get_clock().now().nanoseconds)

    def publish(self, time: int, belief: Gaussian) -> None:
        """Publish a ``belief`` at ``time``, in nanoseconds."""
        topics = self._topics
        if self._origin.plane is None or topics.datum is None:
            return
        if not self._known:
            self._publish_datum(time)
        if topics.fix is not None and self._fix_publisher.get_subscription_count():
            self._fix_publisher.publish(topics.fix(time, belief))

    def _publish_datum(self, time: int) -> None:
        self._known = True
        if self._topics.datum is None or self._origin.plane is None:
            return
        where = self._origin.plane.datum
        self._datum_publisher.publish(self._topics.datum(time))
        self._logger.info(f'datum: {where}')
        if self._file:
            try:
                write_datum(self._file, where)
            except OSError as error:
                self._logger.warning(f"datum_file: '{self._file}': {error.strerror}")


class InnovationPublisher:
    """Publishes a sensor's innovations on ``estimate/innovation/SENSOR``."""

    def __init__(self, node: Host, state: Signal, sensor: str, output: Space) -> None:
        self._write = InnovationTopic(state, sensor, output)
        self._publisher = _publisher(node, self._write.topic)

    def __call__(self, time: int, correction: Correction) -> None:
        """Publish the innovation of the reading taken at ``time`` if the topic has subscribers."""
        if self._publisher.get_subscription_count():
            message = self._write(time, correction)
            if message is not None:
                self._publisher.publish(message)
