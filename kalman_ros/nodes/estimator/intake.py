# SPDX-License-Identifier: Apache-2.0
"""When the estimator fuses messages: as they arrive, or once a step of the plant is complete.

Both intakes subscribe to the sensors and the input, fuse, and publish the new belief.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from time import monotonic
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from sensor_msgs.msg import TimeReference

from kalman_ros.nodes.estimator.host import EstimatorHost
from kalman_ros.nodes.middleware import private
from kalman_ros.nodes.middleware.meeting import Meeting
from kalman_ros.nodes.middleware.meters import Latency
from kalman_ros.nodes.middleware.topics import QUEUE, sensor_queue
from kalman_ros.pipeline.fuser import Channel, Fuser
from kalman_ros.pipeline.lockstep_fuser import LockstepFuser
from kalman_ros.pipeline.reading import Reading
from kalman_ros.scenario import Scenario

#: A clock that goes back by less is out of order, not reset.
_BACK = Duration(seconds=-0.1)
#: Seconds after which the time of a message is no longer the present.
_LONG = 0.05
#: The most innovations that are published at once in real time.
_MOST_INNOVATIONS = 8


class RealTimeIntake:
    """Fuses all messages that are waiting, on every topic, and publishes one estimate.

    Without backlog that is one estimate per reading. Under overload there are fewer estimates, and
    they are still up to date.

    Parameters
    ----------
    node
        The estimator's node.
    fuser
        Fuses the messages.
    latency
        From reception to publication.
    """

    def __init__(self, node: EstimatorHost, fuser: Fuser, latency: Latency) -> None:
        self._node = node
        self._fuser, self._latency = fuser, latency
        self._last_time = -1
        self._clock = private.clock_handle(node)
        self._meeting = Meeting(self._input_connected)
        for channel in fuser.channels.values():
            queue = sensor_queue(reliable=self._scenario.sensors[channel.name].reliable)
            self._listen(channel, queue)
        if self._scenario.input.fields:
            self._listen(fuser.input, QUEUE)
        back = JumpThreshold(min_forward=None, min_backward=_BACK, on_clock_change=False)
        watch = node.get_clock().create_jump_callback(back, post_callback=self._on_clock_back)
        node.at_the_end(watch.unregister)
        if node.options.publish_rate:
            node.create_timer(1.0 / node.options.publish_rate, self._publish_now)

    @property
    def _scenario(self) -> Scenario:
        scenario: Scenario = self._node.scenario
        return scenario

    def _listen(self, channel: Any, queue: Any) -> None:
        take = partial(self._on_message, channel)
        _connect(self._node, channel, self._node.subscribe_in_batches, take, queue)

    def _now(self) -> int:
        with self._clock:
            return int(self._clock.get_now().nanoseconds)

    def _input_connected(self) -> bool:
        """Return whether the input has a publisher, if the state rests until the first input."""
        resting = self._node.options.rest_until_input and not self._fuser.inputs.total()
        subscription = self._fuser.input.subscription
        return not resting or subscription is None or subscription.get_publisher_count() > 0

    def _on_message(self, first: Channel, data: bytes) -> None:
        start, now, fuser = monotonic(), self._now(), self._fuser
        received = self._waiting_readings(first, data, now)
        # no input waits long behind a single reading
        if first is fuser.input or len(received) > 1:
            received += self._waiting_inputs(first, data, now)
        if monotonic() - start > _LONG:  # as where sensors were mounted meanwhile
            now = self._now()
        fused = fuser.fuse(received, now or None)
        corrected = [reading for reading in fused if reading.correction is not None]
        if not corrected or not self._meeting.over:
            return
        online = fuser.online
        if online.time is not None and not self._node.options.publish_rate:
            self._node.publish(online.time, online.belief)
            done = monotonic()
            self._latency.add(done - start)
            for reading in corrected:
                age = ((now or reading.time) - reading.time) * 1e-9 + done - start
                fuser.channels[reading.source].age.add(age)
        self._node.publish_innovations(corrected, _MOST_INNOVATIONS)

    def _waiting_readings(self, first: Channel, data: bytes, now: int) -> list[Reading]:
        """Return the readings that are waiting; ``data``, received on ``first``, may be one."""
        received, sensors = [], self._node.scenario.sensors
        for name, channel in self._fuser.channels.items():
            messages, missed = channel.take([data] if channel is first else [])
            if not messages or not sensors[name].timed.enabled:
                continue
            self._fuser.overrun(channel, missed)
            read = partial(channel.read, source=sensors[name])
            for message in messages:
                reading = self._node.intake.read(channel.topic, read, message)
                if reading is None:
                    continue
                channel.rate.count()
                reading.time = reading.time or now
                if now:  # simulated time may not have started
                    channel.measure_lead(reading.time, now)
                received.append(reading)
        return received

    def _waiting_inputs(self, first: Channel, data: bytes, now: int) -> Iterator[Reading]:
        """Yield the inputs that are waiting; ``data``, received on ``first``, may be one."""
        channel = self._fuser.input
        if channel.subscription is None:
            return
        messages, missed = channel.take([data] if channel is first else [])
        self._fuser.overrun(channel, missed)
        for message in messages:
            input = self._node.intake.read(channel.topic, self._fuser.read_input, message)
            if input is not None:
                input.time = input.time or now
                yield input

    def _publish_now(self) -> None:
        online = self._fuser.online
        if online.time is None:
            return
        time = max(self._now(), online.time)
        if time != self._last_time:  # simulated time may pause between two ticks of a timer
            self._last_time = time
            self._node.publish(time, self._fuser.predicted(time))

    def _on_clock_back(self, jump: Any) -> None:
        """Restart when simulated time goes back, as when a bag is replayed."""
        back = -jump.delta.nanoseconds * 1e-9
        words = f'the clock went back by {back:.3g} s: restarting'
        self._node.get_logger().warning(words, throttle_duration_sec=1.0)
        self._fuser.restart()


class LockstepIntake:
    """Passes the messages of the plant and the controller to a `LockstepFuser`.

    Parameters
    ----------
    node
        The estimator's node.
    fuser
        Fuses the messages.
    """

    def __init__(self, node: EstimatorHost, fuser: Fuser) -> None:
        steps = LockstepFuser(fuser, node, node.get_logger().info, node.resolve_topic_name)
        self._steps = steps
        subscribe = partial(node.create_subscription, raw=True)
        for channel in fuser.channels.values():
            _connect(node, channel, subscribe, partial(self._on_reading, channel), QUEUE)
        if fuser.scenario.input.fields:
            _connect(node, fuser.input, subscribe, steps.on_input, QUEUE)
        node.create_subscription(TimeReference, 'tick', steps.on_tick, QUEUE, raw=True)

    def _on_reading(self, channel: Any, data: bytes) -> None:
        self._steps.on_reading(channel.name, data)
        channel.rate.count()


def _connect(node: EstimatorHost, channel: Any, subscribe: Any, callback: Any, queue: Any) -> None:
    """Subscribe to a channel's topic; if it is used, a missing publisher is reported."""
    scenario: Scenario = node.scenario
    source = None if channel.name is None else scenario.sensors[channel.name]
    signal = scenario.input if source is None else source.signal
    channel.subscription = subscribe(channel.message_type, signal.topic, callback, queue)
    channel.topic = channel.subscription.topic_name
    if source is None or source.timed.enabled:
        node.diagnostics.connections.expect(channel.subscription)
