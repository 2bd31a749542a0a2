# SPDX-License-Identifier: Apache-2.0
"""The recordings, with what is wrong with each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, radians
from pathlib import Path

import numpy as np

from .faults import (
    Fault,
    all_noisy,
    batched,
    both,
    clean,
    coloured,
    correlated,
    displaced,
    disturbed,
    drifting,
    frozen,
    interrupted,
    late,
    lost,
    mounted,
    noisy,
    on,
    outlying,
    quantised,
    rounded,
    scaled,
    shifted,
    swapped,
    turned,
    uneven,
)
from .messages import Form, write_recording
from .systems import System

DEGREE = radians(1.0)
_TURN, _ACCELERATION = {'columns': slice(0, 3)}, {'columns': slice(3, 6)}


@dataclass(frozen=True)
class Recording:
    """A recording and its truth.

    Parameters
    ----------
    system, label, seed
        What is simulated; the rest of the name; and the seed of all noise.
    kind, subject
        A short word for the fault, and the sensor or the parameter that it concerns.
    size, unit
        Of a scale, what is read by what is true; of noise, what is true by what is declared; of a
        parameter, its true value; 0 if it is not one number.
    fault
        What is done to the readings.
    alike
        What the readings cannot tell from it, in words, or several such separated by '; ';
        'clean' if nothing shows it at all.
    own
        What a real recording has wrong by itself, in the words of ``alike``: findings of it may
        come before that of the fault.
    physics, edits
        True parameters that differ from those of the file; replacements in the file.
    """

    system: str
    label: str
    seed: int
    kind: str = 'clean'
    subject: str = ''
    size: float = 0.0
    unit: str = ''
    fault: Fault = clean
    alike: str = ''
    own: str = ''
    physics: Mapping[str, float] = field(default_factory=dict)
    edits: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name, unique among all."""
        return f'{self.system}_{self.label}'

    @property
    def truth(self) -> str:
        """What is wrong, in a line."""
        if self.kind == 'clean':
            return f'{self.kind} except {self.own}' if self.own else self.kind
        alike = f' (like {self.alike})' if self.alike else ''
        words = filter(None, (f'{self.size:.4g}' if self.size else '', self.unit))
        size = ' '.join(words)
        return f'{self.kind} of {self.subject}{size and ": "}{size}{alike}'


# fmt: off
R = Recording
TABLE = (
    R('rover', 'clean', 11),
    R('rover', 'clean_again', 12),
    R('car', 'clean', 13),
    R('car', 'clean_again', 14),
    R('boat', 'clean', 15),
    R('quadrotor', 'clean', 16),
    R('balloon', 'clean', 17),
    R('spring', 'clean', 18),
    R('pendulum', 'clean', 19),
    R('motor', 'clean', 20),
    R('elevator', 'clean', 21),
    R('tank', 'clean', 22),
    R('oven', 'clean', 23),

    R('rover', 'radius', 31, 'scale', 'wheels', 1 / 1.05, '', physics={'radius': 0.105}),
    R('rover', 'track', 32, 'scale', 'wheels omega', 1.1, '', physics={'track': 0.55}),
    R('rover', 'gyro_sign', 33, 'sign', 'gyro', -1, '', on('gyro', scaled, -1)),
    R('rover', 'gyro_degrees', 34, 'units', 'gyro', 1 / DEGREE, 'deg/rad',
      on('gyro', scaled, 1 / DEGREE, **_TURN)),
    R('rover', 'gyro_on_its_side', 35, 'mounting', 'gyro', 90, 'deg about x',
      on('gyro', mounted, 0, 90),
      alike='scale 0'),
    R('rover', 'gyro_bias', 36, 'bias', 'gyro', 0.05, 'rad/s', on('gyro', shifted, 0.05, **_TURN)),
    R('rover', 'gnss_delay', 37, 'delay', 'gnss', 0.2, 's', on('gnss', late, 0.2)),
    R('rover', 'gnss_swapped', 38, 'axes', 'gnss', 0, 'x and y swapped', on('gnss', swapped)),
    R('rover', 'gnss_multipath', 39, 'outliers', 'gnss', 7.2, 'm, clusters of 6 s',
      on('gnss', displaced, (25, 55, 90), 6, (6, -4))),
    R('rover', 'wheels_frozen', 40, 'frozen', 'wheels', 5, 's', on('wheels', frozen, 40, 5)),
    R('rover', 'gnss_bursts', 41, 'losses', 'gnss', 8, 's, thrice',
      on('gnss', interrupted, (20, 50, 85), 8)),
    R('rover', 'command_delay', 42, 'delay', 'input', 0.2, 's', on('input', late, 0.2),
      alike='parameter command_time'),
    R('rover', 'gyro_batched', 106, 'stamps', 'gyro', 20, 'messages within 2 ms',
      on('gyro', batched, 20, 1e-4)),
    R('rover', 'wheels_rounded', 43, 'stamps', 'wheels', 0.01, 's', on('wheels', rounded, 0.01)),

    R('car', 'imu_quarter_turn', 44, 'mounting', 'imu', 90, 'deg about z',
      on('imu', mounted, 2, 90)),
    R('car', 'imu_7_degrees', 45, 'mounting', 'imu', 7, 'deg about z', on('imu', mounted, 2, 7)),
    R('car', 'antenna', 46, 'lever arm', 'gnss', 1.5, 'm forward, declared -0.5',
      physics={'antenna_forward': 1.5}),
    R('car', 'wheels_3_percent', 47, 'scale', 'wheels', 1.03, '', on('wheels', scaled, 1.03)),
    R('car', 'gnss_50_ms', 48, 'delay', 'gnss', 0.05, 's', on('gnss', late, 0.05),
      alike='lever arm'),
    R('car', 'gnss_coloured', 49, 'coloured noise', 'gnss', 10, 's', on('gnss', coloured, 10)),
    R('car', 'gnss_outliers', 50, 'outliers', 'gnss', 10, 'm, 5 % of all',
      on('gnss', outlying, 0.05, 10)),
    R('car', 'imu_noise', 51, 'noise', 'imu', 3, '', on('imu', noisy, 3)),
    R('car', 'all_noise_third', 52, 'noise', 'all', 1 / 3, '', all_noisy(1 / 3)),
    R('car', 'imu_batched', 53, 'stamps', 'imu', 5, 'messages with one stamp',
      on('imu', batched, 5, 0),
      alike='losses'),
    R('car', 'imu_in_g', 54, 'units', 'imu acceleration', 1 / 9.80665, 'g by m/s^2',
      on('imu', scaled, 1 / 9.80665, **_ACCELERATION)),
    R('car', 'imu_lost', 55, 'losses', 'imu', 0.2, '', on('imu', lost, 0.2)),

    R('boat', 'compass_7_degrees', 56, 'mounting', 'compass', 7, 'deg about z',
      on('compass', shifted, 7 * DEGREE),
      alike='bias'),
    R('boat', 'compass_iron', 57, 'disturbed', 'compass', 0.6, 'rad for 10 s',
      on('compass', disturbed, 120, 10, 0.6)),
    R('boat', 'compass_ned', 58, 'axes', 'compass', 0, 'from north, clockwise',
      both(on('compass', scaled, -1), on('compass', shifted, pi / 2))),
    R('boat', 'compass_drift', 59, 'drift', 'compass', 0.0007, 'rad/s',
      on('compass', drifting, 0.0007)),
    R('boat', 'log_10_percent', 60, 'scale', 'log', 1.1, '', on('log', scaled, 1.1)),
    R('boat', 'current', 61, 'model', 'current', 0.5, 'm/s east', physics={'current': 0.5},
      alike='drift of gnss'),
    R('boat', 'gnss_noise', 62, 'noise', 'gnss', 3, '', on('gnss', noisy, 3)),

    R('quadrotor', 'no_drag', 63, 'parameter', 'drag', 0.3, '1/s, declared 0',
      edits={'drag: 0.3': 'drag: 0.0'}),
    R('quadrotor', 'mass', 64, 'parameter', 'mass', 1.2, 'kg, declared 1',
      physics={'mass': 1.2},
      alike='scale of input'),
    R('quadrotor', 'range_mm', 65, 'units', 'range', 1000, 'mm/m', on('range', scaled, 1000)),
    R('quadrotor', 'range_bias', 66, 'bias', 'range', 0.15, 'm', on('range', shifted, 0.15),
      alike='clean'),
    R('quadrotor', 'gyro_50_ms', 67, 'delay', 'gyro', 0.05, 's', on('gyro', late, 0.05)),
    R('quadrotor', 'range_outliers', 68, 'outliers', 'range', 1, 'm, 3 % of all',
      on('range', outlying, 0.03, 1)),

    R('balloon', 'correlated', 69, 'correlated noise', 'upper lower', 0.8, '',
      correlated('upper', 'lower', 0.8)),
    R('balloon', 'other_frame', 70, 'frame', 'lower', 90, 'deg for 30 s',
      on('lower', turned, 90, 60, 30)),
    R('balloon', 'lower_offset', 71, 'bias', 'lower', 3, 'm in x and y', on('lower', shifted, 3),
      alike='bias of upper'),
    R('balloon', 'upper_quiet', 72, 'noise', 'upper', 1 / 3, '', on('upper', noisy, 1 / 3)),
    R('balloon', 'lower_lost', 73, 'losses', 'lower', 0.2, '', on('lower', lost, 0.2)),
    R('balloon', 'upper_drift', 74, 'drift', 'upper', 0.02, 'm/s', on('upper', drifting, 0.02),
      alike='drift of lower'),

    R('spring', 'position_3_percent', 75, 'scale', 'position', 1.03, '',
      on('position', scaled, 1.03)),
    R('spring', 'accelerometer_scale', 76, 'scale', 'accelerometer', 1.1, '',
      on('accelerometer', scaled, 1.1)),
    R('spring', 'accelerometer_late', 77, 'delay', 'accelerometer', 0.05, 's',
      on('accelerometer', late, 0.05)),
    R('spring', 'accelerometer_tilt', 78, 'mounting', 'accelerometer', 7, 'deg about y',
      on('accelerometer', mounted, 1, 7),
      alike='bias'),
    R('spring', 'mass', 79, 'parameter', 'A, C', 2.4, 'kg, declared 2', physics={'mass': 2.4},
      alike='process noise'),

    R('pendulum', 'encoder_sign', 80, 'sign', 'encoder', -1, '', on('encoder', scaled, -1)),
    R('pendulum', 'encoder_zero', 81, 'bias', 'encoder', 0.1, 'rad', on('encoder', shifted, 0.1)),
    R('pendulum', 'gyro_frozen', 82, 'frozen', 'gyro', 5, 's', on('gyro', frozen, 30, 5)),
    R('pendulum', 'encoder_degrees', 83, 'units', 'encoder', 1 / DEGREE, 'deg/rad',
      on('encoder', scaled, 1 / DEGREE)),
    R('pendulum', 'encoder_rounded', 105, 'stamps', 'encoder', 0.01, 's',
      on('encoder', rounded, 0.01)),
    R('pendulum', 'length', 84, 'parameter', 'length', 0.55, 'm, declared 0.5',
      physics={'length': 0.55}),
    R('pendulum', 'no_damping', 85, 'parameter', 'damping', 0.4, '1/s, declared 0',
      edits={'damping: 0.4': 'damping: 0.0'}),

    R('motor', 'tachometer_rpm', 86, 'units', 'tachometer', 30 / pi, 'rpm by rad/s',
      on('tachometer', scaled, 30 / pi)),
    R('motor', 'tachometer_uneven', 87, 'asymmetry', 'tachometer', 1.1, 'forwards, 0.9 backwards',
      on('tachometer', uneven, 1.1, 0.9)),
    R('motor', 'encoder_coarse', 88, 'quantised', 'encoder', 0.2, 'rad',
      on('encoder', quantised, 0.2)),
    R('motor', 'tachometer_late', 89, 'delay', 'tachometer', 0.05, 's',
      on('tachometer', late, 0.05)),
    R('motor', 'all_noise_triple', 90, 'noise', 'all', 3, '', all_noisy(3)),

    R('elevator', 'barometer_drift', 91, 'drift', 'barometer', 0.3, 'Pa/s',
      on('barometer', drifting, 0.3),
      alike='clean'),
    R('elevator', 'barometer_hpa', 92, 'units', 'barometer', 0.01, 'hPa/Pa',
      on('barometer', scaled, 0.01)),
    R('elevator', 'gravity', 93, 'bias', 'accelerometer', 9.80665, 'm/s^2, not removed',
      on('accelerometer', shifted, 9.80665, **_ACCELERATION)),
    R('elevator', 'accelerometer_bias', 94, 'bias', 'accelerometer', 0.1, 'm/s^2',
      on('accelerometer', shifted, 0.1, **_ACCELERATION)),
    R('elevator', 'barometer_gust', 95, 'disturbed', 'barometer', 40, 'Pa for 8 s',
      on('barometer', disturbed, 50, 8, 40)),
    R('elevator', 'barometer_coloured', 96, 'coloured noise', 'barometer', 3, 's',
      on('barometer', coloured, 3)),

    R('tank', 'valve', 97, 'parameter', 'A', 0.01, 'm^2/s, declared 0.008',
      physics={'valve': 0.01}),
    R('tank', 'lower_scale', 98, 'scale', 'lower', 1.1, '', on('lower', scaled, 1.1),
      alike='parameter A'),
    R('tank', 'inflow_scale', 99, 'scale', 'input', 1.1, '', on('input', scaled, 1.1),
      alike='parameter B'),
    R('tank', 'upper_frozen', 100, 'frozen', 'upper', 60, 's', on('upper', frozen, 200, 60)),

    R('oven', 'core_fahrenheit', 101, 'units', 'core', 1.8, 'degF by degC, from 32',
      both(on('core', scaled, 1.8), on('core', shifted, 32)),
      alike='scale and bias'),
    R('oven', 'wall_drift', 102, 'drift', 'wall', 0.005, 'degC/s', on('wall', drifting, 0.005)),
    R('oven', 'core_late', 103, 'delay', 'core', 5, 's', on('core', late, 5)),
    R('oven', 'room_noise', 104, 'noise', 'room', 3, '', on('room', noisy, 3)),
)
# fmt: on


def write_files(
    recording: Recording, system: System, folder: str | Path, forms: Mapping[str, tuple[str, Form]]
) -> None:
    """Simulate a recording of a system, and write its two files."""
    rng = np.random.default_rng(recording.seed)
    readings = system.simulate(rng, {**system.physics, **recording.physics})
    recording.fault(readings, rng)
    parameters = edited(recording, system.parameters)
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    write_recording(place / 'recording.mcap', readings, forms)
    (place / 'robot.yaml').write_text(parameters)


def edited(recording: Recording, parameters: str) -> str:
    """Return a parameter file with the replacements of a recording.

    Raises
    ------
    ValueError
        If the file does not contain a text that is replaced.
    """
    for declared, other in recording.edits.items():
        if declared not in parameters:
            raise ValueError(f"{recording.name}: expected '{declared}' in the parameter file")
        parameters = parameters.replace(declared, other)
    return parameters
