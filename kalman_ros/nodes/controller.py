# SPDX-License-Identifier: Apache-2.0
"""The controller: an estimate in, the force that answers it out."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

import numpy as np
from rclpy.duration import Duration
from std_srvs.srv import SetBool

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.control.feedback import Limits, Regulator
from kalman_ros.core import Array, is_finite, one_each
from kalman_ros.simulation.regulator import feedback, tracking
from kalman_ros.simulation.scenario import Scenario

from . import runtime
from .diagnostics import Level, Report
from .meters import Latency, Rate
from .options import ControllerOptions
from .reference import ReferenceReader
from .topics import HISTORY, QUEUE
from .trust import Trust
from .watcher import waiting

#: The longest step, in seconds, over which an integral is taken or an estimate predicted.
_LONGEST = 0.5
#: For the last force to arrive.
_DELIVERY = Duration(seconds=0.2)


class ControllerNode(runtime.ScenarioNode):
    """Answers every estimate with the force of a law: lqr, placement or lqi."""

    def __init__(self) -> None:
        super().__init__('controller', ControllerOptions)

    def configure(self) -> None:
        """Design the law, and create what it publishes."""
        super().configure()
        scenario, options = self.scenario, self.options
        model = scenario.model
        self._regulator = Regulator(
            model.state, feedback(scenario), model.equilibrium, _limits(scenario, options)
        )
        self._trust = Trust(model.state, *_trusted(scenario, options))
        self._enabled = options.enabled
        #: Whether the input was let go, and answers are to go on from where it is.
        self._released = False
        self._period = 1.0 / scenario.rate
        self._zero: Array = np.zeros(model.input.size)
        self._force: Array = self._zero
        self._refused = self._said = 0
        self._rate, self._latency, self._age = Rate(), Latency(), Latency()
        self._read_state = WireReader(SignalCodec(scenario.state))
        self._write = WireWriter(SignalCodec(scenario.input, options.frame))
        self._publisher = self.create_publisher(
            self._write.message_type, scenario.input.topic, HISTORY
        )
        #: The last estimate that could be read.
        self._estimate = b''
        self._reference = ReferenceReader(self, scenario, self._on_reference, self._frame)

    def activate(self) -> None:
        """Answer estimates from now on."""
        self._fault = ''
        self._came = self._acted = monotonic()
        self._time: int | None = None
        self._said_at = 0
        self._answered = self._passed = 0
        self._trust.forget()
        topic, kind = self.scenario.state.topic, self._read_state.message_type
        self._estimates = self.create_subscription(kind, topic, self._on_estimate, QUEUE, raw=True)
        self.diagnostics.connections.expect(self._estimates)
        self._reference.listen()
        if not self.options.lockstep:
            self.create_timer(self._period, self._supervise, clock=self.steady)
        self.create_service(SetBool, '~/enable', self._on_enable)

    def deactivate(self) -> None:
        """Let the input go to zero: within its limits, unless that takes too long."""
        end = monotonic() + _LONGEST
        while self._force.any():
            in_time = monotonic() < end
            self._force = self._regulator.release(self._period) if in_time else self._zero
            stamp = self._time if self.options.lockstep else None
            self._say(stamp or self._now())
            if self._force.any():
                sleep(self._period)
        # what is destroyed next takes along what has not been delivered
        self._publisher.wait_for_all_acked(_DELIVERY)
        self._released = True

    def _on_estimate(self, data: bytes) -> None:
        """Answer the newest estimate that has come; what it was before is of no use."""
        came = self._came = self._rate.count()
        *older, newest = data, *waiting(self._estimates)
        self._passed += len(older)
        try:
            estimate = self._read_state(newest)
            self._estimate = newest
        except LookupError:
            estimate = Sample(None, np.full(self.scenario.model.state.size, np.nan), None)
        time = estimate.time if estimate.time is not None else self._now()
        self._force = self._answer(time, estimate, min(came - self._acted, _LONGEST))
        self._acted = came
        self._say(time)
        self._answered += 1
        self._latency.add(monotonic() - came)

    def _say(self, time: int) -> None:
        """Publish the force, stamped ``time``."""
        self._publisher.publish(self._write(time, self._force))
        self._said += 1

    def _answer(self, time: int, estimate: Sample, waited: float) -> Array:
        """Return the force for an estimate; on the way to zero if it is not to be trusted.

        Stamps that are not to be trusted do not tell how far: the time that one ``waited`` does.
        """
        dt = 0.0 if self._time is None else (time - self._time) * 1e-9
        dt = min(max(dt, 0.0), _LONGEST)
        self._time = time
        now = None if self.options.lockstep else self._now()
        reason = self._trust.reason(estimate, now)
        x = estimate.values if reason else self._predicted(time, estimate.values)
        if not reason and not is_finite(x):
            reason = 'the estimate cannot be predicted by its age'
        if reason:
            self._refused += 1
            return self._fail(reason, self._period if self.options.lockstep else waited)
        self._recover(x)
        if not self._enabled:
            force = self._regulator.release(dt)
            self._regulator.follow(x, force)
            return force
        return self._regulator.answer(x, dt)

    def _fail(self, reason: str, dt: float) -> Array:
        """Take note of a fault and return a force on the way to zero."""
        if not self._fault:
            self.get_logger().error(f'{reason}: the force goes to zero', throttle_duration_sec=1.0)
            self.diagnostics.soon()
        self._fault = reason
        self._released = True
        if self.options.resume == 'enable':
            self._enabled = False
        return self._regulator.release(dt)

    def _recover(self, x: Array) -> None:
        """Go on from where the input is, if it was let go."""
        if self._fault:
            words = f'estimates can be used again, after: {self._fault}'
            self.get_logger().info(words, throttle_duration_sec=1.0)
            self.diagnostics.soon()
            self._fault = ''
        if self._released:
            self._regulator.follow(x, self._force)
            self._released = False

    def _supervise(self) -> None:
        """Let the force go to zero when no estimate comes, by a clock that never rests."""
        at = monotonic()
        silence, timeout = at - self._came, self.options.estimate_timeout
        if self._answered and timeout and silence > timeout:
            reason = f'no {self.scenario.state.topic} has come for {silence:.2g} s'
            self._force = self._fail(reason, min(at - self._acted, self._period))
            self._acted = at
            now = self._now()
            if self._force.any() or now != self._said_at:  # else time rests, and all is said
                self._say(now)
            self._said_at = now

    def _predicted(self, time: int, x: Array) -> Array:
        """Return the state now, by the model, if that is asked for."""
        if self.options.lockstep:
            return x
        age = ((self._now() or time) - time) * 1e-9
        self._age.add(age)
        if not self.options.predict_latency or not 0.0 < age <= _LONGEST:
            return x
        return self.scenario.model.step(x, self._force, age)

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _frame(self) -> str:
        """Return the frame of the estimate, or the configured one before the first."""
        return leading_frame(self._estimate) if self._estimate else self.options.frame

    def _on_reference(self, state: Array, input: Array) -> None:
        self._regulator.target = state, input

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._enabled = request.data
        response.success = True
        response.message = 'forces are computed' if self._enabled else 'forces are zero'
        return response

    def prepare(self, scenario: Scenario, options: ControllerOptions) -> Callable[[], None]:
        """Design the gains again, for other weights, poles, limits or another model."""
        found, limits = feedback(scenario), _limits(scenario, options)
        equilibria, trusted = tracking(scenario), _trusted(scenario, options)

        def apply() -> None:
            self._regulator.adopt(found, limits)
            self._trust.adopt(*trusted)
            self._reference.equilibria = equilibria

        return apply

    def report(self) -> Report:
        """Return what it answers, with which gains, or why it does not."""
        gains, target = self._regulator.feedback, self._regulator.target
        values = {
            'estimates answered': self._answered,
            'estimates refused': self._refused,
            'estimates passed over for newer ones': self._passed,
            'forces published': self._said,
            'forces limited': self._regulator.limited,
            'rate [Hz]': self._rate.value,
            'from arrival to publication, 50 / 90 / 99 % [ms]': str(self._latency),
            'age of estimates, 50 / 90 / 99 % [ms]': str(self._age),
            'law': self.scenario.law,
            'reference': np.array2string(target[0], precision=4),
            'gain': np.array2string(gains.gain, precision=4),
            'poles': np.array2string(gains.poles, precision=4),
        }
        zero = 'the force goes to zero' if self._force.any() else 'the force is zero'
        if self._fault:
            return Level.ERROR, f'{self._fault}: {zero}', values
        if not self._enabled:
            return Level.WARN, f'disabled: {zero}', values
        if not self._answered:
            return Level.WARN, f'no {self.scenario.state.topic} has come', values
        return Level.OK, 'running', values


def _limits(scenario: Scenario, options: ControllerOptions) -> Limits:
    m = scenario.model.input.size
    magnitude = one_each('input_limit', options.input_limit, m)
    rate = one_each('input_rate_limit', options.input_rate_limit, m)
    return Limits(magnitude, rate, options.transition_time)


def _trusted(scenario: Scenario, options: ControllerOptions) -> tuple[float, Array, Array]:
    """Return which estimates may be acted upon, as `Trust` takes it."""
    most = one_each('max_std', options.max_std, scenario.model.state.size)
    if options.resume not in ('auto', 'enable'):
        raise ValueError(f"resume: expected auto or enable, got '{options.resume}'")
    prior = scenario.initial_belief.covariance.diagonal()
    return options.estimate_timeout, most, prior


def main() -> None:
    """Run the controller."""
    runtime.main(ControllerNode)
