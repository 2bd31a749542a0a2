# SPDX-License-Identifier: Apache-2.0
"""Feed of an estimator with recorded messages, by the classes that its node uses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from kalman_ros.codecs.messages import UndecodableError, full_type, message_type, nanoseconds
from kalman_ros.codecs.messages import decode as decoded
from kalman_ros.codecs.wire import learn_layouts
from kalman_ros.core import Gaussian, unchecked
from kalman_ros.core.named_options import nearest
from kalman_ros.estimators.arrivals import Arrivals, Taken
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.frames import STATIC, TF, Frames
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.fusion import fusion
from kalman_ros.pipeline.initial_pose import POSES, SHARED, PoseReader
from kalman_ros.pipeline.intake import Intake
from kalman_ros.pipeline.lockstep_fuser import LockstepFuser
from kalman_ros.pipeline.mounts import Mounts
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader
from kalman_ros.pipeline.settings import Settings
from kalman_ros.pipeline.transforms import TYPE
from kalman_ros.scenario import Scenario

from .ahead import Ahead
from .blocks import Message, Messages
from .collecting import (
    BeliefColumns,
    EstimateRecording,
    InputColumns,
    SensorColumns,
    add_all,
    seconds,
)
from .reading import Bag

TICK, CLOCK = 'tick', '/clock'
TICK_TYPE, CLOCK_TYPE = 'sensor_msgs/msg/TimeReference', 'rosgraph_msgs/msg/Clock'
#: Nanoseconds beyond which a simulated clock that goes back has been set back.
_BACK = 100_000_000
#: Most messages that are taken one by one before it is tried again to take many.
_LONGEST_PAUSE = 64
#: Fewest messages that are tried to be taken together, and that are worth the trial.
_FEWEST, _WORTH_IT = 64, 16
#: How many times as many are tried after a success.
_GROWTH = 4
#: Number of readings that are worth the compilation of a filter as a whole.
_LONG = 10_000
#: Times of receipt that whole numbers of 8 bytes can hold, with a year to add.
_LATEST = 2**63 - 2**55


class Feed:
    """Receiver of the messages of a recording, one by one, as the node would receive them.

    A recording with ticks is in lockstep: a step is fused when it is complete. Otherwise each
    reading is fused when it is received, at the time of the recording, or of ``/clock`` if the
    parameters say that time is simulated.

    Parameters
    ----------
    settings
        Settings of the estimator.
    bag
        Recording that is replayed.
    resolve
        Function that returns the full name of a topic.
    length
        Seconds that are replayed.

    Raises
    ------
    ValueError
        If the recording lacks a topic, or has it with another type.
    """

    def __init__(
        self, settings: Settings, bag: Bag, resolve: Callable[[str], str], length: float
    ) -> None:
        self.lockstep = _has_ticks(bag, resolve(TICK))
        self.settings = settings = settings.in_lockstep(self.lockstep)
        learn_layouts(on=settings.options.learn_layouts)
        scenario = settings.scenario
        rates = sum(source.timed.rate for source in scenario.enabled.values())
        one_by_one = self.lockstep or self._publishes
        self._many_at_once = length * rates > _LONG and not one_by_one
        estimation = settings.fusion(many=self._many_at_once)
        self.online = settings.estimator(estimation)
        self.origin = settings.origin()
        #: Sentences about what the recording lacks.
        self.notes: list[str] = []
        frames, note = (settings.options.frame, settings.options.child_frame), self.notes.append
        self._mounts = mounts = Mounts(scenario, settings.options.child_frame, note)
        mounts.on_mounted = self._use
        channels = {
            name: SensorReader(name, source, self.origin, frames, note, mounts)
            for name, source in scenario.sensors.items()
        }
        input = InputReader(scenario.input, frames, note, mounts)
        timeout = settings.input_timeout()
        self.fuser = Fuser(
            scenario, self.online, channels, input, lambda _: None, timeout, estimation.arithmetic
        )
        self._intake = Intake(lambda _: None)
        self._intake.longest = settings.options.max_message_size
        self._read_pose, self._frames = PoseReader(scenario, settings.options.frame), Frames()
        self._resolve = resolve
        #: Function that takes the messages of each topic, by its full name.
        self._take: dict[str, Callable[[bytes], object]] = {}
        #: Functions that read each topic of sensors, which several sensors may share.
        self._readers: dict[str, list[Callable[[bytes], object]]] = {}
        self._wire(bag)
        self._topics_ahead, self._input_ahead = self._find_topics_ahead()
        #: Time at which a message is received, in nanoseconds.
        self._now = 0
        self._simulated = CLOCK in self._take
        #: Time from which all times are counted, in nanoseconds; None before it is known.
        self.start: int | None = None if self.lockstep else bag.start
        self._period = round(1e9 / settings.options.publish_rate) if self._publishes else 0
        self._due: int | None = None
        self.sensors = {name: SensorColumns(source) for name, source in scenario.enabled.items()}
        self.beliefs = BeliefColumns(scenario.model.state.size)
        self.inputs = InputColumns(scenario.model.input.size)
        #: Recording of the estimator's topics, if there is one.
        self.recording: EstimateRecording | None = None
        self._received = 0
        #: Number of messages to try to take together next.
        self._many = _FEWEST

    @property
    def _publishes(self) -> bool:
        """Whether estimates are published at a rate, and not at each reading."""
        return self.settings.options.publish_rate > 0.0 and not self.lockstep

    @property
    def topics(self) -> list[str]:
        """Full names of the topics that are used."""
        return [*self._take]

    def _wire(self, bag: Bag) -> None:
        """Connect the topics of the recording that are needed."""
        scenario, resolve = self.settings.scenario, self._resolve
        self._steps = steps = LockstepFuser(self.fuser, self, lambda _: None, resolve)
        for name, source in scenario.enabled.items():
            topic = resolve(source.signal.topic)
            bag.check(topic, full_type(source.signal.type), f'sensor {name}')
            on_reading = partial(steps.on_reading if self.lockstep else self._on_reading, name)
            readers = self._readers.setdefault(topic, [])
            readers.append(on_reading)
            self._take[topic] = partial(_call_all, readers)
        # without transforms, what is in the frame of the body is still used
        if self._mounts.needed and STATIC in bag.topics:
            bag.check(STATIC, full_type(TYPE), 'mount.tf')
            self._take[STATIC] = self._mounts.on_static
        if scenario.model.input.size:
            topic = resolve(scenario.input.topic)
            if topic in bag.topics or self.lockstep:
                bag.check(topic, full_type(scenario.input.type), 'input')
                readers = self._readers.setdefault(topic, [])  # a sensor may be on it, too
                readers.append(steps.on_input if self.lockstep else self._on_input)
                self._take[topic] = partial(_call_all, readers)
            else:
                alike = nearest(topic, bag.topics)
                hint = f' ({alike})' if alike else ''
                self.notes.append(
                    f'The recording has no input {topic}{hint}: it is taken to be idle.'
                )
        if self.lockstep:
            self._take[resolve(TICK)] = steps.on_tick
        elif self.settings.simulated_time and CLOCK in bag.topics:
            bag.check(CLOCK, CLOCK_TYPE, 'use_sim_time')
            self._take[CLOCK] = self._on_clock
        elif self.settings.simulated_time:
            self.notes.append(f'The recording has no {CLOCK}: messages come when recorded.')
        pose = full_type('geometry_msgs/PoseWithCovarianceStamped')
        posed = [name for name in POSES if bag.topics.get(resolve(name)) == {pose}]
        for name in posed:
            self._take[resolve(name)] = partial(self._on_pose, name)
        if posed:
            self._look_at_frames(bag)

    def _find_topics_ahead(self) -> tuple[dict[str, str], str]:
        """Return the topics that are decoded ahead, of each sensor and of the input.

        They are read by sensors alone, or by the input alone; '' stands for others.
        """
        scenario, resolve = self.settings.scenario, self._resolve
        acting = resolve(scenario.input.topic) if scenario.model.input.size else ''
        others = {TF, STATIC, *map(resolve, POSES)}
        topics = dict.fromkeys(self.online.sensors, '')
        for name, source in scenario.enabled.items():
            topic = resolve(source.signal.topic)
            topics[name] = '' if topic in others or topic == acting else topic
        single = len(self._readers.get(acting, ())) == 1 and acting not in others
        return topics, acting if single else ''

    def _look_at_frames(self, bag: Bag) -> None:
        """Take the transforms, by which poses in other frames are transformed."""
        for topic in (TF, STATIC):
            if bag.topics.get(topic) != {full_type(TYPE)}:
                continue
            takers = [self._take[topic]] if topic in self._take else []
            add = partial(self._frames.add, moving=topic == TF)
            self._take[topic] = partial(_call_all, [*takers, add])

    def _use(self, scenario: Scenario) -> None:
        """Continue with a sensor whose mounting is known now."""
        options, extra = self.settings.options, self.settings.extra
        estimation = fusion(scenario, options, extra, many=self._many_at_once)
        self.fuser.configure(scenario, estimation)

    def __call__(self, message: Message) -> None:
        """Take the next message."""
        self._received = message.time
        if not self._simulated:
            self._now = message.time
        if self._period:
            self._publish_until(self._now)
        self._intake.read(message.topic, self._take[message.topic], message.data)

    def take(self, messages: Messages) -> None:
        """Take the next messages; those that need no decision at once."""
        one_by_one = self.lockstep or self._period or self._simulated
        beyond = max(messages.time, default=0) > _LATEST
        if one_by_one or beyond or not self.online.takes_many:
            for message in messages:
                self(message)
            return
        ahead = Ahead(
            messages, self.fuser, self._topics_ahead, self._input_ahead, self._intake.longest
        )
        at = wait = pause = 0
        while at < len(ahead):
            if wait:
                at, wait = self._take_one(ahead, at), wait - 1
                continue
            taken = self._take_first(ahead, at)
            pause = 0 if taken >= _WORTH_IT else min(2 * pause + 1, _LONGEST_PAUSE)
            at, wait = at + taken, pause

    def _take_one(self, ahead: Ahead, at: int) -> int:
        """Take a message for one of its sensors, or for all others; return what is next."""
        message, name = ahead.delivery(at)
        if not name:
            self(message)
            return at + 1
        self._received = self._now = message.time
        dropped = self._intake.dropped(message.topic)
        if at in ahead.known:
            self._fuse(name, ahead.known[at])
        elif at in ahead.undecodable:
            self._intake.drop_undecodable(message.topic, message.data)
        else:
            self._intake.read(message.topic, partial(self._on_reading, name), message.data)
        # what one sensor cannot decode is not passed to the next
        lost = self._intake.dropped(message.topic) > dropped
        return ahead.next_message(at) if lost else at + 1

    def _take_first(self, ahead: Ahead, at: int) -> int:
        """Take the messages from one on that need no decision, and return how many."""
        arrivals = ahead.first(at, self._many)
        tried = len(arrivals.time)
        taken = self.fuser.fuse_first(arrivals) if tried else None
        count = 0 if taken is None else len(taken.time)
        self._many = max(_GROWTH * (tried if count == tried else count), _FEWEST)
        if taken is None or not count:
            return 0
        assert self.start is not None
        time, now, source, row, _, _ = arrivals.some(slice(count))
        received, stamp = (now - self.start) * 1e-9, (time - self.start) * 1e-9
        for index, (name, readings) in enumerate(zip(self._topics_ahead, ahead.readings)):
            which = source == index
            if which.any():
                rows = row[which]
                self.sensors[name].add_fused(
                    readings.some(slice(int(rows[0]), int(rows[-1]) + 1)), received[which],
                    stamp[which], taken.innovation[index], taken.S[index], taken.nis[index],
                )  # fmt: skip
        acts = source == len(ahead.readings)
        known, mean, covariance = taken[:3]
        if acts.any():
            self.inputs.extend(received[acts], stamp[acts], ahead.inputs[row[acts]])
            known, mean, covariance = (column[~acts] for column in taken[:3])
        belief = self.settings.scenario.believed.own(unchecked((mean, covariance)))
        self.beliefs.extend((known - self.start) * 1e-9, *belief)
        if self.recording is not None:
            self._record(self.recording, arrivals.some(slice(count)), taken, belief)
        self._received = self._now = int(now[-1])
        return count

    def _record(
        self, recording: EstimateRecording, arrivals: Arrivals, taken: Taken, belief: Gaussian
    ) -> None:
        """Record what was published after each of some readings."""
        names = list(self._topics_ahead)
        read = [0] * len(names)
        rows = zip(arrivals.source.tolist(), arrivals.time.tolist(), arrivals.now.tolist())
        readings = (row for row in zip(rows, taken.time.tolist()) if row[0][0] < len(names))
        for k, ((source, stamp, now), newest) in enumerate(readings):
            mean, covariance = belief.mean[k], belief.covariance[k]
            recording.publish(now, newest, unchecked((mean, covariance)))
            at, read[source] = read[source], read[source] + 1
            v, S = taken.innovation[source][at], taken.S[source][at]
            correction = Correction(belief, v, S, nis=float(taken.nis[source][at]))
            reading = Reading(names[source], stamp, v, None, Outcome.FUSED)
            reading.correction = correction
            recording.publish_innovation(now, reading)

    def undecodable(self, name: str) -> int:
        """Return the number of messages of a sensor that were dropped before their decoding."""
        topic = self._resolve(self.settings.scenario.sensors[name].signal.topic)
        return self._intake.dropped(topic)

    def lost_inputs(self) -> Iterator[str]:
        """Yield a sentence about each reason for which inputs did not act."""
        if not self.settings.scenario.model.input.size:
            return
        topic = self._resolve(self.settings.scenario.input.topic)
        for outcome, number in self._refused_inputs().items():
            yield f'{topic}: {number} {outcome.value}'
        dropped = self._intake.dropped(topic)
        if dropped:
            yield f'{topic}: {dropped} dropped: not decodable, or too long'

    # --- in real time -------------------------------------------------------------------------

    def _on_reading(self, name: str, data: bytes) -> None:
        fuser = self.fuser
        channel = fuser.channels[name]
        self._fuse(name, channel.read(data, fuser.scenario.sensors[name]))

    def _fuse(self, name: str, reading: Reading) -> None:
        fuser, now = self.fuser, self._now
        reading.time = reading.time or now
        fused = fuser.fuse([reading], now or None)
        if fuser.judge(fused) and self.online.time is not None and not self._period:
            self.publish(self.online.time, self.online.belief)
        self.publish_innovations(fused)

    def _on_input(self, data: bytes) -> None:
        input = self.fuser.read_input(data)
        if input is None:
            return
        now, refused = self._now, sum(self._refused_inputs().values())
        input.time = stamp = input.time or now
        self.fuser.fuse([input], now or None)
        if sum(self._refused_inputs().values()) == refused:
            start = stamp if self.start is None else self.start
            self.inputs.add(seconds(now, start), seconds(stamp, start), input.values)

    def _refused_inputs(self) -> dict[Outcome, int]:
        """Return the numbers of inputs that never acted; a repeated one does already."""
        usual = (Outcome.FUSED, Outcome.DUPLICATE)
        return {o: number for o, number in self.fuser.inputs.items() if o not in usual}

    def _on_clock(self, data: bytes) -> None:
        clock = nanoseconds(decoded(data, message_type('rosgraph_msgs/Clock')).clock)
        if clock < 0:
            raise UndecodableError(f'{clock} ns is no time')
        if clock < self._now - _BACK:
            self.fuser.restart()
        self._now = clock

    def _on_pose(self, name: str, data: bytes) -> None:
        initial, shared = self.settings.scenario.believed.initial, name == SHARED
        try:
            belief = self._read_pose(data, initial, self._frames, shared=shared)
        except ValueError as error:
            self.notes.append(f'{name}: {error}')
            return
        self.fuser.reset(belief)

    def _publish_until(self, now: int) -> None:
        """Publish the predictions that are due by ``now``."""
        if self.online.time is None:
            self._due = None
            return
        if self._due is None or now - self._due > 10_000 * self._period:
            self._due = now
        while self._due <= now:
            time = max(self._due, self.online.time)
            self.publish(time, self.fuser.predicted(time))
            self._due += self._period

    # --- the results --------------------------------------------------------------------------

    def publish(self, time: int, belief: Gaussian) -> None:
        """Record the belief at ``time``, in nanoseconds, once it knows all states."""
        if isinstance(belief, Diffuse):
            return
        if self.start is None:
            self.start = time
        belief = self.settings.scenario.believed.own(belief)
        self.beliefs.add(seconds(time, self.start), belief)
        if self.lockstep:
            self._now = time
        if self.recording is not None:
            self.recording.publish(self._received, time, belief)

    def publish_innovations(self, fused: Sequence[Reading]) -> None:
        """Record readings that were fused together, with their corrections."""
        start = self._now if self.start is None else self.start
        if self.lockstep:
            self.fuser.judge(fused)
            if self._steps.last_input is not None:
                stamp, u = self._steps.last_input
                self.inputs.add(seconds(stamp, start), seconds(stamp, start), u)
        add_all(fused, self.sensors, self._now, start)
        if self.recording is not None:
            for reading in fused:
                self.recording.publish_innovation(self._received, reading)


def _has_ticks(bag: Bag, topic: str) -> bool:
    """Return whether there is a tick; a plant may offer the topic and run in real time."""
    ticks = bag.messages([topic]) if bag.topics.get(topic) == {TICK_TYPE} else iter(())
    return next(ticks, None) is not None


def _call_all(readers: Sequence[Callable[[bytes], object]], data: bytes) -> None:
    """Pass a message to each of several readers."""
    for read in readers:
        read(data)


def resolver(namespace: str) -> Callable[[str], str]:
    """Return the function that makes full names of topics, in a namespace such as ``/robot``."""
    base = f'/{namespace.strip("/")}'.rstrip('/')

    def resolve(topic: str) -> str:
        return topic if topic.startswith('/') else f'{base}/{topic}'

    return resolve
