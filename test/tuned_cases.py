# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings whose parameters are known: systems, their inputs, what is fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from typing import Any

import numpy as np

from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.analysis.tuning.observations import Observations, Readings, Stamps
from kalman_ros.analysis.tuning.walk import Conditions
from kalman_ros.core import Array
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import build
from kalman_ros.simulation.batch_plant import BatchPlant
from kalman_ros.simulation.noise import stream

#: An input (m,) at a time in seconds.
Command = Callable[[float], Array]


@dataclass(frozen=True)
class Case:
    """A system, and a fit that begins with wrong values.

    Parameters
    ----------
    name
        In tables.
    values
        The true parameters, as in a parameter file.
    starts
        Those from which the fit begins, where they differ.
    fitted
        The parameters to fit.
    seconds
        The length of a recording.
    command
        The input; None for a model without one.
    errors
        The true biases and delays of sensors, by the name of the parameter.
    hidden
        Of ``fitted``, those that the recording cannot determine.
    """

    name: str
    values: Mapping[str, Any]
    starts: Mapping[str, Any]
    fitted: Sequence[str]
    seconds: float
    command: Command | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    hidden: Sequence[str] = ()


@dataclass(frozen=True)
class Recording:
    """Times (N,) and readings (N, k) by sensor, and inputs (M, m) where they change."""

    times: dict[str, Array]
    readings: dict[str, Array]
    input_times: Array | None
    inputs: Array | None


def recorded(case: Case, seed: int) -> Recording:
    """Return a recording of a case; it begins with a state at random from the first belief."""
    scenario = build({**case.values}, with_law=False)
    n, steps = scenario.model.state.size, round(case.seconds * scenario.rate) + 1
    x, P = scenario.initial_belief
    x = x + np.sqrt(P.diagonal()) * stream(seed, 'start').standard_normal(n)
    plant = BatchPlant(scenario.model, scenario.timed, scenario.rate, x[np.newaxis], [seed], steps)
    times: dict[str, list[float]] = {name: [] for name in scenario.enabled}
    readings: dict[str, list[Array]] = {name: [] for name in scenario.enabled}
    changes: list[tuple[float, Array]] = []
    u = scenario.model.equilibrium.input
    for _ in range(steps):
        time = plant.time * 1e-9
        for name, y in plant.readings().items():
            times[name].append(time + case.errors.get(f'{name}.delay', 0.0))
            readings[name].append(y[0] + case.errors.get(f'{name}.bias', 0.0))
        if case.command is not None:
            u = case.command(time)
            if not changes or (u != changes[-1][1]).any():
                changes.append((time, u))
        plant.step(u)
    return Recording(
        {name: np.array(each) for name, each in times.items()},
        {name: np.array(each) for name, each in readings.items()},
        np.array([time for time, _ in changes]) if changes else None,
        np.array([u for _, u in changes]) if changes else None,
    )


def likelihood(case: Case, data: Recording) -> Likelihood:
    """Return the likelihood of the fitted parameters of a case, which begin at its starts."""
    named = NamedParameters({**case.values, **case.starts})
    readings = {
        name: Readings(_stamps(data.times[name]), data.readings[name]) for name in data.times
    }
    u = named.scenario.model.equilibrium.input
    inputs = np.empty((0, u.size)) if data.inputs is None else data.inputs
    acts = _stamps(np.empty(0) if data.input_times is None else data.input_times)
    policy = Policy(window=0.0, max_gap=0.0, restart_after=0)
    return Likelihood(
        named.choose(list(case.fitted)), named.candidate, Observations(readings, acts, inputs),
        Conditions(policy, u),
    )  # fmt: skip


def _stamps(times: Array) -> Stamps:
    return np.rint(times * 1e9).astype(np.int64)


def steps(size: float, period: float) -> Command:
    """Return an input that is +size and -size in turns, with edges that do not repeat."""

    def command(time: float) -> Array:
        phase = 2.0 * pi * time / period + 0.8 * np.sin(0.37 * time)
        return np.array([size if np.sin(phase) >= 0.0 else -size])

    return command


def _rest(time: float) -> Array:
    return np.zeros(1)


_SPRING = Case(
    'spring',
    {
        'model': 'mass_spring_damper', 'model_parameters.force_noise': 0.003, 'rate': 100.0,
        'sensors': ['position'], 'position.rate': 10.0, 'position.noise': [0.005],
        'initial_estimate': [0.0, 0.0], 'initial_std': [0.1, 0.1],
    },
    {
        'model_parameters.mass': 1.3, 'model_parameters.damping': 0.5,
        'model_parameters.stiffness': 2.5, 'model_parameters.force_noise': 0.006,
        'position.noise': [0.008],
    },
    ['mass', 'damping', 'stiffness', 'force_noise', 'position.noise', 'position.delay'],
    16.0, steps(3.0, 3.0), {'position.delay': 0.012},
)  # fmt: skip

_CART_POLE = Case(
    'cart-pole',
    {
        'model': 'cart_pole', 'rate': 100.0, 'joint_states.rate': 50.0,
        'initial_estimate': [0.0, 0.0, 3.0, 0.0], 'initial_std': [0.01, 0.02, 0.05, 0.05],
    },
    {
        'model_parameters.friction': 0.2, 'model_parameters.pole_mass': 0.25,
        'model_parameters.length': 0.27, 'model_parameters.force_noise': 0.002,
        'joint_states.noise': [0.008, 0.015],
    },
    ['friction', 'pole_mass', 'length', 'force_noise', 'joint_states.noise'],
    8.0, steps(2.0, 1.7),
)  # fmt: skip

_ROBOT = Case(
    'planar robot',
    {
        'model': 'diff_drive', 'model_parameters.acceleration_noise': 0.2,
        'model_parameters.turn_noise': 0.2, 'rate': 100.0,
        'sensors': ['position', 'odometry', 'imu'],
        'odometry.rate': 25.0, 'odometry.noise': [0.1, 0.1], 'imu.rate': 25.0, 'imu.noise': [0.1],
        'position.kind': 'states',
        'position.measures': ['x', 'y'], 'position.noise': [0.05, 0.05], 'position.rate': 2.5,
        'position.type': 'geometry_msgs/PoseWithCovarianceStamped',
        'position.fields': ['pose.pose.position.x', 'pose.pose.position.y'],
        'initial_estimate': [0.0, 0.0, 1.0, 0.0, 0.2],
        'initial_std': [0.05, 0.05, 0.2, 0.1, 0.2],
    },
    {
        'model_parameters.acceleration_noise': 0.4, 'model_parameters.turn_noise': 0.1,
        'odometry.noise': [0.2, 0.2], 'imu.noise': [0.2], 'position.noise': [0.1, 0.1],
    },
    ['acceleration_noise', 'turn_noise', 'odometry.noise', 'imu.noise', 'position.noise',
     'imu.bias', 'position.delay'],
    16.0, None, {'imu.bias': 0.05, 'position.delay': 0.06},
)  # fmt: skip

_MINUTE = replace(
    _SPRING, name='spring, one minute', fitted=['mass', 'damping', 'stiffness'], seconds=60.0,
    starts={name: _SPRING.starts[name] for name in _SPRING.starts if 'noise' not in name},
    errors={},
)  # fmt: skip

_MOTOR = Case(
    'motor, one minute',
    {
        'model': 'dc_motor', 'rate': 100.0, 'encoder.rate': 50.0, 'encoder.noise': [0.001],
        'initial_estimate': [0.0, 0.0, 0.0], 'initial_std': [0.01, 0.01, 0.01],
    },
    {'model_parameters.constant': 0.02, 'model_parameters.friction': 0.05},
    ['constant', 'friction'], 60.0, steps(6.0, 3.0),
)  # fmt: skip

#: Whose intervals are counted.
COVERED = (_SPRING, _CART_POLE, _ROBOT)
#: Whose values are compared with the truth after a minute.
IDENTIFIED = (_MINUTE, _MOTOR)
#: With parameters that nothing can determine.
HIDDEN = (
    replace(
        _SPRING, name='spring at rest', command=_rest, errors={},
        fitted=['mass', 'damping', 'stiffness', 'force_noise', 'position.noise'],
        hidden=[f'model_parameters.{each}'
                for each in ('mass', 'damping', 'stiffness', 'force_noise')],
    ),
    replace(
        _CART_POLE, name='cart-pole, all masses', seconds=4.0,
        values={**_CART_POLE.values, 'initial_std': [0.01, 0.01, 0.05, 0.05]},
        starts={'model_parameters.friction': 0.2},
        fitted=['cart_mass', 'pole_mass', 'length', 'inertia', 'friction'],
        hidden=[f'model_parameters.{each}'
                for each in ('cart_mass', 'pole_mass', 'length', 'inertia')],
    ),
    replace(
        _ROBOT, name='robot, two biases', errors={},
        values={**_ROBOT.values, 'sensors': ['odometry', 'imu'],
                'initial_std': [0.05, 0.05, 0.2, 0.1, 5.0]}, starts={},
        fitted=['odometry.bias.omega', 'imu.bias', 'imu.noise'],
        hidden=['odometry.bias.omega', 'imu.bias'],
    ),
)  # fmt: skip
