# SPDX-License-Identifier: Apache-2.0
"""The controller: an estimate in, the input that responds to it out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from math import inf
from time import monotonic
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool, Trigger

from kalman_ros.codecs.layout import Sample
from kalman_ros.control.feedback import Regulator
from kalman_ros.control.limiter import Limiter
from kalman_ros.control.motion import Motion
from kalman_ros.control.predictive import Prediction
from kalman_ros.core import Array, OperatingPoint, Value, is_finite
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.diagnostics import Report
from kalman_ros.nodes.middleware.meeting import Meeting
from kalman_ros.nodes.middleware.topics import HISTORY, QUEUE, STATIC, WATCH
from kalman_ros.pipeline.input_messages import InputEncoder
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import SetPointGains, actuators, feedback, tracking

from .feed import EstimateFeed
from .guard import EstimateGuard, guard_limits
from .health import Health
from .motions import MotionReader
from .options import ControllerOptions
from .output import OutputStage
from .reference import ReferenceReader
from .stop import Heartbeat, Stop

#: The longest step, in seconds, over which an integral is updated or an estimate predicted.
_LONGEST = 0.5
#: A clock that goes back by less is out of order, not reset.
_BACK = Duration(seconds=-0.1)


class ControllerNode(runtime.ScenarioNode):
    """Responds to every estimate with the input of a law: lqr, placement, lqi or mpc."""

    with_law = True

    def __init__(self) -> None:
        super().__init__('controller', ControllerOptions)

    def configure(self) -> None:
        """Design the law, and create the publishers."""
        super().configure()
        scenario, options = self.scenario, self.options
        model, blend = scenario.model, options.transition_time
        bounds, idle = actuators(scenario, asdict(options))
        budget = options.solve_timeout or inf
        self._gains = SetPointGains(scenario, feedback(scenario))
        self._regulator = Regulator(
            model.state,
            self._gains.law,
            model.equilibrium,
            blend,
            bounds,
            inf if options.lockstep else budget,
            idle,
        )
        self._guard = EstimateGuard(model.state, *guard_limits(scenario, options))
        limiter = self._limiter = Limiter(bounds, idle)
        self._stop = Stop(enabled=options.enabled)
        self._heartbeat = Heartbeat(options.heartbeat_timeout)
        #: Whether the input went to idle, and has to continue from there.
        self._released = False
        self._period = 1.0 / scenario.rate
        self._feed = EstimateFeed(self, scenario, self._guard)
        write = InputEncoder(scenario.input, options.frame)
        publisher = self.create_publisher(write.message_type, scenario.input.topic, HISTORY)
        self._output = OutputStage(
            publisher, write, limiter, self._period, simulated=options.lockstep
        )
        self.at_the_end(self._output.deliver)
        frame = partial(self._feed.frame, options.frame)
        self._reference = ReferenceReader(
            self, scenario, self._hold, self._move, frame, options.reference_timeout, bounds
        )
        #: The last estimate that was used.
        self._here: Array | None = None
        self._motions = MotionReader(self, self._regulator, frame, lambda: self._here)
        self._motions.adopt(scenario, options, bounds)
        self._health = Health(
            self._regulator,
            self._stop,
            self._feed,
            self._output,
            self._reference,
            self._motions,
            self.get_logger().warning,
        )

    def activate(self) -> None:
        """Respond to estimates from now on."""
        self._health.begin()
        self._time: int | None = None
        self._failed_at = self._feed.passed = 0
        self._guard.forget()
        self._meeting = Meeting(self._connected)
        #: The estimate to respond to once the nodes are connected.
        self._early = b''
        topic, kind = self.scenario.state.topic, self._feed.message_type
        listening = self.subscribe_in_batches(kind, topic, self._on_estimate, QUEUE)
        self._feed.subscription = self.diagnostics.connections.expect(listening)
        self._reference.listen()
        self._motions.listen()
        if not self.options.lockstep:
            self.create_timer(self._period, self._supervise, clock=self.steady)
            back = JumpThreshold(min_forward=None, min_backward=_BACK, on_clock_change=False)
            handle = self.get_clock().create_jump_callback(back, post_callback=self._on_clock_back)
            self.at_the_end(handle.unregister)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self.create_service(Trigger, '~/stop', self._on_stop_request)
        self.create_service(Trigger, '~/reset', self._on_reset)
        for quality in (STATIC, QUEUE, WATCH):  # from before this moment, and from any publisher
            self.create_subscription(Bool, 'stop', self._on_stop, quality)
        self._heartbeat.beat()
        if self._heartbeat.timeout:
            beat = self._heartbeat.beat
            self.create_subscription(Empty, 'heartbeat', lambda _: beat(), WATCH)
        self._clock_went_back = False
        if self._stop.may_act or self.options.lockstep:
            self._output.open()

    def deactivate(self) -> None:
        """Bring the input to idle: within its limits, unless that takes too long."""
        self._output.close(self._stamp)
        self._released = True
        self._end_motion()

    def _end_motion(self) -> None:
        """Hold the equilibrium nearest to where a motion has got, and forget what is planned."""
        self._motions.forget()
        if self._regulator.motion is not None:
            held = self._reference.rest_near(self._regulator.target[0])
            self._regulator.hold(*held, self._gains.where_possible(held))

    def _resume_motion(self) -> None:
        """Plan a motion that was interrupted from rest where it is now."""
        followed = self._motions.followed
        if followed is not None:
            self._end_motion()
            self._motions.plan(followed)

    def _connected(self) -> bool:
        """Return whether the plant subscribes to the input, and the estimator."""
        return self.options.lockstep or self._output.listeners >= 2

    def _on_estimate(self, data: bytes) -> None:
        """Respond to the newest estimate received; older ones are obsolete."""
        if not self._meeting.over:
            self._early = data
            return
        self._early = b''
        came = monotonic()
        ordered = not self.options.lockstep and not self._clock_went_back
        estimate = self._feed.newest(data, came if ordered else None)
        if estimate is None:
            return
        self._clock_went_back = False
        self._health.receive()
        time = estimate.time if estimate.time is not None else self._now()
        self._answer(time, estimate)
        self._health.count(came)

    def _answer(self, time: int, estimate: Sample) -> None:
        """Publish the input for an estimate, or one towards idle if it is refused."""
        dt = 0.0 if self._time is None else (time - self._time) * 1e-9
        dt = min(max(dt, 0.0), _LONGEST)
        self._time = time
        now = None if self.options.lockstep else self._now()
        reason = self._guard.reason(estimate, now) or self._heartbeat_problem()
        x = estimate.values if reason else self._predicted(time, estimate.values)
        if not reason and not is_finite(x):
            reason = 'the estimate cannot be predicted by its age'
        if reason:
            self._health.refused += 1
            self._fail(reason, time)
            return
        self._recover(x)
        self._here = x
        if not self._stop.may_act:
            self._regulator.follow(x, self._output.release(time))
            self._motions.poll(acts=False)
            return
        planned = self._motions.take()
        if planned is not None:
            since = planned.since
            begun = 0.0 if since is None else max(self._regulator.elapsed - since, 0.0)
            # what goes on from the motion before has no jump
            self._regulator.follow_motion(planned.motion, begun, smooth=since is None)
        wanted = self._regulator.propose(x, dt)
        if is_finite(wanted):
            self._regulator.applied(x, wanted, self._output.command(time, wanted), dt)
        else:
            self._fail('the law gives no finite input for the estimate', time)

    def _fail(self, reason: str, time: int) -> None:
        """Record a fault, and bring the input a step closer to idle."""
        # first of all, since writing to the log may block
        self._output.release(time)
        self._released = True
        if self.options.resume == 'enable':
            self._enable(on=False)
        elif self.options.resume == 'never':
            self._stop_acting(reason)
        if not self._health.fault:
            words = f'{reason}: the force goes to {self._output.idle_name}'
            self.get_logger().error(words, throttle_duration_sec=1.0)
            self.diagnostics.soon()
        self._health.fault = reason

    def _recover(self, x: Array) -> None:
        """Continue from the current input, if it went to idle."""
        if self._health.fault:
            words = f'estimates can be used again, after: {self._health.fault}'
            self.get_logger().info(words, throttle_duration_sec=1.0)
            self.diagnostics.soon()
            self._health.fault = ''
        if self._released:
            self._regulator.follow(x, self._output.value)
            self._released = False

    def _supervise(self) -> None:
        """Bring the input to idle while no estimate arrives; uses the steady clock."""
        self._motions.poll(acts=self._stop.may_act)
        if self._early and self._meeting.over:
            self._on_estimate(self._early)
        problem = self._heartbeat_problem()
        if problem and self._stop.may_act:
            self._fail(problem, self._stamp())
        silence, timeout = monotonic() - self._health.came, self.options.estimate_timeout
        if self._health.answered and timeout and silence > timeout:
            now = self._stamp()
            if not self._output.at_idle or now != self._failed_at:  # time is paused
                self._fail(f'no {self.scenario.state.topic} received for {silence:.2g} s', now)
            self._failed_at = now

    def _predicted(self, time: int, x: Array) -> Array:
        """Return the current state, predicted by the model if ``predict_latency`` is set."""
        if self.options.lockstep:
            return x
        age = ((self._now() or time) - time) * 1e-9
        self._health.age.add(age)
        age = self.scenario.model.nearest_step(age)
        if not self.options.predict_latency or not 0.0 < age <= _LONGEST:
            return x
        return self.scenario.model.step(x, self._output.value, age)

    def _stamp(self) -> int:
        """Return the stamp of an input that responds to no estimate.

        It is the current time, but not before the last input: an estimator orders inputs by
        their stamps, and those that respond to estimates may be ahead of the clock.
        """
        if self.options.lockstep and self._time is not None:
            return self._time
        now, last = self._now(), self._output.stamp
        ahead = 0 if last is None else last - now
        return now + ahead if 0 < ahead * 1e-9 <= self.options.future_tolerance else now

    def _on_clock_back(self, jump: Any) -> None:
        """Accept the next estimate, even if older than the last, as the first after a reset."""
        self._clock_went_back = True

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _hold(self, held: OperatingPoint) -> None:
        """Hold a set point, in place of every motion; what comes while it is stopped is not."""
        if self._stop.reason:
            return
        gains = self._gains.at(held)
        self._motions.forget()
        self._regulator.hold(*held, gains)

    def _move(self, motion: Motion) -> None:
        """Follow a set point that moves, in place of every other motion, unless it is stopped."""
        if self._stop.reason:
            return
        self._motions.forget()
        self._regulator.follow_motion(motion, smooth=False)

    def _on_enable(self, request: Any, response: Any) -> Any:
        on, acted = request.data, self._stop.may_act
        response.success = self._enable(on=on)
        if response.success and on and not acted and not self.options.lockstep:
            self._resume_motion()
        if not response.success:
            response.message = f'stopped ({self._stop.reason}): call ~/reset first'
        else:
            response.message = (
                'forces are computed' if on else f'the force is {self._output.idle_name}'
            )
        return response

    def _on_stop(self, message: Any) -> None:
        """Stop while the message is true; false lets a reset end it."""
        reason = 'the topic stop'
        if message.data:
            self._stop_acting(reason)
        self._stop.press(reason, on=message.data)

    def _on_stop_request(self, _: Any, response: Any) -> Any:
        self._stop_acting('~/stop')
        response.success, response.message = True, f'the force is {self._output.idle_name}'
        return response

    def _on_reset(self, _: Any, response: Any) -> Any:
        response.success = self._stop.reset()
        if response.success:
            self._end_motion()  # also what was asked for meanwhile
            response.message = 'not stopped; ~/enable lets it act'
        else:
            response.message = 'the topic stop is true: publish false first'
        return response

    def _stop_acting(self, reason: str) -> None:
        """Bring the input to idle until a reset and then an enable; a motion ends."""
        first = not self._stop.reason
        self._stop.stop(reason)
        self._enable(on=False)
        self._end_motion()
        if first:
            self.get_logger().error(f'stopped: {reason}')
            self.diagnostics.soon()

    def _heartbeat_problem(self) -> str:
        return '' if self.options.lockstep else self._heartbeat.problem

    def _enable(self, *, on: bool) -> bool:
        """Compute inputs, or bring the input to idle and stop publishing; lockstep needs one.

        Return whether that was done: where it is stopped, it stays so.
        """
        if not self._stop.enable(on=on):
            return False
        if self.options.lockstep:
            return True
        if on:
            self._output.open()
        else:
            self._output.close(self._stamp)
            self._released = True
        return True

    def prepare(
        self, scenario: Scenario, options: ControllerOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Redesign the gains for other weights, poles, limits or another model."""
        bounds, idle = actuators(scenario, asdict(options))
        accepted = guard_limits(scenario, options)
        motion, changed = self._regulator.motion, scenario is not self.scenario
        gains, equilibria = self._gains, self._reference.equilibria
        if changed:  # else the design, which takes tens of milliseconds
            gains, equilibria = SetPointGains(scenario, feedback(scenario)), tracking(scenario)
        law_at_target = gains.law
        if motion is None:
            law_at_target = gains.at(OperatingPoint(*self._regulator.target))
        before = self._regulator.feedback.prediction

        def apply() -> None:
            self._gains = gains
            self._regulator.adopt(gains.law, options.transition_time, bounds, law_at_target)
            self._name_outside(before, law_at_target.prediction)
            self._limiter.adopt(bounds, idle)
            self._guard.adopt(*accepted)
            self._reference.adopt(scenario, equilibria, bounds)
            self._motions.adopt(scenario, options, bounds)
            if motion is not None and changed:
                self._motions.regain(motion, scenario)

        return apply

    def _name_outside(self, before: Prediction | None, prediction: Prediction | None) -> None:
        """Warn of new limits that exclude the state as it is, to which they move it."""
        if prediction is None or self._here is None:
            return
        for index in prediction.outside(self._here):
            old = None if before is None else (before.low[index], before.high[index])
            if old == (prediction.low[index], prediction.high[index]):
                continue
            name, value = self.scenario.model.state.names[index], self._here[index]
            limits = f'{prediction.low[index]:g} to {prediction.high[index]:g}'
            self.get_logger().warning(
                f'state_limit.{name}: {value:.3g} is outside of {limits}, and goes there'
            )

    def report(self) -> Report:
        """Return counts and gains, or why no input is computed."""
        return self._health.report(self.scenario)


def main() -> None:
    """Run the controller."""
    runtime.main(ControllerNode)
