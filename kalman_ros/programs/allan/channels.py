# SPDX-License-Identifier: Apache-2.0
"""The six channels of an inertial sensor in a recording."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from kalman_ros.bags.reading import Bag
from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal, is_finite

KIND = 'sensor_msgs/msg/Imu'
NAMES = ('gyro x', 'gyro y', 'gyro z', 'accel x', 'accel y', 'accel z')
UNITS = ('rad/s',) * 3 + ('m/s^2',) * 3
_FIELDS = tuple(f'{part}.{axis}' for part in ('angular_velocity', 'linear_acceleration')
                for axis in 'xyz')  # fmt: skip
#: A distance between two readings of more periods is a gap.
_GAP = 1.5


@dataclass(frozen=True)
class Channels:
    """Evenly spaced readings (N, 6) of a topic, one every ``period`` s.

    The longest part of the recording without a gap is used. ``gaps`` is the number of gaps in the
    whole recording, ``whole`` its number of readings, and ``dropped`` the number of messages that
    cannot be decoded or are not finite.
    """

    topic: str
    values: Array
    period: float
    gaps: int
    whole: int
    dropped: int


def topics(bag: Bag, topic: str = '') -> list[str]:
    """Return the topics of a recording that hold an inertial sensor, or the requested topic.

    Raises
    ------
    ValueError
        If there is no such topic, or the requested topic has another type.
    """
    if topic:
        name = f'/{topic.lstrip("/")}'
        bag.check(name, KIND, 'topic')
        return [name]
    imu_topics = sorted(name for name, kinds in bag.topics.items() if KIND in kinds)
    if not imu_topics:
        raise ValueError(f"'{bag.path}' has no topic with {KIND}; it has {', '.join(bag.topics)}")
    return imu_topics


def channels(bag: Bag, topic: str, limits: tuple[float, float] = (0.0, inf)) -> Channels:
    """Read a topic, in the order of its stamps, between two times in seconds.

    Raises
    ------
    ValueError
        If fewer than two messages can be read.
    """
    read = WireReader(SignalCodec(Signal(topic, KIND, _FIELDS)))
    times, rows, dropped = [], [], 0
    for message in bag.messages([topic], *bag.limits(*limits)):
        try:
            sample = read(message.data)
        except (UndecodableError, LookupError, ValueError):
            dropped += 1
            continue
        if not is_finite(sample.values):
            dropped += 1
            continue
        times.append(sample.time or message.time)
        rows.append(sample.values)
    stamps, first = np.unique(np.array(times, dtype=np.int64), return_index=True)
    if len(stamps) < 2:
        raise ValueError(f'{topic}: expected at least two readings, got {len(stamps)}')
    values, steps = np.array(rows)[first], np.diff(stamps) * 1e-9
    period = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * period) + 1
    edges = np.concatenate(([0], gaps, [len(stamps)]))
    longest = int(np.diff(edges).argmax())
    part = slice(edges[longest], edges[longest + 1])
    length = edges[longest + 1] - edges[longest]
    if length > 1:  # the mean is more exact than the median, where stamps jitter
        period = float(stamps[part][-1] - stamps[part][0]) * 1e-9 / (length - 1)
    return Channels(topic, values[part], period, len(gaps), len(stamps), dropped)
