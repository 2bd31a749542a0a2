# SPDX-License-Identifier: Apache-2.0
"""Topics of a run, and their conversion to a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.scenario import Scenario, SensorSource
from kalman_ros.simulation.trajectory import Innovations, Series, Trajectory

from .recorder import Recorder


def signals(
    scenario: Scenario, sensors: Mapping[str, SensorSource] | None = None
) -> dict[str, Signal]:
    """Return the signals of the plant, the estimator and the controller, by topic.

    The sensors are those that are enabled, unless they are given.
    """
    state = scenario.state
    covariance = covariance_signal(state)
    by_topic = {'ground_truth': state, state.topic: state, covariance.topic: covariance}
    if scenario.input.fields:
        by_topic[scenario.input.topic] = scenario.input
    for name, source in (scenario.enabled if sensors is None else sensors).items():
        innovation = innovation_signal(state, name, source.sensor.output)
        by_topic[source.signal.topic] = source.signal
        by_topic[innovation.topic] = innovation
    return by_topic


def to_trajectory(scenario: Scenario, recorder: Recorder, first: int) -> Trajectory:
    """Return a record as a trajectory, joined by stamps; times are relative to ``first``."""
    estimate, n = scenario.state.topic, scenario.model.state.size
    truth, state = recorder['ground_truth'], recorder[estimate]
    # a model without inputs has no topic for them, so the estimate takes its place
    input = recorder[scenario.input.topic if scenario.input.fields else estimate]
    m = len(scenario.input.fields)
    covariance = recorder[f'{estimate}/covariance'].values.reshape(-1, n, n)
    # the covariance has no stamp: the k-th belongs to the k-th estimate
    length = min(len(state.stamp), len(covariance))
    stamps = np.intersect1d(truth.stamp, state.stamp[:length])
    # an input without a stamp likewise belongs to the k-th estimate
    answered = input.stamp if len(input.stamp) else state.stamp[: len(input.values)]
    stamps = np.intersect1d(stamps, answered)
    rows = _last_at(state.stamp[:length], stamps)
    innovations = {
        name: _innovations(_series(recorder[f'{estimate}/innovation/{name}'], first))
        for name in scenario.enabled
    }
    return Trajectory(
        time=(stamps - first) * 1e-9,
        truth=truth.values[_last_at(truth.stamp, stamps)],
        estimate=state.values[rows],
        covariance=covariance[rows],
        input=input.values[_last_at(answered, stamps), :m],
        readings={
            name: _readings(_series(recorder[source.signal.topic], first), innovations[name])
            for name, source in scenario.enabled.items()
        },
        innovations=innovations,
    )


def _series(recorded: Any, first: int) -> Series:
    covariance = recorded.covariance
    if covariance is not None and len(covariance) != len(recorded.stamp):
        covariance = None
    return Series((recorded.stamp - first) * 1e-9, recorded.values, covariance)


def _readings(series: Series, innovations: Innovations) -> Series:
    """Return readings with times; readings without stamps have the times of the innovations."""
    if len(series.time) == len(series.values):
        return series
    length = min(len(innovations.time), len(series.values))
    return Series(innovations.time[:length], series.values[:length])


def _innovations(series: Series) -> Innovations:
    k = series.values.shape[1] // 2
    columns: list[Array] = np.split(series.values, [k, 2 * k], axis=1)
    return Innovations(series.time, columns[0], columns[1], columns[2][:, 0])


def _last_at(stamps: Any, requested: Any) -> Any:
    """Return the index of the last message with each stamp; ``stamps`` must not decrease."""
    return np.searchsorted(stamps, requested, side='right') - 1
