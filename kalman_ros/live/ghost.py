# SPDX-License-Identifier: Apache-2.0
"""Ghost of a live page: a second estimator on the readings of the loop, for comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import attrgetter

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.pipeline.settings import Settings


class Ghost:
    """An `OnlineEstimator` in the process of the page, on the samples that the page receives.

    Its settings stay as they are, so it goes on with the values from before a later change.

    Parameters
    ----------
    settings
        Settings of an estimator, with the covariances of readings from the configuration.

    Raises
    ------
    ValueError
        If the filter cannot serve the scenario, or only a node can decode the readings.
    """

    def __init__(self, settings: Settings) -> None:
        self._scenario = settings.scenario
        for name, source in self._scenario.enabled.items():
            signal = source.signal
            if signal.pose != 'absolute' or signal.still or signal.zero or signal.stamp_offset:
                raise ValueError(f'ghost: only the node of the estimator reads {name}')
        #: Name of the filter.
        self.filter = self._scenario.filter
        estimation = settings.fusion(wait=False)
        self._online = estimation.online(settings.idle())
        self._start = -1

    def start(self, time: int, belief: Gaussian, input: Array) -> None:
        """Start from a belief that holds at a time in nanoseconds, with the input from then on.

        A scenario with the biases of its sensors as states starts from its initial belief, since
        a belief of the page has the states of the model alone.
        """
        if not self._scenario.believed.places:
            self._online.reset(belief)
        self._online.add_input(time, input)
        self._start = time

    def reset(self) -> None:
        """Start from the initial belief at the next stamp."""
        self._online.reset(self._scenario.believed.initial)
        self._start = -1

    def fuse(self, samples: Mapping[str, Sequence[Sample]]) -> list[tuple[int, Gaussian]]:
        """Fuse the new samples by topic; return the time and the belief at each reading."""
        arrivals = [
            Arrival(name, sample.time, sample.values, source.used(sample.covariance))
            for name, source in self._scenario.enabled.items()
            for sample in samples.get(source.signal.topic, ())
            if sample.time is not None and sample.time > self._start
        ]
        if self._scenario.input.fields:
            arrivals += [
                Arrival(None, sample.time, sample.values)
                for sample in samples.get(self._scenario.input.topic, ())
                if sample.time is not None and sample.time >= self._start
            ]
        arrivals.sort(key=attrgetter('time'))
        beliefs = []
        for _, together in groupby(arrivals, key=attrgetter('time')):
            batch = list(together)
            self._online.add(batch)
            time = self._online.time
            if time is not None and any(arrival.source is not None for arrival in batch):
                beliefs.append((time, self._scenario.believed.own(self._online.belief)))
        return beliefs
