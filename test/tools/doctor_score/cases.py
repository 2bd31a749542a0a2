# SPDX-License-Identifier: Apache-2.0
"""Faults that are injected to score the diagnosis, and the findings that name them rightly."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
from scipy.signal import lfilter

from kalman_ros.core import Array, rotations

from .recordings import Injection, stamps_of, values_of

#: The scenarios, from linear to GNSS and IMU.
SCENARIOS = ('mass_spring_damper_2d', 'cart_pole', 'diff_drive', 'gnss_imu')
_MASS, _POLE, _DRIVE, _GNSS = SCENARIOS
#: Another scenario, for faults of sensors with three axes.
_SPACE = 'robot_3d'
#: Sensor of each scenario for the faults that can affect any sensor.
_SENSOR = {_MASS: 'position', _POLE: 'joint_states', _DRIVE: 'imu', _GNSS: 'imu'}


@dataclass(frozen=True)
class Case:
    """One fault in one scenario.

    Parameters
    ----------
    fault
        Kind of the fault, as in the table of the page.
    scenario, injection
        Scenario, and how the fault is injected into it.
    kinds
        Kinds of finding that name the fault rightly.
    subject
        Beginning of the subject of such a finding.
    """

    fault: str
    scenario: str
    injection: Injection
    kinds: tuple[str, ...]
    subject: str = ''


def cases() -> list[Case]:
    """Return all cases."""
    in_space = Case('rotation', _SPACE, _askew('odometry', 20.0), ('rotated',), 'odometry')
    return [*_links(), *_bodies(), *_edits(), *_noises(), *_models(), in_space]


def _links() -> list[Case]:
    """Return the cases of the injector of sensor faults."""
    faults = []
    offsets: dict[str, dict[str, tuple[str, Any]]] = {
        'bias': {
            _MASS: ('position', [0.3, 0.3]), _POLE: ('joint_states', [0.0, 0.03]),
            _DRIVE: ('imu', [0.1]), _GNSS: ('gnss', [4.0, 4.0]),
        },
        'drift': {
            _MASS: ('position', [0.03, 0.03]), _POLE: ('joint_states', [0.0, 0.002]),
            _DRIVE: ('imu', [0.005]), _GNSS: ('imu', [0.02, 0.002]),
        },
        'random_walk': {
            _MASS: ('position', [0.2, 0.2]), _POLE: ('joint_states', [0.0, 0.02]),
            _DRIVE: ('imu', [0.1]), _GNSS: ('gnss', [1.0, 1.0]),
        },
    }  # fmt: skip
    for fault, where in offsets.items():
        for scenario, (sensor, size) in where.items():
            options = {fault: size}
            if fault == 'bias' and scenario == _GNSS:
                options['fault_window'] = [10.0, 1e9]
            right = fault.replace('_', ' ')
            faults.append(Case(fault, scenario, Injection({sensor: options}), (right,), sensor))
    others: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
        'outliers': ({'outliers': 0.03}, ('outliers',)),
        'freeze': ({'freeze': True, 'fault_window': [10.0, 14.0]}, ('frozen',)),
        'nan': ({'nan': 0.05}, ('not a number',)),
        'dropout': ({'dropout': 0.2}, ('losses',)),
        'burst_loss': ({'burst_loss': 0.02, 'burst_length': 10.0}, ('losses in bursts',)),
        'delay': ({'delay': 0.1}, ('delay',)),
        'jitter': ({'jitter': 0.1}, ('jitter',)),
        'reordering': ({'reordering': 0.05}, ('stamps backward',)),
        'duplication': ({'duplication': 0.05}, ('stamps duplicated',)),
    }
    for fault, (options, kinds) in others.items():
        for scenario in SCENARIOS:
            sensor = _SENSOR[scenario]
            faults.append(Case(fault, scenario, Injection({sensor: options}), kinds, sensor))
    return faults


def _bodies() -> list[Case]:
    """Return the cases of the injector of faults where the input acts."""
    faults = []
    sizes: dict[str, tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]] = {
        'actuator_loss': ({}, {'actuator_loss': 0.4}, ('input delay',)),
        'actuator_dead_zone': (
            {'actuator_dead_zone': [0.8]}, {'actuator_dead_zone': [0.15]}, ('dead zone',)
        ),
        'disturbance_constant': (
            {'disturbance_constant': [0.5]}, {'disturbance_constant': [0.5]}, ('disturbance',)
        ),
        'disturbance_sine': (
            {'disturbance_amplitude': [1.0], 'disturbance_frequency': 0.7},
            {'disturbance_amplitude': [1.0], 'disturbance_frequency': 0.7}, ('disturbance',)
        ),
        'disturbance_noise': (
            {'disturbance_noise': [1.0]}, {'disturbance_noise': [0.05]},
            ('process noise too small',)
        ),
    }  # fmt: skip
    for fault, (mass, pole, kinds) in sizes.items():
        subject = '' if fault == 'disturbance_noise' else 'f'
        if mass:  # on the mass, lost commands change less than the force noise
            faults.append(Case(fault, _MASS, Injection(body=mass), kinds, subject))
        faults.append(Case(fault, _POLE, Injection(body=pole), kinds, subject))
    for fault, factor in {'input_gain': 2.5, 'input_sign': -1.0}.items():
        right = fault.replace('_', ' ')
        for scenario in (_MASS, _POLE):
            faults.append(Case(fault, scenario, Injection(command=factor), (right,), 'f'))
    return faults


def _scaled(sensor: str, *factors: float) -> Injection:
    return Injection(edits={sensor: values_of(lambda y: y * np.array(factors))})


def _swapped(sensor: str) -> Injection:
    return Injection(edits={sensor: values_of(lambda y: y[:, ::-1])})


def _turned(sensor: str, degrees: float) -> Injection:
    c, s = cos(radians(degrees)), sin(radians(degrees))
    return Injection(edits={sensor: values_of(lambda y: y @ np.array([[c, s], [-s, c]]))})


def _askew(sensor: str, degrees: float) -> Injection:
    """Rotate readings of three axes by an angle about an oblique axis."""
    R = rotations.exp(radians(degrees) * np.array([2.0, 1.0, 2.0]) / 3.0)
    return Injection(edits={sensor: values_of(lambda y: y @ R.T)})


def _foreign(sensor: str, size: float) -> Injection:
    """Replace readings by unrelated slow noise of one second, with standard deviation ``size``."""

    def edit(y: Array) -> Array:
        rng, keep = np.random.default_rng(len(y)), 0.95
        noise = rng.normal(scale=size * (1.0 - keep**2) ** 0.5, size=y.shape)
        noise[0] = 0.0
        return np.asarray(lfilter([1.0], [1.0, -keep], noise, axis=0))

    return Injection(edits={sensor: values_of(edit)})


def _shifted(sensor: str, seconds: float) -> Injection:
    return Injection(edits={sensor: stamps_of(lambda stamp: stamp + seconds)})


def _edits() -> list[Case]:
    """Return the cases in which readings are changed between sensor and recorder."""
    degrees = 180.0 / pi
    swap = ('swapped', 'rotated')
    return [
        Case('unit', _MASS, _scaled('velocity', 3.6, 3.6), ('unit',), 'velocity'),
        Case('unit', _POLE, _scaled('joint_states', 1.0, degrees), ('unit',), 'joint_states.t'),
        Case('unit', _DRIVE, _scaled('imu', degrees), ('unit',), 'imu'),
        Case('unit', _GNSS, _scaled('imu', 1.0, degrees), ('unit',), 'imu.yaw_rate'),
        Case('sign', _MASS, _scaled('velocity', -1.0, 1.0), ('sign',), 'velocity'),
        Case('sign', _POLE, _scaled('joint_states', 1.0, -1.0), ('sign',), 'joint_states.theta'),
        Case('sign', _DRIVE, _scaled('imu', -1.0), ('sign',), 'imu'),
        Case('sign', _GNSS, _scaled('imu', 1.0, -1.0), ('sign',), 'imu.yaw_rate'),
        Case('swap', _MASS, _swapped('position'), swap, 'position'),
        Case('swap', _POLE, _swapped('joint_states'), swap, 'joint_states'),
        Case('swap', _DRIVE, _swapped('odometry'), swap, 'odometry'),
        Case('swap', _GNSS, _swapped('gnss'), swap, 'gnss'),
        Case('unrelated', _MASS, _foreign('position', 0.5), ('unrelated',), 'position'),
        Case('unrelated', _DRIVE, _foreign('imu', 0.3), ('unrelated',), 'imu'),
        Case('rotation', _MASS, _turned('position', 30.0), ('rotated',), 'position'),
        Case('rotation', _MASS, _turned('velocity', 90.0), ('rotated',), 'velocity'),
        Case('clock_offset', _MASS, _shifted('velocity', 0.2), ('clock offset',), 'velocity'),
        Case('clock_offset', _POLE, _shifted('joint_states', 0.1), ('clock offset',), 'joint'),
        Case('clock_offset', _DRIVE, _shifted('imu', 3.0), ('clock offset',), 'imu'),
        Case('clock_offset', _GNSS, _shifted('imu', -0.5), ('clock offset',), 'imu'),
    ]


def _noises() -> list[Case]:
    """Return the cases in which the noise of readings or of the process is not as declared."""
    sensors: dict[str, tuple[str, list[float]]] = {
        _MASS: ('position', [0.05, 0.05]), _POLE: ('joint_states', [0.005, 0.01]),
        _DRIVE: ('imu', [0.02]), _GNSS: ('gnss', [0.5, 0.5]),
    }  # fmt: skip
    processes = {
        _MASS: ('force_noise', 0.1), _POLE: ('force_noise', 0.001),
        _DRIVE: ('turn_noise', 0.02), _GNSS: ('acceleration_noise', 0.5),
    }  # fmt: skip
    faults = []
    for factor, way in ((4.0, 'small'), (0.25, 'large')):
        for scenario, (sensor, noise) in sensors.items():
            plant: dict[str, Any] = {f'{sensor}.noise': [factor * value for value in noise]}
            kinds = (f'noise too {way}',)
            faults.append(
                Case(f'noise_too_{way}', scenario, Injection(plant=plant), kinds, sensor)
            )
        for scenario, (name, density) in processes.items():
            plant = {f'model_parameters.{name}': factor**2 * density}
            kinds = (f'process noise too {way}',)
            faults.append(
                Case(f'process_noise_too_{way}', scenario, Injection(plant=plant), kinds)
            )
    return faults


def _models() -> list[Case]:
    """Return the cases with a wrong parameter of the plant or a wrong initial belief."""
    sure: dict[str, list[float]] = {
        _MASS: [0.05] * 4, _POLE: [0.01] * 4, _DRIVE: [0.01, 0.01, 0.02, 0.01, 0.5],
        _GNSS: [1.0, 1.0, 0.2, 0.05, 0.2, 1.0, 0.02, 0.2],
    }  # fmt: skip
    faults = [
        Case('parameter', _MASS, Injection(plant={'model_parameters.stiffness_x': 5.0}),
             ('parameter', 'input gain')),
        Case('parameter', _POLE, Injection(plant={'model_parameters.length': 0.36}),
             ('parameter',)),
    ]  # fmt: skip
    for scenario, std in sure.items():
        narrow = Injection(estimator={'initial_std': std})
        faults.append(Case('first_belief', scenario, narrow, ('initial belief too narrow',)))
    return faults


#: Pairs of faults by name, with their scenario.
_PAIRS = (
    (_MASS, 'outliers', 'clock_offset'), (_MASS, 'unit', 'dropout'),
    (_MASS, 'noise_too_small', 'sign'), (_MASS, 'disturbance_sine', 'duplication'),
    (_MASS, 'swap', 'outliers'), (_POLE, 'outliers', 'delay'), (_POLE, 'bias', 'nan'),
    (_DRIVE, 'bias', 'outliers'), (_DRIVE, 'unit', 'process_noise_too_small'),
    (_DRIVE, 'sign', 'jitter'), (_GNSS, 'outliers', 'noise_too_small'),
    (_GNSS, 'unit', 'dropout'), (_GNSS, 'bias', 'outliers'),
)  # fmt: skip


def pairs() -> list[tuple[Case, Case]]:
    """Return cases with two faults at once."""
    known = {(case.scenario, case.fault): case for case in cases()}
    return [(known[scenario, one], known[scenario, two]) for scenario, one, two in _PAIRS]
