# SPDX-License-Identifier: Apache-2.0
"""The estimator: readings and forces in, the state with its covariance out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from functools import partial
from operator import itemgetter
from time import monotonic
from typing import Any, Optional

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from kalman_ros.analysis.local_observability import ObservabilityMeter
from kalman_ros.analysis.observability import observability
from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.tick import read_tick
from kalman_ros.core import Array, Gaussian, Option, Value
from kalman_ros.estimators import filter_options
from kalman_ros.estimators.correction import Correction
from kalman_ros.estimators.online import Arrival, OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import Scenario

from . import runtime
from .channel import Channel, InputChannel, SensorChannel
from .diagnostics import Level, Report
from .estimates import EstimatePublisher
from .fusion import check_start, fusion
from .idle import idle_input
from .initial_pose import PoseReader
from .meeting import Meeting
from .meters import Latency
from .options import EstimatorOptions
from .throttle import Throttle
from .topics import QUEUE, sensor_queue
from .turns import Turns

#: No clock is published so out of order; less is as good as no jump.
_BACK = Duration(seconds=-0.1)

#: The lowest rate of publication, in Hz, other than none.
_SLOWEST = 1e-3

#: The most innovations that are published at once in real time.
_TOLD = 8

#: What the reading of a sensor, taken at a time, did to the belief.
_Correction = tuple[SensorChannel, int, Correction]
#: What has come: its time, whence, and what it says.
_Come = tuple[int, Channel, Sample]


class EstimatorNode(runtime.ScenarioNode):
    """Feeds an `OnlineEstimator` from topics and publishes what it believes."""

    def __init__(self) -> None:
        super().__init__('estimator', EstimatorOptions)

    def configure(self) -> None:
        """Build the filter, and what it reads and publishes."""
        super().configure()
        scenario, options = self.scenario, self.options
        if 0.0 < options.publish_rate < _SLOWEST:
            expected = f'0 or at least {_SLOWEST:g} Hz'
            raise ValueError(f'publish_rate: expected {expected}, got {options.publish_rate:g}')
        self._warn = Throttle(self.get_logger().warning)
        found = fusion(scenario, options, self.extra)
        # this also loads what the first step needs: a plant that moves would not wait for it
        check_start(found.filter, scenario)
        idle = idle_input(scenario.model, options.idle_input)
        seen = observability(scenario)
        self._online = OnlineEstimator(
            found.filter, found.sensors, scenario.initial_belief, idle, found.policy
        )
        self._publish = EstimatePublisher(self, scenario, options.frame, options.child_frame)
        self._input = InputChannel(scenario.input)
        self._read_pose = PoseReader(scenario)
        self._inputs: Counter[Outcome] = Counter()
        self._latency = Latency()
        #: The sensors whose clocks ran ahead when that was last looked at.
        self._ahead: Set[str] = set()
        self._observability = ObservabilityMeter(scenario)
        self._channels = {
            name: SensorChannel(self, name, source, scenario.state)
            for name, source in scenario.sensors.items()
        }
        for channel in self._channels.values():
            channel.nis.inside()  # it, too, loads much the first time, 0.2 s of it
        self.get_logger().info(str(seen))  # now that nothing is refused any more

    def activate(self) -> None:
        """Start from the initial belief, and listen.

        What was believed before is of no use: nobody told it which inputs there were meanwhile.
        """
        scenario, options = self.scenario, self.options
        self._start_anew(scenario.initial_belief)
        self._told = -1
        self._meeting = Meeting(self._hears_input)
        subscribe = partial(self.create_subscription, raw=True)
        expect = self.diagnostics.connections.expect
        callback: Callable[..., None]
        for name, channel in self._channels.items():
            source = scenario.sensors[name]
            queue = QUEUE if options.lockstep else sensor_queue(reliable=source.reliable)
            callback = partial(self._on_turn if options.lockstep else self._on_message, channel)
            kind, topic = channel.message_type, source.signal.topic
            channel.subscription = subscribe(kind, topic, callback, queue)
            if source.timed.enabled:
                expect(channel.subscription)
        driven = bool(scenario.input.fields)
        if driven:
            kind, topic = self._input.message_type, scenario.input.topic
            on_message = partial(self._on_message, self._input)
            callback = self._on_answer if options.lockstep else on_message
            self._input.subscription = expect(subscribe(kind, topic, callback, QUEUE))
        self._turns: Optional[Turns] = None
        if options.lockstep:
            topics = {source.signal.topic: name for name, source in scenario.sensors.items()}
            self._turns = Turns(topics, answered=driven)
            subscribe(TimeReference, 'tick', self._on_tick, QUEUE)
        else:
            self.at_the_end(self._watch_clock().unregister)
            if options.publish_rate:
                self.create_timer(1.0 / options.publish_rate, self._publish_now)
        subscribe(self._read_pose.message_type, 'initialpose', self._on_initial_pose, QUEUE)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return the options of the filter."""
        implementation = str(chosen.get('implementation', 'native'))
        return filter_options(str(chosen['filter']), implementation)

    def _watch_clock(self) -> Any:
        """Start anew whenever simulated time goes back, as that of a bag that is played again."""
        back = JumpThreshold(min_forward=None, min_backward=_BACK, on_clock_change=False)
        return self.get_clock().create_jump_callback(back, post_callback=self._on_clock_back)

    def _on_clock_back(self, jump: Any) -> None:
        back = -jump.delta.nanoseconds * 1e-9
        self.get_logger().warning(f'the clock went back by {back:.3g} s: restarting')
        self._restart()

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_turn(self, channel: SensorChannel, data: bytes) -> None:
        """Take in a reading of a step in lockstep."""
        source = self.scenario.sensors[channel.name]
        if source.timed.enabled and self._turns is not None:
            reading = channel.read(data, source)
            self._turns.reading(channel.name, reading.time, reading)
            self._take_turns(self._turns)

    def _on_answer(self, data: bytes) -> None:
        """Take in the input of a step in lockstep."""
        input = self._read_input(data)
        if input is not None and self._turns is not None:
            self._turns.input(input.time, input.values)
            self._take_turns(self._turns)

    def _on_message(self, first: Channel, data: bytes) -> None:
        """Take in all that has come, of every topic, and publish once what is believed then.

        As long as nothing waits, that is reading by reading. When more comes than there is time
        for, estimates become fewer, not old.
        """
        came = monotonic()
        come = list(self._readings_come(first, data))
        # no input waits long behind a single reading
        if first is self._input or len(come) > 1:
            come += self._inputs_come(first, data)
        now, began = self._now() or None, monotonic()
        corrections = self._fuse(come, now)
        if not corrections or not self._meeting.over:
            return
        if self._online.time is not None and not self.options.publish_rate:
            self._publish(self._online.time, self._online.belief)
            done = monotonic()
            self._latency.add(done - came)
            for channel, time, _ in corrections:
                channel.age.add(((now or time) - time) * 1e-9 + done - began)
        self._tell(corrections)

    def _tell(self, corrections: list[_Correction]) -> None:
        """Publish the innovations: all in lockstep, the newest of many in real time."""
        for channel, _, correction in corrections:
            channel.judge(correction)
        for channel, time, correction in corrections[0 if self.options.lockstep else -_TOLD :]:
            channel.publish(time, correction)

    def _hears_input(self) -> bool:
        """Tell whether what sets the state in motion is heard: else it would move unnoticed."""
        resting = self.options.rest_until_input and not self._inputs.total()
        subscription = self._input.subscription
        return not resting or subscription is None or subscription.get_publisher_count() > 0

    def _readings_come(self, first: Channel, data: bytes) -> Iterator[_Come]:
        """Yield the readings that have come, after ``data`` of what woke the node."""
        now = self._now()
        for name, channel in self._channels.items():
            source = self.scenario.sensors[name]
            messages, missed = channel.take([data] if channel is first else [])
            if source.timed.enabled:
                self._overrun(self._online.counts[name], missed, f'readings of {name}')
                read = partial(channel.read, source=source)
                for message in messages:
                    reading = self.intake(channel.topic, read, message)
                    if reading is None:
                        continue
                    time = reading.time or now
                    if now:  # simulated time may not have begun
                        channel.measure_lead(time, now)
                    yield time, channel, reading

    def _inputs_come(self, first: Channel, data: bytes) -> Iterator[_Come]:
        """Yield the inputs that have come, after ``data`` of what woke the node."""
        if self._input.subscription is None:
            return
        messages, missed = self._input.take([data] if self._input is first else [])
        self._overrun(self._inputs, missed, self.scenario.input.topic)
        for message in messages:
            input = self.intake(self._input.topic, self._read_input, message)
            if input is not None:
                time = input.time or self._now()
                yield time, self._input, input

    def _overrun(self, account: Counter[Outcome], missed: int, what: str) -> None:
        if missed:
            account[Outcome.OVERRUN] += missed
            self._warn(f'{what} {Outcome.OVERRUN.value}')

    def _fuse(self, come: Iterable[_Come], now: Optional[int] = None) -> list[_Correction]:
        """Fuse the messages received by ``now``, and return the corrections by readings."""
        # in the order of the stamps: what comes with something later is not too old beside it
        come = sorted(come, key=itemgetter(0))
        arrivals = [
            Arrival(channel.name, time, sample.values, sample.covariance)
            for time, channel, sample in come
        ]
        corrections = []
        for (time, channel, sample), fate in zip(come, self._online.add(arrivals, now)):
            outcome, correction = fate
            if isinstance(channel, SensorChannel):
                self._account_for_reading(channel, time, outcome)
                if correction is not None:
                    corrections.append((channel, time, correction))
            else:
                self._account_for_input(time, sample.values, outcome)
        return corrections

    def _account_for_reading(self, channel: SensorChannel, time: int, outcome: Outcome) -> None:
        if outcome is Outcome.WRONG_SIZE:
            self._warn(f'reading of {channel.name} {outcome.value}: {channel.trouble}')
        elif outcome is not Outcome.FUSED:
            self._warn(f'reading of {channel.name} {outcome.value}')
        if outcome.accepted:
            self._observability.reading(channel.name, time)

    def _account_for_input(self, time: int, u: Array, outcome: Outcome) -> None:
        self._inputs[outcome] += 1
        if outcome.accepted:
            self._observability.input(time, u)
        if outcome is not Outcome.FUSED:
            self._warn(f'{self.scenario.input.topic} {outcome.value}')

    def _read_input(self, data: bytes) -> Optional[Sample]:
        """Return the input in a message; None, with a warning, if there is none in it."""
        try:
            return self._input.read(data)
        except (LookupError, ValueError) as error:
            self._warn(f'{self.scenario.input.topic}: {error}')
            return None

    def _on_tick(self, data: bytes) -> None:
        if self._turns is None:
            return
        time, topics = read_tick(data)
        asked_again = self._turns.waits_for(time)
        if self._turns.tick(time, topics):
            self.get_logger().info('time went back: restarting')
            self._restart()
        self._take_turns(self._turns)
        unanswered = self._turns.unanswered
        if asked_again and unanswered is not None:
            # the input that answered it was lost on its way to here: have it said again
            self._publish(unanswered, self._online.predicted(unanswered))

    def _take_turns(self, turns: Turns) -> None:
        for turn in turns.complete():
            come: list[_Come] = [
                (y.time or turn.time, self._channels[name], y) for name, y in turn.readings
            ]
            if turn.input is not None:
                time, u = turn.input
                come.append((time, self._input, Sample(time, u, None)))
            corrections = self._fuse(come)
            self._publish(turn.time, self._online.predicted(turn.time))
            self._tell(corrections)

    def _publish_now(self) -> None:
        if self._online.time is None:
            return
        time = max(self._now(), self._online.time)
        if time != self._told:  # simulated time may rest between two ticks of a timer
            self._told = time
            self._publish(time, self._online.predicted(time))

    def _on_initial_pose(self, data: bytes) -> None:
        try:
            belief = self._read_pose(data, self.scenario.initial_belief)
        except ValueError as error:
            self._warn(f'initialpose: {error}')
            return
        self._start_anew(belief)
        self.get_logger().info('reset to initialpose')

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._start_anew(self.scenario.initial_belief)
        response.success, response.message = True, 'back at the initial belief'
        return response

    def _start_anew(self, belief: Gaussian) -> None:
        """Forget what came, with what it said of the filter; counts go on."""
        self._online.reset(belief)
        self._judge_anew()

    def _restart(self) -> None:
        """Forget what came, for time went back, and count that."""
        self._online.restart()
        self._judge_anew()

    def _judge_anew(self) -> None:
        self._judged = self._online.restarts
        for channel in self._channels.values():
            channel.start_anew()

    def prepare(
        self, scenario: Scenario, options: EstimatorOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Change the model's parameters, noise or gates; the belief stays."""
        found = fusion(scenario, options, extra)
        observability(scenario)  # what no filter can follow is refused

        def apply() -> None:
            self._online.configure(found.filter, found.sensors, found.policy)
            self._observability.configure(scenario)

        return apply

    def report(self) -> Report:
        """Return what became of the readings, and whether they scatter as expected."""
        if self._online.restarts != self._judged:  # by itself, after a gap for one
            self._judge_anew()
        values: dict[str, Any] = {}
        for name, counts in self._online.counts.items():
            values.update(self._channels[name].report(counts))
        sources = self.scenario.sensors
        ahead = {name: found.ahead for name, found in self._channels.items() if found.ahead}
        words = ' and '.join(f'{name} by {lead:.2g} s' for name, lead in ahead.items())
        if ahead.keys() - self._ahead:
            self.get_logger().warning(f'stamps are ahead of the clock: {words}')
        self._ahead = ahead.keys()
        silent = [name for name, found in self._channels.items() if found.silent(sources[name])]
        doubtful = [name for name, found in self._channels.items() if not found.nis.inside()]
        if str(self._latency):
            key = 'from arrival to publication, 50 / 90 / 99 % [ms]'
            values[key] = str(self._latency)
        values[f'{self.scenario.input.topic}: used'] = self._inputs[Outcome.FUSED]
        values[f'{self.scenario.input.topic}: heard'] = self._inputs.total()
        values['estimates published'] = self._publish.count
        values.update(self._observability.report(self._online.belief.mean))
        values['restarts'] = self._online.restarts
        values['repairs of the covariance'] = self._online.repairs
        if ahead:
            return Level.WARN, f'stamps are ahead of the clock: {words}', values
        if self._online.time is None:
            return Level.WARN, self._unstarted(), values
        if silent and not self.options.lockstep:
            return Level.WARN, f'no readings of {" and ".join(silent)} received', values
        if self._online.contradicting:
            which = ' and '.join(self._online.contradicting)
            return Level.WARN, f'{which} contradicts the sensors that agree', values
        if doubtful:
            which = ' and '.join(doubtful)
            return Level.WARN, f'innovations of {which} do not scatter as expected', values
        return Level.OK, 'consistent', values

    def _unstarted(self) -> str:
        """Return why there is no estimate yet."""
        dropped = [
            f'{count} of {name} {outcome.value}'
            + (f' ({self._channels[name].trouble})' if outcome is Outcome.WRONG_SIZE else '')
            for name, counts in self._online.counts.items()
            for outcome, count in counts.items()
            if count
        ]
        if not dropped:
            return 'no readings received'
        return f'no reading could be used: {", ".join(dropped)}'


def main() -> None:
    """Run the estimator."""
    runtime.main(EstimatorNode)
