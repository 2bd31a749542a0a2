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

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.tick import read_tick
from kalman_ros.scenario import Scenario

from .channel import Channel, SensorChannel
from .fuser import Fuser, Received
from .meeting import Meeting
from .meters import Latency
from .step_assembler import StepAssembler
from .topics import QUEUE, sensor_queue

#: No clock is published so out of order; less is as good as no jump.
_BACK = Duration(seconds=-0.1)
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

    def __init__(self, node: Any, fuser: Fuser, latency: Latency) -> None:
        self._node: Any = node
        self._fuser, self._latency = fuser, latency
        self._last_time = -1
        self._meeting = Meeting(self._hears_input)
        for channel in fuser.channels.values():
            queue = sensor_queue(reliable=self._scenario.sensors[channel.name].reliable)
            _listen(node, channel, partial(self._on_message, channel), queue)
        if self._scenario.input.fields:
            _listen(node, fuser.input, partial(self._on_message, fuser.input), QUEUE)
        back = JumpThreshold(min_forward=None, min_backward=_BACK, on_clock_change=False)
        watch = node.get_clock().create_jump_callback(back, post_callback=self._on_clock_back)
        node.at_the_end(watch.unregister)
        if node.options.publish_rate:
            node.create_timer(1.0 / node.options.publish_rate, self._publish_now)

    @property
    def _scenario(self) -> Scenario:
        scenario: Scenario = self._node.scenario
        return scenario

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _hears_input(self) -> bool:
        """Tell whether the input has a publisher, if the state rests until the first input."""
        resting = self._node.options.rest_until_input and not self._fuser.inputs.total()
        subscription = self._fuser.input.subscription
        return not resting or subscription is None or subscription.get_publisher_count() > 0

    def _on_message(self, first: Channel, data: bytes) -> None:
        start, fuser = monotonic(), self._fuser
        received = list(self._waiting_readings(first, data))
        # no input waits long behind a single reading
        if first is fuser.input or len(received) > 1:
            received += self._waiting_inputs(first, data)
        now, decoded = self._now() or None, monotonic()
        corrections = fuser.fuse(received, now)
        if not corrections or not self._meeting.over:
            return
        online = fuser.online
        if online.time is not None and not self._node.options.publish_rate:
            self._node.publish(online.time, online.belief)
            done = monotonic()
            self._latency.add(done - start)
            for channel, time, _ in corrections:
                channel.age.add(((now or time) - time) * 1e-9 + done - decoded)
        fuser.publish_innovations(corrections, _MOST_INNOVATIONS)

    def _waiting_readings(self, first: Channel, data: bytes) -> Iterator[Received]:
        """Yield the readings that are waiting; ``data``, received on ``first``, may be one."""
        now = self._now()
        for name, channel in self._fuser.channels.items():
            source = self._scenario.sensors[name]
            messages, missed = channel.take([data] if channel is first else [])
            if source.timed.enabled:
                self._fuser.overrun(channel, missed)
                read = partial(channel.read, source=source)
                for message in messages:
                    reading = self._node.intake(channel.topic, read, message)
                    if reading is None:
                        continue
                    time = reading.time or now
                    if now:  # simulated time may not have begun
                        channel.measure_lead(time, now)
                    yield Received(time, channel, reading)

    def _waiting_inputs(self, first: Channel, data: bytes) -> Iterator[Received]:
        """Yield the inputs that are waiting; ``data``, received on ``first``, may be one."""
        channel = self._fuser.input
        if channel.subscription is None:
            return
        messages, missed = channel.take([data] if channel is first else [])
        self._fuser.overrun(channel, missed)
        for message in messages:
            input = self._node.intake(channel.topic, self._fuser.read_input, message)
            if input is not None:
                yield Received(input.time or self._now(), channel, input)

    def _publish_now(self) -> None:
        online = self._fuser.online
        if online.time is None:
            return
        time = max(self._now(), online.time)
        if time != self._last_time:  # simulated time may rest between two ticks of a timer
            self._last_time = time
            self._node.publish(time, online.predicted(time))

    def _on_clock_back(self, jump: Any) -> None:
        """Restart when simulated time goes back, as it does when a bag is replayed."""
        back = -jump.delta.nanoseconds * 1e-9
        self._node.get_logger().warning(f'the clock went back by {back:.3g} s: restarting')
        self._fuser.restart()


class LockstepIntake:
    """Fuses a step of the plant once every message that its tick names is received.

    Parameters
    ----------
    node
        The estimator's node.
    fuser
        Fuses the messages.
    """

    def __init__(self, node: Any, fuser: Fuser) -> None:
        self._node: Any = node
        self._fuser = fuser
        scenario: Scenario = node.scenario
        topics = {source.signal.topic: name for name, source in scenario.sensors.items()}
        driven = bool(scenario.input.fields)
        self._steps = StepAssembler(topics, answered=driven)
        for channel in fuser.channels.values():
            _listen(node, channel, partial(self._on_reading, channel), QUEUE)
        if driven:
            _listen(node, fuser.input, self._on_input, QUEUE)
        node.create_subscription(TimeReference, 'tick', self._on_tick, QUEUE, raw=True)

    def _on_reading(self, channel: SensorChannel, data: bytes) -> None:
        source = self._node.scenario.sensors[channel.name]
        if source.timed.enabled:
            reading = channel.read(data, source)
            self._steps.reading(channel.name, reading.time, reading)
            self._fuse_steps()

    def _on_input(self, data: bytes) -> None:
        input = self._fuser.read_input(data)
        if input is not None:
            self._steps.input(input.time, input.values)
            self._fuse_steps()

    def _on_tick(self, data: bytes) -> None:
        time, topics = read_tick(data)
        asked_again = self._steps.waits_for(time)
        if self._steps.tick(time, topics):
            self._node.get_logger().info('time went back: restarting')
            self._fuser.restart()
        self._fuse_steps()
        unanswered = self._steps.unanswered
        if asked_again and unanswered is not None:
            # the input that answers it was lost on the way: ask the controller again
            self._node.publish(unanswered, self._fuser.online.predicted(unanswered))

    def _fuse_steps(self) -> None:
        fuser = self._fuser
        for step in self._steps.complete():
            received = [
                Received(y.time or step.time, fuser.channels[name], y) for name, y in step.readings
            ]
            if step.input is not None:
                time, u = step.input
                received.append(Received(time, fuser.input, Sample(time, u, None)))
            corrections = fuser.fuse(received)
            self._node.publish(step.time, fuser.online.predicted(step.time))
            fuser.publish_innovations(corrections)


def _listen(node: Any, channel: Any, callback: Any, queue: Any) -> None:
    """Subscribe to a channel's topic; if it is used, a missing publisher is reported."""
    scenario: Scenario = node.scenario
    source = None if channel.name is None else scenario.sensors[channel.name]
    signal = scenario.input if source is None else source.signal
    channel.subscription = node.create_subscription(
        channel.message_type, signal.topic, callback, queue, raw=True
    )
    if source is None or source.timed.enabled:
        node.diagnostics.connections.expect(channel.subscription)
