# SPDX-License-Identifier: Apache-2.0
"""The real recordings, with what is wrong with each: by itself (`OWN`), and injected."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import pi

from ..faults import (
    disturbed,
    frozen,
    interrupted,
    late,
    lost,
    mounted,
    on,
    outlying,
    rounded,
    scaled,
    shifted,
)
from ..recordings import DEGREE, Recording
from ..second.faults import exchanged, tilted
from .faults import hissing, offset, spun

_TURN = {'columns': slice(0, 3)}
_FIRST, _SECOND, _THIRD = ({'columns': slice(k, k + 1)} for k in range(3))

_ANCHORS = ('anchor_105', 'anchor_107', 'anchor_109', 'anchor_108')


def _each(sensors: Sequence[str], *kinds: str) -> str:
    """Return these kinds of causes, of each of these sensors, in words."""
    return '; '.join(f'{kind} of {sensor}' for kind in kinds for sensor in sensors)


#: What each recording has by itself with the file of its careful owner: README.md.
OWN = {
    'diff_drive': 'noise of all; clock offset of heading; process noise',
    'car_60s': _each(('gnss',), 'losses', 'coloured noise')
    + '; noise of all; scale of wheels; process noise',
    'uwb_robot': _each(_ANCHORS, 'outliers', 'noise', 'coloured noise', 'bias')
    + '; noise of odometry; losses of anchor_105; losses of anchor_108; process noise',
    'lidar_radar': 'process noise',
    'driven_pendulum': _each(('velocity', 'torque'), 'noise', 'outliers')
    + '; coloured noise of torque; quantised of all; '
    'parameter inertia weight viscous dry offset; process noise',
    'imu_optical': 'noise of all; coloured noise of magnetometer; delay of magnetometer; '
    'process noise',
}

# fmt: off
R = {system: partial(Recording, system, own=own) for system, own in OWN.items()}
TABLE = (
    R['diff_drive']('as_is', 401),
    R['diff_drive']('skidding', 402, 'scale', 'wheels omega', 5, '',
      alike='scale 0; noise; coloured noise; bias; drift; disturbed', edits={
        'measures: [v]': 'measures: [v, omega]', 'linear.x]': 'linear.x, twist.twist.angular.z]',
        'noise: [0.0316]': 'noise: [0.0316, 0.173]'}),
    R['diff_drive']('gyro_sign', 403, 'sign', 'gyro', -1, '', on('gyro', scaled, -1)),
    R['diff_drive']('gyro_degrees', 404, 'units', 'gyro', 1 / DEGREE, 'deg/rad',
      on('gyro', scaled, 1 / DEGREE, **_TURN)),
    R['diff_drive']('gyro_on_its_side', 405, 'mounting', 'gyro', 90, 'deg about x',
      on('gyro', mounted, 0, 90),
      alike='scale 0'),
    R['diff_drive']('gyro_10_percent', 406, 'scale', 'gyro', 1.1, '',
      on('gyro', scaled, 1.1, **_TURN)),
    R['diff_drive']('gyro_100_ms', 407, 'delay', 'gyro', 0.1, 's', on('gyro', late, 0.1),
      alike='clock offset of heading'),
    R['diff_drive']('gyro_bias', 408, 'bias', 'gyro', 0.05, 'rad/s',
      on('gyro', shifted, 0.05, **_TURN),
      alike='drift of heading'),
    R['diff_drive']('gyro_lost', 409, 'losses', 'gyro', 0.3, '', on('gyro', lost, 0.3)),
    R['diff_drive']('wheels_frozen', 410, 'frozen', 'wheels', 4, 's',
      on('wheels', frozen, 30, 4)),
    R['diff_drive']('wheels_noise', 411, 'noise', 'wheels', 9.5, '', on('wheels', hissing, 0.3)),

    R['car_60s']('as_is', 412),
    R['car_60s']('naive', 413, 'delay', 'gnss', 0.1, 's',
      alike='clean', own=f'{OWN["car_60s"]}; mounting of wheels',
      edits={'      stamp_offset: -0.1\n': '',
             '      mount: {rotation: [0.0, 0.0657, -0.0143]}\n': ''}),
    R['car_60s']('gnss_100_ms', 414, 'delay', 'gnss', 0.1, 's', on('gnss', late, 0.1),
      alike='clean'),
    R['car_60s']('gnss_500_ms', 468, 'delay', 'gnss', 0.5, 's', on('gnss', late, 0.5)),
    R['car_60s']('gnss_swapped', 415, 'axes', 'gnss', 0, 'east and north swapped',
      edits={'fields: [east, north, up]': 'fields: [north, east, up]'}),
    R['car_60s']('gnss_outliers', 416, 'outliers', 'gnss', 20, 'm, 5 % of all',
      on('gnss', outlying, 0.05, 2e-4)),
    R['car_60s']('gnss_noise', 417, 'noise', 'gnss', 3, '', on('gnss', hissing, 4.5e-5)),
    R['car_60s']('gnss_tunnels', 418, 'losses', 'gnss', 6, 's, twice',
      on('gnss', interrupted, (20, 42), 6)),
    R['car_60s']('wheels_10_percent', 419, 'scale', 'wheels', 1.1, '', on('wheels', scaled, 1.1)),
    R['car_60s']('wheels_kmh', 420, 'units', 'wheels', 3.6, 'km/h by m/s',
      on('wheels', scaled, 3.6)),
    R['car_60s']('wheels_frozen', 421, 'frozen', 'wheels', 6, 's', on('wheels', frozen, 30, 6)),
    R['car_60s']('imu_20_degrees', 422, 'mounting', 'input', 20, 'deg about z',
      on('input', mounted, 2, 20),
      alike='mounting of wheels'),
    R['car_60s']('imu_degrees', 423, 'units', 'input', 1 / DEGREE, 'deg/rad',
      on('input', scaled, 1 / DEGREE, **_TURN)),

    R['uwb_robot']('as_is', 424),
    R['uwb_robot']('naive', 425, 'bias', 'anchor_105', 0.155, 'm',
      alike=_each(_ANCHORS[1:], 'bias'),
      edits={'      bias_std: [0.15]\n': '', 'noise: [0.11]': 'noise: [0.1]'}),
    R['uwb_robot']('as_documented', 426, 'sign', 'odometry omega', -2, '',
      on('odometry', scaled, -2, **_SECOND),
      alike='scale'),
    R['uwb_robot']('anchor_107_mm', 427, 'units', 'anchor_107', 1000, 'mm/m',
      on('anchor_107', scaled, 1000)),
    R['uwb_robot']('anchor_109_frozen', 428, 'frozen', 'anchor_109', 8, 's',
      on('anchor_109', frozen, 12, 8)),
    R['uwb_robot']('anchor_108_outliers', 429, 'outliers', 'anchor_108', 1, 'm, 10 % of all',
      on('anchor_108', outlying, 0.1, 1)),
    R['uwb_robot']('anchor_105_noise', 430, 'noise', 'anchor_105', 4.6, '',
      on('anchor_105', hissing, 0.5)),
    R['uwb_robot']('ranges_noise_third', 431, 'noise', 'all', 3, '',
      edits={'noise: [0.11]': 'noise: [0.0367]'}),
    R['uwb_robot']('odometry_double', 432, 'scale', 'odometry v', 2, '',
      on('odometry', scaled, 2, **_FIRST)),
    R['uwb_robot']('odometry_degrees', 433, 'units', 'odometry omega', 1 / DEGREE, 'deg/rad',
      on('odometry', scaled, 1 / DEGREE, **_SECOND)),
    R['uwb_robot']('odometry_500_ms', 434, 'delay', 'odometry', 0.5, 's',
      on('odometry', late, 0.5)),

    R['lidar_radar']('as_is', 435),
    R['lidar_radar']('radar_degrees', 436, 'units', 'radar bearing', 1 / DEGREE, 'deg/rad',
      on('radar', scaled, 1 / DEGREE, **_SECOND)),
    R['lidar_radar']('radar_20_degrees', 437, 'mounting', 'radar', 20, 'deg about z',
      on('radar', shifted, 20 * DEGREE, **_SECOND),
      alike='bias of radar bearing; mounting of lidar'),
    R['lidar_radar']('range_rate_sign', 438, 'sign', 'radar range_rate', -1, '',
      on('radar', scaled, -1, **_THIRD)),
    R['lidar_radar']('range_10_percent', 439, 'scale', 'radar range', 1.1, '',
      on('radar', scaled, 1.1, **_FIRST)),
    R['lidar_radar']('lidar_quarter_turn', 440, 'mounting', 'lidar', 90, 'deg about z',
      on('lidar', tilted, 90),
      alike='axes; mounting of radar; bias of radar bearing'),
    R['lidar_radar']('lidar_swapped', 441, 'axes', 'lidar', 0, 'x and y swapped',
      on('lidar', exchanged, 0, 1)),
    R['lidar_radar']('lidar_100_ms', 442, 'delay', 'lidar', 0.1, 's', on('lidar', late, 0.1),
      alike='clock offset of radar'),
    R['lidar_radar']('lidar_bias', 443, 'bias', 'lidar', 0.8, 'm', on('lidar', shifted, 0.8)),
    R['lidar_radar']('lidar_lost', 444, 'losses', 'lidar', 0.3, '', on('lidar', lost, 0.3)),
    R['lidar_radar']('lidar_noise_triple', 445, 'noise', 'lidar', 1 / 3, '',
      edits={'noise: [0.15, 0.15]': 'noise: [0.45, 0.45]'}),
    R['lidar_radar']('radar_noise_third', 446, 'noise', 'radar', 3, '',
      edits={'noise: [0.3, 0.03, 0.3]': 'noise: [0.1, 0.01, 0.1]'}),

    R['driven_pendulum']('as_is', 447),
    R['driven_pendulum']('naive', 448, 'noise', 'torque', 8.5, '',
      edits={'noise: [0.85]': 'noise: [0.1]'}),
    R['driven_pendulum']('position_degrees', 449, 'units', 'position', 1 / DEGREE, 'deg/rad',
      on('position', scaled, 1 / DEGREE)),
    R['driven_pendulum']('position_frozen', 450, 'frozen', 'position', 0.4, 's',
      on('position', frozen, 1.5, 0.4)),
    R['driven_pendulum']('position_rounded', 451, 'stamps', 'position', 0.01, 's',
      on('position', rounded, 0.01)),
    R['driven_pendulum']('position_noise', 452, 'noise', 'position', 10, '',
      on('position', hissing, 0.05)),
    R['driven_pendulum']('velocity_sign', 453, 'sign', 'velocity', -1, '',
      on('velocity', scaled, -1)),
    R['driven_pendulum']('velocity_rpm', 454, 'units', 'velocity', 30 / pi, 'rpm by rad/s',
      on('velocity', scaled, 30 / pi)),
    R['driven_pendulum']('velocity_10_percent', 455, 'scale', 'velocity', 1.1, '',
      on('velocity', scaled, 1.1)),
    R['driven_pendulum']('velocity_bias', 456, 'bias', 'velocity', 1, 'rad/s',
      on('velocity', shifted, 1)),
    R['driven_pendulum']('velocity_100_ms', 457, 'delay', 'velocity', 0.1, 's',
      on('velocity', late, 0.1)),
    R['driven_pendulum']('velocity_bursts', 458, 'losses', 'velocity', 0.3, 's, thrice',
      on('velocity', interrupted, (0.8, 1.9, 3.1), 0.3)),
    R['driven_pendulum']('torque_sign', 459, 'sign', 'torque', -1, '', on('torque', scaled, -1)),

    R['imu_optical']('as_is', 460),
    R['imu_optical']('magnetometer_quarter_turn', 461, 'mounting', 'magnetometer', 90,
      'deg about z', on('magnetometer', spun, 2, pi / 2)),
    R['imu_optical']('magnetometer_gauss', 462, 'units', 'magnetometer', 1e4, 'G/T',
      on('magnetometer', scaled, 1e4)),
    R['imu_optical']('magnetometer_iron', 463, 'bias', 'magnetometer', 4e-5, 'T along x',
      on('magnetometer', offset, (4e-5, 0.0, 0.0))),
    R['imu_optical']('magnetometer_passed', 464, 'disturbed', 'magnetometer', 1e-4,
      'T for 10 s', on('magnetometer', disturbed, 80, 10, 1e-4)),
    R['imu_optical']('magnetometer_frozen', 465, 'frozen', 'magnetometer', 15, 's',
      on('magnetometer', frozen, 80, 15)),
    R['imu_optical']('imu_degrees', 466, 'units', 'input', 1 / DEGREE, 'deg/rad',
      on('input', scaled, 1 / DEGREE, **_TURN)),
    R['imu_optical']('imu_sign', 467, 'sign', 'input', -1, 'of its rates',
      on('input', scaled, -1, **_TURN)),
)
