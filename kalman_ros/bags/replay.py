# SPDX-License-Identifier: Apache-2.0
"""Replay of a recording through the estimator, as in its node but faster than real time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import chain, repeat
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import models
from kalman_ros.codecs.messages import UndecodableError, full_type
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import is_finite
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.pipeline.settings import Settings, settings
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file, own_section

from .blocks import Messages, grouped, joined
from .collecting import EstimateRecording, seconds
from .columns import Rows
from .feed import TICK, Feed, resolver
from .pose_topics import PoseReader, has_poses
from .reading import Bag
from .recording_writer import RecordingWriter
from .replayed import Replayed, Truth
from .smoothing import FinalBeliefs
from .steps import Steps

#: Number of messages that are taken together, at first and then, with a report of the progress,
#: and of the numbers of their covariances.
_FIRST, _FEWEST, _MOST, _NUMBERS = 20, 500, 16_000, 4_000_000
#: Most bytes of these messages.
_BYTES = 16_000_000
#: Note on a comparison of estimates that are not those at the readings.
_AT_TICKS = (
    'Estimates are those of publish_rate, which lack the reading of the same instant: '
    '-p publish_rate:=0.0 compares what the filter makes of it.'
)


def estimator_settings(
    scenario: str | Path | Mapping[str, Any] | None, overrides: Mapping[str, Any] | None = None
) -> Settings:
    """Return the settings of the estimator's node with these parameters.

    Parameters
    ----------
    scenario
        The name of a scenario in ``config/``, the path of a parameter file, or the parameters
        themselves; None for the default of the node.
    overrides
        Parameters over those of the scenario.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """
    if isinstance(scenario, Mapping):
        parameters = dict(scenario)
    else:
        parameters = from_file(shipped.file(scenario or models.DEFAULT), 'estimator')
    parameters.update(overrides or {})
    if 'model' not in parameters:
        section = own_section(shipped.file(models.DEFAULT), 'estimator')
        parameters = {'model': models.DEFAULT, **section, **parameters}
    return settings(parameters)


@knows_arguments(params='scenario', parameters='scenario', file='bag', seconds='end')
def replay(
    bag: str | Path,
    scenario: str | Path | Mapping[str, Any] | None = None,
    overrides: Mapping[str, Any] | None = None,
    *,
    start: float = 0.0,
    end: float = inf,
    smooth: bool = False,
    truth: str = '',
    against: str = '',
    namespace: str = '/',
    out: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Replayed:
    """Replay a recording through the estimator, as its node would receive it.

    The messages pass through the same decoder, the same estimator and the same rules for data
    that are late, missing, doubled or out of order, in the order in which they were received.

    Parameters
    ----------
    bag
        A folder of rosbag2 (MCAP or SQLite), one of its files, or a bag of ROS 1.
    scenario
        The name of a scenario, the path of a parameter file, or the estimator's parameters.
    overrides
        Parameters over those of the scenario: ``{'imu.topic': '/imu/data'}``.
    start, end
        Part of the recording, in seconds from its start; in lockstep, in simulated seconds.
    smooth
        Whether to compute the states given all readings, including later ones.
    truth
        Topic with the true state, of the type and fields that the estimate has, or with true
        poses: an odometry or a pose.
    against
        Topic with the poses of another estimator: an odometry or a pose.
    namespace
        Namespace of the topics of the scenario.
    out
        Folder for a recording of the topics that the estimator publishes; an earlier one in it is
        replaced.
    progress
        Function that is called now and then with the seconds of the recording that are done.

    Raises
    ------
    ValueError
        If the recording, the parameters or a topic cannot be used; one line gives the reason.

    Examples
    --------
    Of half a minute in the folder ``monday``:

    >>> import kalman_ros as kr
    >>> replayed = kr.replay('monday', 'mass_spring_damper')
    >>> replayed.beliefs.mean.shape
    (3602, 2)
    >>> position = replayed.sensors['position']
    >>> position.fused, round(float(position.nis.mean()), 2)
    (601, 1.07)
    """
    configured = estimator_settings(scenario, overrides)
    return replay_bag(
        Bag(bag), configured, start=start, end=end, smooth=smooth, truth=truth,
        against=against, namespace=namespace, out=out, progress=progress,
    )  # fmt: skip


def replay_bag(
    bag: Bag,
    settings: Settings,
    *,
    start: float = 0.0,
    end: float = inf,
    smooth: bool = False,
    truth: str = '',
    against: str = '',
    namespace: str = '/',
    out: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Replayed:
    """Replay a recording that is open; see `replay`."""
    bag.limits(start, end)
    if out is not None:
        source, folder = bag.path.resolve(), Path(out).resolve()
        if folder in (source, source.parent):
            raise ValueError(f"out: expected another folder than that of the recording, '{out}'")
    resolve = resolver(namespace)
    feed = Feed(settings, bag, resolve, min(end, seconds(bag.end, bag.start)) - start)
    final = (
        FinalBeliefs(feed.online, len(feed.settings.scenario.model.input.names))
        if smooth
        else None
    )
    known = _truth_reader(feed.settings, bag, resolve(truth)) if truth else None
    other = PoseReader(bag, resolve(against), 'against') if against else None
    readers = [reader for reader in (known, other) if reader is not None]
    if readers and settings.options.publish_rate and not feed.lockstep:
        feed.notes.append(_AT_TICKS)
    with ExitStack() as stack:
        if out is not None:
            writer = stack.enter_context(RecordingWriter(out, replace=True))
            feed.recording = EstimateRecording(writer, feed.settings, resolve, feed.origin)
        received = _pass_messages(feed, readers, bag, resolve(TICK), start, end, progress)
    assert feed.start is not None  # a message was passed
    beliefs, believed = feed.beliefs.result(), feed.settings.scenario.believed
    return Replayed(
        scenario=feed.settings.scenario,
        start=feed.start,
        duration=(beliefs.time[-1] if feed.lockstep else seconds(received, feed.start)) - start,
        lockstep=feed.lockstep,
        sensors={
            name: columns.result(dict(feed.online.counts[name]), feed.undecodable(name))
            for name, columns in feed.sensors.items()
        },
        beliefs=beliefs,
        inputs=feed.inputs.result(),
        restarts=feed.online.restarts,
        repairs=feed.online.repairs,
        smoothed=None if final is None else final.smoothed(feed.start, believed.own),
        biases=believed.biases(feed.online.belief),
        truth=known.result(feed.start) if isinstance(known, _TruthReader) else None,
        true_poses=known.result(feed.start) if isinstance(known, PoseReader) else None,
        against=None if other is None else other.result(feed.start),
        frame=feed.settings.options.frame,
        notes=(*bag.damage, *feed.notes, *feed.lost_inputs()),
        arithmetic=feed.fuser.arithmetic,
    )


def _pass_messages(
    feed: Feed,
    readers: Sequence[_TruthReader | PoseReader],
    bag: Bag,
    tick: str,
    start: float,
    end: float,
    progress: Callable[[float], None] | None,
) -> int:
    """Pass the messages of a part to the feed and to the readers; return when the last one came.

    Raises
    ------
    ValueError
        If there is none, or no step of a recording in lockstep.
    """
    topics = [*feed.topics, *(reader.topic for reader in readers)]
    count, received = 0, 0
    if feed.lockstep:
        steps = Steps(bag.messages(topics), tick, start, end)
        batches = grouped(steps)
    else:
        batches = bag.batches(topics, *bag.limits(start, end))
    # few at first, after which the layout of each message is known
    many = _NUMBERS // feed.settings.scenario.model.state.size**2
    sizes = chain([_FIRST], repeat(min(max(many, _FEWEST), _MOST)))
    for block in _blocks(batches, sizes):
        count += len(block)
        received = block.time[-1]
        if feed.start is None:
            feed.start = steps.origin
        for reader in readers:
            for message in block:
                if message.topic == reader.topic:
                    reader(message.data)
        feed.take(block.on(feed.topics) if readers else block)
        if progress is not None:
            progress(seconds(received, bag.start) - start)
    if feed.start is None or not count or (feed.lockstep and not feed.beliefs):
        names = ', '.join(feed.topics)
        raise ValueError(
            f'nothing could be replayed from {bag.path}: {count} messages on {names}'
            f'{_out_of_step(feed)}'
        )
    return received


def _blocks(batches: Iterable[Messages], sizes: Iterator[int]) -> Iterator[Messages]:
    """Yield messages together, of some numbers, and of some bytes at most."""
    parts: list[Messages] = []
    count, size, most = 0, 0, next(sizes)
    for batch in batches:
        begin = 0
        for end, length in enumerate(map(len, batch.data), 1):
            count, size = count + 1, size + length
            if count >= most or size > _BYTES:
                yield joined([*parts, batch.some(slice(begin, end))])
                parts, begin, count, size, most = [], end, 0, 0, next(sizes)
        parts.append(batch.some(slice(begin, None)))
    if count:
        yield joined(parts)


def _truth_reader(settings: Settings, bag: Bag, topic: str) -> _TruthReader | PoseReader:
    """Return the reader of true states, or of poses where a topic has another type that is one."""
    state = full_type(settings.scenario.state.type)
    if has_poses(bag, topic) and bag.topics[topic] != {state}:
        return PoseReader(bag, topic, 'truth')
    return _TruthReader(settings, bag, topic)


def _out_of_step(feed: Feed) -> str:
    """Return which offsets of stamps keep a recording in lockstep from its steps, if any do."""
    sources = feed.settings.scenario.enabled.items() if feed.lockstep else ()
    moved = [f'{name}.stamp_offset' for name, source in sources if source.signal.stamp_offset]
    if not moved:
        return ''
    options = ' and '.join(moved)
    return f'; it is in lockstep, where {options} can only be whole periods of the sensor'


class _TruthReader:
    """Reader of the true states of a recording."""

    def __init__(self, settings: Settings, bag: Bag, topic: str) -> None:
        self.topic = topic
        state = settings.scenario.state
        bag.check(topic, full_type(state.type), 'truth')
        self._read = WireReader(SignalCodec(state))
        self._state = Rows(x=(len(state.fields),))
        self._stamps: list[int] = []

    def __call__(self, data: bytes) -> None:
        """Add the state in a message, if it can be decoded, has a stamp and is finite."""
        try:
            time, x, _ = self._read(data)
        except (UndecodableError, LookupError, ValueError):
            return
        if time is not None and is_finite(x):
            self._stamps.append(time)
            self._state.append(x)

    def result(self, start: int) -> Truth:
        """Return the states in the order of their stamps, each stamp once."""
        stamps, which = np.unique(np.array(self._stamps, dtype=np.int64), return_index=True)
        return Truth(np.asarray((stamps - start) * 1e-9), self._state.columns()['x'][which])
