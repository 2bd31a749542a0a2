# SPDX-License-Identifier: Apache-2.0
"""The topics of a run, and their conversion to a trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Innovations, Series, Trajectory

from .recorder import Recorder


def signals(scenario: Scenario) -> dict[str, Signal]:
    """Return the signals of the plant, the estimator and the controller, by topic."""
    state = scenario.state
    whole = covariance_signal(state)
    found = {'ground_truth': state, state.topic: state, whole.topic: whole}
    if scenario.input.fields:
        found[scenario.input.topic] = scenario.input
    for name, source in scenario.enabled.items():
        innovation = innovation_signal(state, name, source.sensor.output)
        found[source.signal.topic] = source.signal
        found[innovation.topic] = innovation
    return found


def to_trajectory(scenario: Scenario, recorder: Recorder, first: int) -> Trajectory:
    """Return a record joined by stamps, with time counted from ``first``."""
    estimate, n = scenario.state.topic, scenario.model.state.size
    truth, state = recorder['ground_truth'], recorder[estimate]
    # a model without inputs has none
    force = recorder[scenario.input.topic if scenario.input.fields else estimate]
    m = len(scenario.input.fields)
    covariance = recorder[f'{estimate}/covariance'].values.reshape(-1, n, n)
    # the covariance has no stamp: the k-th belongs to the k-th estimate
    length = min(len(state.stamp), len(covariance))
    stamps = np.intersect1d(truth.stamp, state.stamp[:length])
    # so does the k-th input, if it has no stamp
    answered = force.stamp if len(force.stamp) else state.stamp[: len(force.values)]
    stamps = np.intersect1d(stamps, answered)
    believed = _last_at(state.stamp[:length], stamps)
    innovations = {
        name: _innovations(_series(recorder[f'{estimate}/innovation/{name}'], first))
        for name in scenario.enabled
    }
    return Trajectory(
        time=(stamps - first) * 1e-9,
        truth=truth.values[_last_at(truth.stamp, stamps)],
        estimate=state.values[believed],
        covariance=covariance[believed],
        input=force.values[_last_at(answered, stamps), :m],
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
    """Return readings with their times; those without stamps have the times of innovations."""
    if len(series.time) == len(series.values):
        return series
    length = min(len(innovations.time), len(series.values))
    return Series(innovations.time[:length], series.values[:length])


def _innovations(series: Series) -> Innovations:
    k = series.values.shape[1] // 2
    columns: list[Array] = np.split(series.values, [k, 2 * k], axis=1)
    return Innovations(series.time, columns[0], columns[1], columns[2][:, 0])


def _last_at(stamps: Any, wanted: Any) -> Any:
    """Return the index of the last message with each wanted stamp; ``stamps`` do not decrease."""
    return np.searchsorted(stamps, wanted, side='right') - 1
