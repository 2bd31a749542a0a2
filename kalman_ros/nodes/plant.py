# SPDX-License-Identifier: Apache-2.0
"""The plant: the simulated truth, its noisy sensors, and the force that drives it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from kalman_ros.codecs.messages import message_type, write_stamp
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import Sample, WireReader
from kalman_ros.core import Array, Signal
from kalman_ros.simulation.plant import SimulatedPlant
from kalman_ros.simulation.scenario import Scenario

from . import runtime
from .diagnostics import Diagnostics, Level, Report
from .options import PlantOptions
from .pacing import Lockstep, RealTime
from .topics import QUEUE, on_topic


class PlantNode(runtime.ScenarioNode):
    """Publishes readings and ground truth; takes a force, holds it, and moves."""

    def __init__(self) -> None:
        super().__init__('plant', PlantOptions)
        options: PlantOptions = self.options
        self.run_until = options.run_until
        self.period = 1.0 / self.scenario.rate
        self._plant = self._fresh_plant()
        self._zero: Array = np.zeros(self.scenario.model.input.size)
        self._force: Array = self._zero
        self._disturbance: Array = self._zero
        self._force_came: int | None = None
        self._bad_forces = 0
        self._sensors = {
            name: self._publisher(source.signal) for name, source in self.scenario.sensors.items()
        }
        self._truth = self._publisher(on_topic(self.scenario.state, 'ground_truth'))
        input = self.scenario.input
        self._read_input = WireReader(SignalCodec(input))
        kind = self._read_input.message_type
        self._input = self.create_subscription(kind, input.topic, self._on_force, QUEUE, raw=True)
        self.create_subscription(kind, 'disturbance', self._on_disturbance, QUEUE, raw=True)
        self._tick = TimeReference()
        self._clock_message = Clock()
        if options.lockstep:
            self._tick_publisher = self.create_publisher(TimeReference, 'tick', QUEUE)
            self._clock_publisher = self.create_publisher(Clock, '/clock', QUEUE)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._pacer = self._build_pacer(options)
        self._origin = self._pacer.first_stamp
        self._steps_before = 0
        self.diagnostics = Diagnostics(self, self._report)

    def _build_pacer(self, options: PlantOptions) -> Lockstep | RealTime:
        if not options.lockstep:
            return RealTime(self)
        estimate = self.scenario.state
        watched = (estimate.topic, message_type(estimate.type))
        return Lockstep(self, watched, options.lockstep_timeout)

    def _fresh_plant(self) -> SimulatedPlant:
        scenario = self.scenario
        timed = {name: source.timed for name, source in scenario.sensors.items()}
        return SimulatedPlant(
            scenario.model, timed, scenario.rate, scenario.initial_state, self.options.seed
        )

    def _publisher(self, signal: Signal) -> tuple[SignalCodec, Any]:
        codec = SignalCodec(signal, self.options.frame, self.options.child_frame)
        return codec, self.create_publisher(codec.message_type, signal.topic, QoSProfile(depth=50))

    @property
    def steps(self) -> int:
        """Steps since the start, resets included."""
        return self._steps_before + self._plant.steps

    @property
    def elapsed(self) -> float:
        """Simulated seconds since the start."""
        return self.steps * self.period

    @property
    def stamp(self) -> int:
        """The time of this step, in nanoseconds."""
        return int(self._origin) + round(self.steps * self.period * 1e9)

    def endpoints_matched(self, *, every_sensor: bool) -> bool:
        """Tell whether an estimator listens and a controller answers."""
        wanted = [self._tick_publisher.get_subscription_count, self._input.get_publisher_count]
        if every_sensor:
            wanted += [publisher.get_subscription_count for _, publisher in self._sensors.values()]
        return all(count() > 0 for count in wanted)

    def publish_step(self) -> None:
        """Publish the readings that are due, the truth, and in lockstep the tick and clock."""
        time = self.stamp
        sources = self.scenario.sensors
        readings = self._plant.readings()
        for name, y in readings.items():
            codec, publisher = self._sensors[name]
            publisher.publish(codec.encode(time, y, sources[name].sensor.covariance))
        if self.options.lockstep:
            write_stamp(self._tick.header.stamp, time)
            self._tick.source = ','.join(sources[name].signal.topic for name in readings)
            self._tick_publisher.publish(self._tick)
            if self._clock_publisher.get_subscription_count():
                write_stamp(self._clock_message.clock, time)
                self._clock_publisher.publish(self._clock_message)
        codec, publisher = self._truth
        if publisher.get_subscription_count():
            publisher.publish(codec.encode(time, self._plant.state))

    def step(self) -> None:
        """Move on by one step with the force that is held."""
        self._drop_old_force()
        self._plant.step(self._force + self._disturbance)

    def _drop_old_force(self) -> None:
        timeout = self.options.force_timeout
        if self.options.lockstep or self._force_came is None or timeout == 0.0:
            return
        age = (self.steady.now().nanoseconds - self._force_came) * 1e-9
        if age > timeout:
            self._force, self._force_came = self._zero, None
            topic = self.scenario.input.topic
            self.get_logger().warning(f'no {topic} for {age:.2f} s: it is zero now')
            self.diagnostics.publish()

    def _on_force(self, data: bytes) -> None:
        force = self._input_in(data)
        if force is None:
            return
        if self._force_came is None:
            self.get_logger().info(f'{self.scenario.input.topic} has come')
        self._force, self._force_came = force.values, self.steady.now().nanoseconds
        self._pacer.answered(force.time)

    def _on_disturbance(self, data: bytes) -> None:
        disturbance = self._input_in(data)
        if disturbance is not None:
            self._disturbance = disturbance.values

    def _input_in(self, data: bytes) -> Sample | None:
        """Return the finite input in a message, or None and count it."""
        try:
            sample = self._read_input(data)
            if np.isfinite(sample.values).all():
                return sample
        except LookupError:
            pass
        self._bad_forces += 1
        return None

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._steps_before = self.steps
        self._plant = self._fresh_plant()
        response.success, response.message = True, 'back at the initial state; time goes on'
        return response

    def prepare(self, scenario: Scenario, options: PlantOptions) -> Callable[[], None]:
        """Change noise, parameters of the model, or when to pause, without a jump."""
        timed = {name: source.timed for name, source in scenario.sensors.items()}

        def apply() -> None:
            self._plant.configure(scenario.model, timed)
            self.run_until = options.run_until
            self._pacer.changed()

        return apply

    def _report(self) -> Report:
        values = {
            'steps': self.steps,
            'simulated seconds': self.elapsed,
            'missed steps': self._pacer.missed,
            'forces not finite': self._bad_forces,
        }
        trouble = self._pacer.trouble()
        if trouble:
            return Level.ERROR, trouble, values
        if self._force_came is None:
            return Level.WARN, f'no {self.scenario.input.topic} comes: it is zero', values
        return Level.OK, 'running', values


def main() -> None:
    """Run the plant."""
    runtime.main(PlantNode)
