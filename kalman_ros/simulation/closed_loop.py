# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process: what lockstep does over topics, without the topics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.online import OnlineEstimator

from .plant import SimulatedPlant
from .scenario import Scenario
from .trajectory import Innovations, Series, Trajectory


@dataclass
class _Log:
    """Of one sensor: rows of (time, reading, innovation, deviation, nis)."""

    time: list[float] = field(default_factory=list)
    readings: list[Array] = field(default_factory=list)
    innovations: list[Array] = field(default_factory=list)
    std: list[Array] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)


def run(
    scenario: Scenario,
    gain: Array,
    seconds: float,
    seed: int,
    *,
    filter: str = 'kf',
    believed: Scenario | None = None,
) -> Trajectory:
    """Return what happens when u = -K x_hat drives the plant of a scenario.

    Parameters
    ----------
    scenario
        The system.
    gain
        K (m, n).
    seconds
        How long; the step at this time is the last.
    seed
        Of all noise.
    filter
        The name of the filter.
    believed
        The system that the estimator believes in, if it is another one.
    """
    believed = believed or scenario
    timed = {name: source.timed for name, source in scenario.sensors.items()}
    plant = SimulatedPlant(scenario.model, timed, scenario.rate, scenario.initial_state, seed)
    sensors = {name: source.sensor for name, source in believed.sensors.items()}
    estimator = OnlineEstimator(
        build_filter(filter, believed.plan),
        sensors,
        believed.initial_belief,
        np.zeros(scenario.model.input.size),
    )
    logs = {name: _Log() for name in sensors}
    rows = []
    for step in range(round(seconds * scenario.rate) + 1):
        time = round(step * plant.dt * 1e9)
        for name, y in plant.readings().items():
            _, correction = estimator.add_reading(name, time, y)
            log = logs[name]
            log.time.append(time * 1e-9)
            log.readings.append(y)
            if correction is not None:
                log.innovations.append(correction.innovation)
                log.std.append(np.sqrt(correction.innovation_covariance.diagonal()))
                log.nis.append(correction.nis)
        belief = estimator.predicted(time)
        u = -(gain @ belief.mean)
        rows.append((time * 1e-9, plant.state, belief.mean, belief.covariance, u))
        estimator.add_input(time, u)
        plant.step(u)
    time_, truth, estimate, covariance, input = (np.array(column) for column in zip(*rows))
    return Trajectory(
        time_,
        truth,
        estimate,
        covariance,
        input,
        readings={
            name: Series(np.array(log.time), np.array(log.readings)) for name, log in logs.items()
        },
        innovations={
            name: Innovations(
                np.array(log.time),
                np.array(log.innovations),
                np.array(log.std),
                np.array(log.nis),
            )
            for name, log in logs.items()
        },
    )
