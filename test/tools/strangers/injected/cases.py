# SPDX-License-Identifier: Apache-2.0
"""The recordings of shipped scenarios, with the fault that is injected into each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
from scipy.signal import lfilter

from kalman_ros.core import Array, rotations

from ..recordings import Recording
from .recordings import Injection, stamps_of, values_of

#: The scenarios, from linear to GNSS and IMU.
SCENARIOS = ('mass_spring_damper_2d', 'cart_pole', 'diff_drive', 'gnss_imu')
_MASS, _POLE, _DRIVE, _GNSS = SCENARIOS
#: Another scenario, for faults of sensors with three axes.
_SPACE = 'robot_3d'
#: Sensor of each scenario for the faults that can affect any sensor.
_SENSOR = {_MASS: 'position', _POLE: 'joint_states', _DRIVE: 'imu', _GNSS: 'imu'}
#: Number of recordings without a fault.
_CLEAN = 100


@dataclass(frozen=True)
class InjectedRecording(Recording):
    """A recording of a shipped scenario; ``label`` is the fault of the injector.

    Parameters
    ----------
    injection
        How the fault is injected.
    """

    injection: Injection = field(default_factory=Injection)


def _case(
    scenario: str, fault: str, injection: Injection, kind: str, subject: str,
    size: float = 0.0, unit: str = '', alike: str = '', **others: Any,
) -> InjectedRecording:  # fmt: skip
    return InjectedRecording(
        scenario, fault, 0, kind, subject, size, unit, alike=alike, injection=injection, **others
    )


def _seeded(table: Sequence[InjectedRecording]) -> tuple[InjectedRecording, ...]:
    return tuple(replace(case, seed=seed) for seed, case in enumerate(table, 1))


def _all() -> Sequence[InjectedRecording]:
    """Return all recordings: with one fault, with two, and without."""
    in_space = _case(
        _SPACE, 'rotation', _askew('odometry', 20.0), 'mounting', 'odometry', 20.0, 'deg'
    )
    single = [*_links(), *_bodies(), *_edits(), *_noises(), *_models(), in_space]
    return [*single, *_pairs(single), *_clean()]


def _links() -> list[InjectedRecording]:
    """Return the recordings with faults of the injector of sensor faults."""
    cases = []
    offsets: dict[str, dict[str, tuple[str, list[float]]]] = {
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
            options: dict[str, Any] = {fault: size}
            if fault == 'bias' and scenario == _GNSS:
                options['fault_window'] = [10.0, 1e9]
            kind = fault.replace('_', ' ')
            cases.append(_case(scenario, fault, Injection({sensor: options}), kind, sensor))
    others: dict[str, tuple[dict[str, Any], str]] = {
        'outliers': ({'outliers': 0.03}, 'outliers'),
        'freeze': ({'freeze': True, 'fault_window': [10.0, 14.0]}, 'frozen'),
        'nan': ({'nan': 0.05}, 'not a number'),
        'dropout': ({'dropout': 0.2}, 'losses'),
        'burst_loss': ({'burst_loss': 0.02, 'burst_length': 10.0}, 'losses in bursts'),
        'jitter': ({'jitter': 0.1}, 'jitter'),
        'reordering': ({'reordering': 0.05}, 'stamps backward'),
        'duplication': ({'duplication': 0.05}, 'stamps duplicated'),
        'delay': ({'delay': 0.1}, 'delay'),
    }
    for fault, (options, kind) in others.items():
        # stamps are true, and the window of the estimator is longer
        alike = 'clean' if fault in ('delay', 'jitter') else ''
        for scenario, sensor in _SENSOR.items():
            wrong = Injection({sensor: options})
            cases.append(_case(scenario, fault, wrong, kind, sensor, alike=alike))
    return cases


def _bodies() -> list[InjectedRecording]:
    """Return the recordings with faults of the injector of faults where the input acts."""
    cases = []
    sizes: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
        'actuator_loss': ({}, {'actuator_loss': 0.4}, 'input delay'),
        'actuator_dead_zone': (
            {'actuator_dead_zone': [0.8]}, {'actuator_dead_zone': [0.15]}, 'dead zone'
        ),
        'disturbance_constant': (
            {'disturbance_constant': [0.5]}, {'disturbance_constant': [0.5]}, 'bias'
        ),
        'disturbance_sine': (
            {'disturbance_amplitude': [1.0], 'disturbance_frequency': 0.7},
            {'disturbance_amplitude': [1.0], 'disturbance_frequency': 0.7}, 'bias'
        ),
        'disturbance_noise': (
            {'disturbance_noise': [1.0]}, {'disturbance_noise': [0.05]}, 'process noise'
        ),
    }  # fmt: skip
    for fault, (mass, pole, kind) in sizes.items():
        wrong = ('force_noise', 10.0) if fault == 'disturbance_noise' else ('input', 0.0)
        if mass:  # on the mass, lost commands change less than the force noise
            cases.append(_case(_MASS, fault, Injection(body=mass), kind, *wrong))
        cases.append(_case(_POLE, fault, Injection(body=pole), kind, *wrong))
    for fault, kind, factor in (('input_gain', 'scale', 2.5), ('input_sign', 'sign', -1.0)):
        for scenario in (_MASS, _POLE):
            cases.append(_case(scenario, fault, Injection(command=factor), kind, 'input', factor))
    return cases


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


def _edits() -> list[InjectedRecording]:
    """Return the recordings with readings that are changed between sensor and recorder."""
    degrees = 180.0 / pi
    cases = [
        _case(_MASS, 'unit', _scaled('velocity', 3.6, 3.6), 'units', 'velocity', 3.6, 'km/h'),
        _case(_DRIVE, 'unit', _scaled('imu', degrees), 'units', 'imu', degrees, 'deg/s'),
        _case(_MASS, 'sign', _scaled('velocity', -1.0, 1.0), 'sign', 'velocity', -1.0),
        _case(_POLE, 'sign', _scaled('joint_states', 1.0, -1.0), 'sign', 'joint_states theta', -1),
        _case(_DRIVE, 'sign', _scaled('imu', -1.0), 'sign', 'imu', -1.0),
        _case(_GNSS, 'sign', _scaled('imu', 1.0, -1.0), 'sign', 'imu yaw_rate', -1.0),
        _case(_MASS, 'unrelated', _foreign('position', 0.5), 'unrelated', 'position'),
        _case(_DRIVE, 'unrelated', _foreign('imu', 0.3), 'unrelated', 'imu'),
        _case(_MASS, 'rotation', _turned('position', 30.0), 'mounting', 'position', 30.0, 'deg'),
        _case(_MASS, 'quarter_turn', _turned('velocity', 90.0), 'mounting', 'velocity', 90.0,
              'deg'),
    ]  # fmt: skip
    for scenario, coordinate in ((_POLE, 'joint_states theta'), (_GNSS, 'imu yaw_rate')):
        wrong = _scaled(coordinate.split()[0], 1.0, degrees)
        cases.append(_case(scenario, 'unit', wrong, 'units', coordinate, degrees, 'deg'))
    sensors = {_MASS: 'position', _POLE: 'joint_states', _DRIVE: 'odometry', _GNSS: 'gnss'}
    cases += [_case(name, 'swap', _swapped(of), 'axes', of) for name, of in sensors.items()]
    shifts = {
        _MASS: ('velocity', 0.2), _POLE: ('joint_states', 0.1), _DRIVE: ('imu', 3.0),
        _GNSS: ('imu', -0.5),
    }  # fmt: skip
    for scenario, (sensor, shift) in shifts.items():
        wrong = _shifted(sensor, shift)
        cases.append(_case(scenario, 'clock_offset', wrong, 'clock offset', sensor, shift, 's'))
    return cases


def _noises() -> list[InjectedRecording]:
    """Return the recordings with another noise of readings or of the process than declared."""
    sensors: dict[str, tuple[str, list[float]]] = {
        _MASS: ('position', [0.05, 0.05]), _POLE: ('joint_states', [0.005, 0.01]),
        _DRIVE: ('imu', [0.02]), _GNSS: ('gnss', [0.5, 0.5]),
    }  # fmt: skip
    processes = {
        _MASS: ('force_noise', 0.1), _POLE: ('force_noise', 0.001),
        _DRIVE: ('turn_noise', 0.02), _GNSS: ('acceleration_noise', 0.5),
    }  # fmt: skip
    cases = []
    for factor, way in ((4.0, 'small'), (0.25, 'large')):
        for scenario, (sensor, noise) in sensors.items():
            plant: dict[str, Any] = {f'{sensor}.noise': [factor * value for value in noise]}
            fault, wrong = f'noise_too_{way}', Injection(plant=plant)
            cases.append(_case(scenario, fault, wrong, 'noise', sensor, factor))
        for scenario, (name, density) in processes.items():
            plant = {f'model_parameters.{name}': factor**2 * density}
            fault, wrong = f'process_noise_too_{way}', Injection(plant=plant)
            cases.append(_case(scenario, fault, wrong, 'process noise', name, factor**2))
    return cases


def _models() -> list[InjectedRecording]:
    """Return the recordings with a wrong parameter of the plant, or a wrong initial belief."""
    stiff = Injection(plant={'model_parameters.stiffness_x': 5.0})
    long = Injection(plant={'model_parameters.length': 0.36})
    beliefs = {
        _MASS: ('[1.0, 1.0, 1.0, 1.0]', '[0.05, 0.05, 0.05, 0.05]'),
        _POLE: ('[0.1, 0.1, 0.3, 0.1]', '[0.01, 0.01, 0.01, 0.01]'),
        _DRIVE: ('[0.01, 0.01, 0.5, 0.01, 0.5]', '[0.01, 0.01, 0.02, 0.01, 0.5]'),
        _GNSS: ('[1.0, 1.0, 0.2, 2.0, 0.2, 1.0', '[1.0, 1.0, 0.2, 0.05, 0.2, 1.0'),
    }
    narrow = [
        _case(name, 'first_belief', Injection(), 'initial state', 'initial_std',
              edits={f'initial_std: {wide}': f'initial_std: {sure}'})
        for name, (wide, sure) in beliefs.items()
    ]  # fmt: skip
    return [
        _case(_MASS, 'parameter', stiff, 'parameter', 'stiffness_x', 5.0, 'N/m',
              'scale of input'),
        _case(_POLE, 'parameter', long, 'parameter', 'length', 0.36, 'm'),
        *narrow,
    ]  # fmt: skip


#: Pairs of faults by name, with their scenario.
_PAIRS = (
    (_MASS, 'outliers', 'clock_offset'), (_MASS, 'unit', 'dropout'),
    (_MASS, 'noise_too_small', 'sign'), (_MASS, 'disturbance_sine', 'duplication'),
    (_MASS, 'swap', 'outliers'), (_POLE, 'outliers', 'reordering'), (_POLE, 'bias', 'nan'),
    (_DRIVE, 'bias', 'outliers'), (_DRIVE, 'unit', 'process_noise_too_small'),
    (_DRIVE, 'sign', 'jitter'), (_GNSS, 'outliers', 'noise_too_small'),
    (_GNSS, 'unit', 'dropout'), (_GNSS, 'bias', 'outliers'),
)  # fmt: skip


def _pairs(single: Sequence[InjectedRecording]) -> list[InjectedRecording]:
    """Return recordings with two faults: one that is looked for, and one that it has as well."""
    known = {(case.system, case.label): case for case in single}
    return [
        replace(
            known[scenario, one],
            label=f'{one}_beside_{other}',
            own=f'{known[scenario, other].kind} of {known[scenario, other].subject}',
            injection=known[scenario, one].injection + known[scenario, other].injection,
        )
        for scenario, *both in _PAIRS
        for one, other in (both, both[::-1])
    ]


def _clean() -> list[InjectedRecording]:
    """Return recordings without a fault."""
    return [
        InjectedRecording(SCENARIOS[number % len(SCENARIOS)], f'clean_{number:02d}', 0)
        for number in range(_CLEAN)
    ]


#: All recordings; a seed is the place.
TABLE = _seeded(_all())
