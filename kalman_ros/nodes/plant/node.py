# SPDX-License-Identifier: Apache-2.0
"""The plant: the simulated truth, its noisy sensors, and its input."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from kalman_ros.codecs.messages import leading_stamp, message_type, write_stamp
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.tick import mention, write_tick
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Option, Signal, Value
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.managed import ACTIVE
from kalman_ros.nodes.middleware.meeting import Meeting
from kalman_ros.nodes.middleware.topics import HISTORY, QUEUE, on_topic, refuse_shared
from kalman_ros.scenario import Scenario, sensor_names
from kalman_ros.scenario.idle import idle_input
from kalman_ros.simulation.faults import options_of_sensors
from kalman_ros.simulation.faults.links import Links
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.simulated_plant import SimulatedPlant

from .input import PlantInput
from .options import PlantOptions
from .pacing import Lockstep, RealTime


class PlantNode(runtime.ScenarioNode):
    """Publishes readings and ground truth; receives an input, holds it, and moves."""

    def __init__(self) -> None:
        super().__init__('plant', PlantOptions)

    def configure(self) -> None:
        """Build the simulated plant and its publishers."""
        super().configure()
        refuse_shared(self.scenario)
        options: PlantOptions = self.options
        self.run_until = options.run_until
        self.period = 1.0 / self.scenario.rate
        self._links = Links(options.seed)
        idle = idle_input(self.scenario.model, options.idle_input)
        self._input = PlantInput(self.scenario.input, idle, lambda: self.steady.now().nanoseconds)
        self._may_rest = options.rest_until_input and not options.lockstep
        self._restart()
        # of a sensor that is not enabled, another node may publish the readings
        self._sensors = {
            name: self._publisher(source.signal) for name, source in self.scenario.enabled.items()
        }
        self._truth = self._publisher(on_topic(self.scenario.state, 'ground_truth'))
        self._clock_message = Clock()
        if options.lockstep:
            self._tick_publisher = self.create_publisher(TimeReference, 'tick', QUEUE)
            self._clock_publisher = self.create_publisher(Clock, '/clock', QUEUE)
        self._steps_before = 0

    def activate(self) -> None:
        """Continue from the current state, without an input until one is received."""
        self._input.reset()
        self._answers = self._listen()
        #: In lockstep, the last step that each required topic has answered.
        self._answered = dict.fromkeys(self._answers, -1)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._meeting = Meeting(self._input_connected)
        self._pacer = self._build_pacer(self.options)
        if self.options.lockstep and self.options.lockstep_window:
            self.create_subscription(TimeReference, 'recorded', self._on_recorded, QUEUE, raw=True)
        self.origin = self._pacer.first_stamp

    def deactivate(self) -> None:
        """Stop stepping."""
        self._pacer.close()

    def _input_connected(self) -> bool:
        """Return whether an input that responds to the readings would be received."""
        # simulated time waits for nobody
        begun = not self._rests or self.get_clock().ros_time_is_active
        return begun or any(
            subscription.get_publisher_count() for subscription in self._answers.values()
        )

    @property
    def may_begin(self) -> bool:
        """Whether it may publish, as the nodes that drive it are connected."""
        return self._meeting.over

    def _listen(self) -> dict[str, Any]:
        """Subscribe to the inputs; return the subscriptions that answer each step."""
        input, state = self.scenario.input, self.scenario.state
        subscribe = self.create_subscription
        subscriptions = {}
        if input.fields:
            kind = self._input.message_type
            subscribe(kind, 'disturbance', self._input.disturb, QUEUE, raw=True)
            subscriptions['input'] = subscribe(kind, input.topic, self._on_force, QUEUE, raw=True)
            self.diagnostics.connections.expect(subscriptions['input'])
        if not input.fields or self.options.wait_for_estimate:
            kind = message_type(state.type)
            subscriptions['state'] = subscribe(
                kind, state.topic, self._on_estimate, QUEUE, raw=True
            )
        return subscriptions

    def _build_pacer(self, options: PlantOptions) -> Lockstep | RealTime:
        if not options.lockstep:
            return RealTime(self)
        estimate = self.scenario.state
        watched = (estimate.topic, message_type(estimate.type))
        input = self.scenario.input
        stamped = not input.fields or hasattr(message_type(input.type), 'header')
        timeout, window = options.lockstep_timeout, options.lockstep_window
        return Lockstep(self, watched, timeout, window, stamped=stamped)

    def _restart(self) -> None:
        """Reset the plant to its initial state, with its noise and faults from the start."""
        scenario, seed = self.scenario, self.options.seed
        model, start = scenario.model, scenario.initial_state
        self._plant = SimulatedPlant(
            model, scenario.timed, scenario.rate, start, seed, self._input.idle
        )
        self._links.reset()
        #: Whether it is held at its initial state: no input yet, in real time.
        self._rests = self._may_rest and bool(scenario.input.fields)
        self._adapting(scenario, self.options, self.extra)()

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return the options of the sensor faults."""
        return options_of_sensors(sensor_names(chosen['sensors']))

    def _adapting(
        self, scenario: Scenario, options: PlantOptions, faulty: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Return a function that adapts the plant to a scenario; ValueError if impossible."""
        timed, model = scenario.timed, scenario.model
        faults = PlantFaults(timed, model.input.size, options, faulty)
        idle = idle_input(model, options.idle_input)

        def adapt() -> None:
            self._input.idle = idle
            self._plant.configure(model, timed)
            self._plant.adopt(faults)
            self._links.configure(timed, faults.sensors)

        return adapt

    def _publisher(self, signal: Signal) -> tuple[WireWriter, Any]:
        write = WireWriter(codec_of(signal, self.options.frame, self.options.child_frame))
        return write, self.create_publisher(write.message_type, signal.topic, HISTORY)

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
        return int(self.origin) + round(self.steps * self.period * 1e9)

    def endpoints_matched(self, *, every_sensor: bool) -> bool:
        """Return whether an estimator and a controller are connected."""
        wanted = [self._tick_publisher.get_subscription_count]
        wanted += [subscription.get_publisher_count for subscription in self._answers.values()]
        if every_sensor:
            wanted += [publisher.get_subscription_count for _, publisher in self._sensors.values()]
        return all(count() > 0 for count in wanted)

    def publish_step(self) -> None:
        """Publish the readings that are due, the truth, and in lockstep the tick and clock.

        After a state that is not finite nothing is published until ``~/reset``.
        """
        if not self._plant.finite:
            return
        time = self.stamp
        sources = self.scenario.sensors
        arrivals = self._links(self._plant.time, time, self._plant.readings())
        for name, taken, y in arrivals:
            source = sources[name]
            if name not in self._sensors:  # enabled since
                self._sensors[name] = self._publisher(source.signal)
            write, publisher = self._sensors[name]
            stamp = taken - source.signal.stamp_offset
            publisher.publish(write(stamp, y, source.sensor.covariance))
        if self.options.lockstep:
            topics = tuple(
                mention(sources[name].signal.topic, taken, time) for name, taken, _ in arrivals
            )
            self._tick_publisher.publish(write_tick(time, topics))
            if self._clock_publisher.get_subscription_count():
                write_stamp(self._clock_message.clock, time)
                self._clock_publisher.publish(self._clock_message)
        write, publisher = self._truth
        if publisher.get_subscription_count():
            publisher.publish(write(time, self._plant.state))

    def step(self) -> None:
        """Advance by one step with the last input; before the first one, only time advances."""
        if self._rests:
            self._plant.rest()
            return
        self._drop_old_force()
        was_finite = self._plant.finite
        self._plant.step(self._input.force, self._input.disturbance)
        if was_finite and not self._plant.finite:
            self.get_logger().error(self._diverged())
            self.diagnostics.publish()

    def _diverged(self) -> str:
        """Return that the plant has diverged, and what to do; '' if it has not."""
        if self._plant.finite:
            return ''
        return 'the plant diverged, its state is not finite: it publishes nothing until ~/reset'

    def _drop_old_force(self) -> None:
        if self.options.lockstep:
            return
        age = self._input.drop_old(self.options.force_timeout)
        if age is not None:
            topic = self.scenario.input.topic
            zero = self._input.idle_name
            self.get_logger().warning(f'no {topic} for {age:.2f} s: it is {zero} now')
            self.diagnostics.publish()

    def _on_force(self, data: bytes) -> None:
        force = self._input.take(data)
        if force is None:
            return
        if self.options.lockstep and force.time not in (None, self.stamp):
            return  # a repeated answer to another step
        if not self._input.is_set:
            self.get_logger().info(f'first {self.scenario.input.topic} received')
        self._input.hold(force)
        self._rests = False
        self._on_answer('input', self.stamp if force.time is None else force.time)

    def _on_recorded(self, data: bytes) -> None:
        self._pacer.confirm(leading_stamp(data))

    def _on_estimate(self, data: bytes) -> None:
        self._on_answer('state', leading_stamp(data))

    def _on_answer(self, kind: str, time: int) -> None:
        self._answered[kind] = time
        if all(answer == self.stamp for answer in self._answered.values()):
            self._pacer.answered()

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._steps_before = self.steps
        self._restart()
        response.success, response.message = True, 'back at the initial state; time continues'
        return response

    def prepare(
        self, scenario: Scenario, options: PlantOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Change noise, the model, faults, or when to pause, without a jump."""
        adapt = self._adapting(scenario, options, extra)

        def apply() -> None:
            adapt()
            self.run_until = options.run_until
            if self.phase == ACTIVE:
                self._pacer.changed()

        return apply

    def report(self) -> Report:
        """Return counts, and which nodes are late."""
        values: dict[str, Any] = {
            'steps': self.steps,
            'simulated seconds': self.elapsed,
            'missed steps': self._pacer.missed,
            'forces received': self._input.received,
            'inputs refused': self._input.refused,
        }
        values.update({f'{name}: readings': count for name, count in self._links.arrived.items()})
        faults = ', '.join((*self._links.faults, *self._plant.faults.on))
        trouble = self._diverged() or self._pacer.trouble()
        if trouble:
            return Level.WARN if self._pacer.held else Level.ERROR, trouble, values
        if self._rests:
            return Level.WARN, f'at rest until the first {self.scenario.input.topic}', values
        if self.scenario.input.fields and not self._input.is_set:
            words = f'no {self.scenario.input.topic} received: it is {self._input.idle_name}'
            return Level.WARN, words, values
        return Level.OK, f'running with {faults}' if faults else 'running', values


def main() -> None:
    """Run the plant."""
    runtime.main(PlantNode)
