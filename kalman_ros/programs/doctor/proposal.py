# SPDX-License-Identifier: Apache-2.0
"""A parameter file for a recording: topics that fit the sensors of a shipped scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from kalman_ros.analysis.records import period
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import estimator_settings
from kalman_ros.codecs.messages import full_type
from kalman_ros.core import Array, Space
from kalman_ros.pipeline.reading_reader import ReadingReader
from kalman_ros.scenario import Scenario, SensorSource, shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.scenario.parameter_text import section_text

#: Parts of topic names that an estimator or a simulation publishes, and no sensor.
_NOT_SENSED = {'estimate', 'ground_truth'}
#: Fewest and most readings from which rate and noise are measured.
_FEWEST, _MOST = 20, 20_000


@dataclass(frozen=True)
class TopicRecord:
    """A topic of a recording.

    Parameters
    ----------
    type
        Type of the messages; several types, joined by ``and``, cannot be used.
    count
        Number of messages.
    rate
        Rate in Hz without losses; NaN below two messages.
    gap
        Longest interval in s; NaN below two messages.
    """

    type: str
    count: int
    rate: float
    gap: float


@dataclass(frozen=True)
class Match:
    """A topic whose messages can be the readings of a sensor.

    Parameters
    ----------
    topic
        Name of the topic, relative to the root namespace.
    rate
        Rate in Hz by the stamps, without losses.
    noise
        Standard deviations (k,), by the differences of successive readings; a coordinate
        whose readings do not scatter has the standard deviation of the scenario.
    """

    topic: str
    rate: float
    noise: Array


@dataclass(frozen=True)
class Proposal:
    """A shipped scenario, and the topics that its sensors can use.

    Parameters
    ----------
    scenario
        Name of the scenario.
    matches
        Match of each sensor; a sensor without a match is disabled.
    input
        Topic of the input; '' if the recording has none.
    share
        Share of the sensors that have a match.
    """

    scenario: str
    matches: Mapping[str, Match]
    input: str
    share: float

    @property
    def score(self) -> tuple[int, float]:
        """Rank of the proposal: the number of values that are used, then the share of sensors."""
        return sum(match.noise.size for match in self.matches.values()), self.share

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the estimator."""
        values = from_file(shipped.file(self.scenario), 'estimator')
        scenario = estimator_settings(self.scenario).scenario
        for name in scenario.sensors:
            match = self.matches.get(name)
            values[f'{name}.enabled'] = match is not None
            if match is not None:
                measured = {
                    'topic': match.topic,
                    'rate': match.rate,
                    'noise': match.noise.tolist(),
                }
                values.update({f'{name}.{key}': value for key, value in measured.items()})
        if self.input:
            values['input.topic'] = self.input
        return {**values, 'initialize': 'reading'}

    def yaml(self) -> str:
        """Return the text of the parameter file."""
        return section_text('/**', self.parameters())


def describe(bag: Bag) -> dict[str, TopicRecord]:
    """Return the record of each topic of a recording."""
    times: dict[str, list[int]] = {topic: [] for topic in bag.topics}
    for message in bag.messages(set(bag.topics)):
        times[message.topic].append(message.time)
    records = {}
    for topic in sorted(times):
        steps: Array = 1e-9 * np.diff(times[topic]).astype(float)
        longest = steps.max() if steps.size else np.nan
        rate = 1.0 / period(steps) if steps.size and np.median(steps) > 0.0 else np.nan
        kinds = ' and '.join(sorted(bag.topics[topic]))
        records[topic] = TopicRecord(kinds, len(times[topic]), float(rate), float(longest))
    return records


def propose(bag: Bag) -> list[Proposal]:
    """Return the shipped scenarios that fit a recording, the best first."""
    proposals = []
    for name in shipped.names():
        scenario = estimator_settings(name).scenario
        matches = dict(_matches(bag, scenario))
        if matches:
            share = len(matches) / len(scenario.sensors)
            proposals.append(Proposal(name, matches, _input(bag, scenario), share))
    return sorted(proposals, key=lambda proposal: proposal.score, reverse=True)


def _matches(bag: Bag, scenario: Scenario) -> Iterator[tuple[str, Match]]:
    """Yield each sensor with the topic that it can use; a topic serves one signal only."""
    taken: set[tuple[str, tuple[str, ...]]] = set()
    for name, source in scenario.sensors.items():
        fields = source.signal.fields
        for topic in _similar_topics(bag, source.signal.topic, source.signal.type):
            if (topic, fields) not in taken:
                match = _measure(bag, topic, source)
                if match is not None:
                    taken.add((topic, fields))
                    yield name, match
                    break


def _similar_topics(bag: Bag, topic: str, kind: str) -> list[str]:
    """Return the topics with a message type, the most similar name first."""
    fitting = [
        name
        for name, kinds in bag.topics.items()
        if kinds == {full_type(kind)} and not _NOT_SENSED & set(name.split('/'))
    ]
    likeness = {name: SequenceMatcher(None, name.lower(), f'/{topic}').ratio() for name in fitting}
    return sorted(fitting, key=lambda name: -likeness[name])


def _input(bag: Bag, scenario: Scenario) -> str:
    if not scenario.input.fields:
        return ''
    alike = _similar_topics(bag, scenario.input.topic, scenario.input.type)
    return alike[0].removeprefix('/') if alike else ''


def _measure(bag: Bag, topic: str, source: SensorSource) -> Match | None:
    """Measure rate and noise of a topic's readings; None if they are too few or all equal."""
    reader = ReadingReader(source.signal)
    times, values = [], []
    for message in bag.messages({topic}):
        reading = reader.read(message.data, source)
        if reading.outcome is None and np.isfinite(reading.values).all():
            times.append(message.time if reading.time is None else reading.time)
            values.append(reading.values)
        if len(values) >= _MOST:
            break
    if len(values) < _FEWEST or not np.ptp(values, axis=0).any():
        return None
    gaps: Array = 1e-9 * np.diff(times).astype(float)
    if np.median(gaps) <= 0.0:
        return None
    noise = scatter(source.sensor.output, np.array(values))
    known = np.sqrt(source.sensor.covariance.diagonal())
    name = topic.removeprefix('/')
    return Match(name, float(f'{1.0 / period(gaps):.4g}'), np.where(noise > 0.0, noise, known))


def scatter(space: Space, values: Array) -> Array:
    """Return the standard deviations (k,) of white noise on a smooth signal (N, k).

    White noise of variance s^2 has second differences of variance 6 s^2; their median is not
    moved by outliers or steps (the median of the absolute value is 0.6745 of the deviation).
    """
    slopes = space.subtract(values[1:], values[:-1])
    bends = np.abs(np.diff(slopes, axis=0))
    deviations: Array = np.median(bends, axis=0) / 0.6745 / np.sqrt(6.0)
    return np.array([float(f'{value:.3g}') for value in deviations])
