# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process: the computation of lockstep without topics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation, estimation

from .computed import computed
from .faults.links import Links
from .faults.plant_faults import PlantFaults
from .simulated_plant import SimulatedPlant
from .trajectory import Innovations, Series, Trajectory


@dataclass
class _Log:
    """Rows of one sensor: (time, reading), and (fused, innovation, deviation, nis)."""

    time: list[float] = field(default_factory=list)
    readings: list[Array] = field(default_factory=list)
    fused: list[float] = field(default_factory=list)
    innovations: list[Array] = field(default_factory=list)
    std: list[Array] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)


def run(
    scenario: Scenario,
    gain: Array | None,
    seconds: float,
    seed: int,
    *,
    filter: str = '',
    believed: Scenario | None = None,
    command: Callable[[float], Array] | None = None,
    arrives: Callable[[str, float], bool] = lambda name, time: True,
    answer: Callable[[int, Array], Array] | None = None,
    faults: PlantFaults | None = None,
    replaced: Callable[[Estimation], Estimation] | None = None,
) -> Trajectory:
    """Return the run of a scenario's plant under u = u_0 - K (x_hat - x_0).

    Parameters
    ----------
    scenario
        System of the plant.
    gain
        K (m, n); None for an open loop.
    seconds
        Duration; the step at this time is the last.
    seed
        Seed of all noise.
    filter
        Name of the filter; if empty, the scenario's default.
    believed
        System of the estimator, if different.
    command
        Function that returns u_0 (m,) at a time in seconds; the equilibrium input by default.
    arrives
        Function that returns whether a reading of a sensor at a time reaches the estimator.
    answer
        Function that returns, instead of u_0 and K, the input (m,) for a time in nanoseconds and
        a state (n,).
    faults
        Faults of the plant.
    replaced
        Function that puts another filter in the place of one, such as the exported C.
    """
    real = scenario
    scenario = computed(real)
    believed = scenario if believed is None or believed is real else computed(believed)
    timed = {name: source.timed for name, source in scenario.sensors.items()}
    plant = SimulatedPlant(scenario.model, timed, scenario.rate, scenario.initial_state, seed)
    links = Links(seed)
    links.configure(timed, {} if faults is None else faults.sensors)
    if faults is not None:
        plant.adopt(faults)
    space, (x0, u0) = believed.model.state, believed.model.equilibrium
    K = np.zeros((u0.size, x0.size)) if gain is None else gain
    in_order = Policy(max_gap=0.0)
    setup = estimation(believed, in_order, filter=filter, biases=False)
    estimator = (setup if replaced is None else replaced(setup)).online(u0)
    logs = {name: _Log() for name in believed.sensors}
    rows = []
    for step in range(round(seconds * scenario.rate) + 1):
        time = round(step * plant.dt * 1e9)
        for name, stamp, y in links(time, time, plant.readings()):
            if not arrives(name, stamp * 1e-9):
                continue
            _, correction = estimator.add_reading(name, stamp, y)
            log = logs[name]
            log.time.append(stamp * 1e-9)
            log.readings.append(y)
            if correction is not None:
                log.fused.append(stamp * 1e-9)
                log.innovations.append(correction.innovation)
                log.std.append(np.sqrt(correction.innovation_covariance.diagonal()))
                log.nis.append(correction.nis)
        belief = estimator.predicted(time)
        if answer is None:
            start = u0 if command is None else command(time * 1e-9)
            u = start - K @ space.subtract(belief.mean, x0)
        else:
            u = answer(time, belief.mean)
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
                np.array(log.fused),
                np.array(log.innovations),
                np.array(log.std),
                np.array(log.nis),
            )
            for name, log in logs.items()
        },
    )
