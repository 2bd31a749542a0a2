# SPDX-License-Identifier: Apache-2.0
"""The recordings of the fifth set, with what is wrong with each."""

from __future__ import annotations

from pathlib import Path

from ..faults import (
    Generator,
    all_noisy,
    batched,
    coloured,
    displaced,
    disturbed,
    drifting,
    frozen,
    interrupted,
    late,
    mounted,
    noisy,
    on,
    outlying,
    quantised,
    rounded,
    scaled,
    shifted,
    swapped,
)
from ..recordings import DEGREE, Recording, write_files
from ..second.faults import (
    declared_noise,
    delivered_in_blocks,
    early,
    exchanged,
    fast_clock,
    lagging,
    misdated,
    shared,
    thinned,
    tilted,
    wandering,
)
from ..simulation import Channel
from ..third.faults import limited, shifted_from, slipping
from .messages import FORMS
from .systems import SYSTEMS


def shaken(channel: Channel, rng: Generator, begin: float, seconds: float, factor: float) -> None:
    """Multiply the noise for a stretch of time."""
    rows = (channel.time >= begin) & (channel.time < begin + seconds)
    channel.noise[rows] *= factor


_FIRST, _SECOND, _THIRD = ({'columns': slice(k, k + 1)} for k in range(3))
_TURN, _ACCELERATION = {'columns': slice(0, 3)}, {'columns': slice(3, 6)}

# fmt: off
R = Recording
TABLE = (
    R('courier', 'clean', 601),
    R('courier', 'clean_slow_gnss', 602, fault=on('gnss', thinned, 5)),
    R('racer', 'clean', 603),
    R('scout', 'clean', 604),
    R('target', 'clean', 605),
    R('tag', 'clean', 606),
    R('tag', 'clean_blocks', 607, fault=on('uwb', delivered_in_blocks, 0.4)),
    R('headset', 'clean', 608),
    R('gantry', 'clean', 609),
    R('silo', 'clean', 610),
    R('turbine', 'clean', 611),
    R('plate', 'clean', 612),

    R('courier', 'left_tyre', 621, 'scale', 'wheels left', 0.95, '',
      on('wheels', scaled, 0.95, **_FIRST)),
    R('courier', 'gyro_upside_down', 622, 'sign', 'gyro', -1, '', on('gyro', scaled, -1, **_TURN),
      alike='mounting'),
    R('courier', 'declination', 623, 'bias', 'compass', 8 * DEGREE, 'rad',
      on('compass', shifted, 8 * DEGREE),
      alike='mounting of compass; mounting of gnss'),
    R('courier', 'parked_cars', 624, 'disturbed', 'compass', 0.5, 'rad for 9 s',
      on('compass', disturbed, 64, 9, 0.5)),
    R('courier', 'multipath', 625, 'outliers', 'gnss', 3.6, 'm, clusters of 4 s',
      on('gnss', displaced, (14, 33, 52, 78, 101), 4, (3, -2, 0))),
    R('courier', 'gnss_late', 626, 'delay', 'gnss', 0.3, 's', on('gnss', late, 0.3)),
    R('courier', 'antenna_left', 627, 'lever arm', 'gnss', 0.4, 'm left, declared 0',
      physics={'antenna_left': 0.4}),
    R('courier', 'gnss_covariance', 628, 'noise', 'gnss', 2.5, '',
      on('gnss', declared_noise, 2.5)),
    R('courier', 'wet_leaves', 629, 'slip', 'wheels', 1.4, 'of the true rates, 3 s, four times',
      on('wheels', slipping, (22, 45, 73, 99), 3, 1.4)),
    R('courier', 'wheels_swapped', 630, 'axes', 'wheels', 0, 'left and right swapped',
      on('wheels', exchanged, 0, 1)),
    R('courier', 'gnss_coloured', 631, 'coloured noise', 'gnss', 15, 's',
      on('gnss', coloured, 15)),

    R('racer', 'worn_tyres', 632, 'parameter', 'stiffness imu.stiffness', 28,
      'N/rad, declared 35',
      physics={'stiffness': 28.0}),
    R('racer', 'linkage', 633, 'scale', 'input', 1 / 0.88, 'of the steering',
      physics={'reach': 0.88}),
    R('racer', 'commands_late', 634, 'input delay', 'input', 0.06, 's', on('input', early, 0.06),
      alike='parameter servo'),
    R('racer', 'imu_leans', 635, 'bias', 'imu acceleration', 0.5, 'm/s^2',
      on('imu', shifted, 0.5, columns=slice(4, 5))),
    R('racer', 'wheel_5_percent', 636, 'scale', 'wheel', 1.05, '', on('wheel', scaled, 1.05)),
    R('racer', 'lidar_late', 637, 'delay', 'lidar', 0.08, 's', on('lidar', late, 0.08)),
    R('racer', 'lidar_jumps', 638, 'outliers', 'lidar', 0.4, 'm and rad, 4 % of all',
      on('lidar', outlying, 0.04, (0.4, 0.4, 0.4, 0))),

    R('scout', 'lens', 639, 'scale', 'flow', 1.12, '', on('flow', scaled, 1.12)),
    R('scout', 'flow_late', 640, 'delay', 'flow', 0.2, 's', on('flow', late, 0.2)),
    R('scout', 'flow_stuck', 641, 'frozen', 'flow', 3, 's', on('flow', frozen, 31, 3)),
    R('scout', 'attitude_slips', 642, 'bias step', 'attitude pitch', 0.03, 'rad from 28 s on',
      on('attitude', shifted_from, 28, 0.03, **_SECOND),
      alike='bias of attitude pitch'),
    R('scout', 'attitude_rolled', 643, 'mounting', 'attitude', 2.5, 'deg about x',
      on('attitude', shifted, 2.5 * DEGREE, **_FIRST),
      alike='bias of attitude roll'),
    R('scout', 'commands_late', 644, 'input delay', 'input', 0.15, 's', on('input', early, 0.15),
      alike='parameter attitude_lag; parameter climb_lag'),
    R('scout', 'draggy', 645, 'parameter', 'drag', 0.8, '1/s, declared 0.5',
      physics={'drag': 0.8}),
    R('scout', 'range_echoes', 646, 'outliers', 'range', 1, 'm, 5 % of all',
      on('range', outlying, 0.05, 1)),

    R('target', 'radar_north', 647, 'mounting', 'radar', 0.6, 'deg about z',
      on('radar', shifted, 0.6 * DEGREE, **_SECOND),
      alike='bias of radar bearing'),
    R('target', 'radar_cable', 648, 'bias', 'radar range', 100, 'm',
      on('radar', shifted, 100, **_FIRST)),
    R('target', 'transponder_late', 649, 'delay', 'transponder', 1.5, 's',
      on('transponder', late, 1.5)),
    R('target', 'mast_clock', 650, 'clock offset', 'mast', -1, 's', on('mast', misdated, -1)),
    R('target', 'wrong_heading', 651, 'initial state', 'psi', 2.4, 'rad, declared 1.7',
      edits={'90.0, 2.4, 0.0]': '90.0, 1.7, 0.0]'}),
    R('target', 'mast_misplaced', 652, 'parameter', 'position mast.position', 6000,
      'm along x, declared 6120',
      edits={'[6000.0, -2000.0]': '[6120.0, -2000.0]'}),
    R('target', 'mast_bends', 653, 'random walk', 'mast', 0.0015, 'rad/sqrt(s)',
      on('mast', wandering, 0.0015)),

    R('tag', 'anchors_exchanged', 654, 'axes', 'uwb', 0, 'b and c swapped',
      on('uwb', exchanged, 1, 2),
      alike='parameter of positions uwb.positions'),
    R('tag', 'anchor_moved', 655, 'parameter', 'positions uwb.positions', 40.9,
      'm along x, declared 40',
      physics={'anchor': 40.9}),
    R('tag', 'antenna_delay', 656, 'bias', 'uwb', 0.3, 'm', on('uwb', shifted, 0.3),
      alike='parameter of range_offset uwb.range_offset'),
    R('tag', 'shelf', 657, 'outliers', 'uwb range_3', 0.9, 'm, clusters of 5 s',
      on('uwb', displaced, (11, 27, 46, 62, 79), 5, (0, 0, 0.9, 0))),
    R('tag', 'interference', 658, 'disturbed', 'uwb', 5, 'of the noise for 12 s',
      on('uwb', shaken, 40, 12, 5)),
    R('tag', 'camera_frame', 659, 'frame', 'camera', 10, 'deg for 15 s',
      on('camera', tilted, 10, 55, 15)),
    R('tag', 'camera_turned', 660, 'mounting', 'camera', 1.5, 'deg about z',
      on('camera', tilted, 1.5)),
    R('tag', 'lazy', 661, 'process noise', 'noise_density', 30,
      'of the variance that is declared',
      edits={'0.0, 0.15, 0.15]': '0.0, 0.005, 0.005]'}),
    R('tag', 'uwb_careful', 662, 'noise', 'uwb', 1 / 3, '', on('uwb', noisy, 1 / 3)),

    R('headset', 'markers_ahead', 663, 'lever arm', 'camera', 0.08, 'm forward, declared 0',
      physics={'markers': 0.08}),
    R('headset', 'markers_turned', 664, 'mounting', 'camera', 4, 'deg about z',
      physics={'turned': 4 * DEGREE},
      alike='mounting of input'),
    R('headset', 'camera_late', 665, 'delay', 'camera', 0.04, 's', on('camera', late, 0.04),
      alike='input delay of input'),
    R('headset', 'camera_clock', 666, 'clock drift', 'camera', 0.0015, 's/s',
      on('camera', fast_clock, 0.0015)),
    R('headset', 'camera_rounded', 667, 'stamps', 'camera', 0.03, 's',
      on('camera', rounded, 0.03)),
    R('headset', 'imu_in_g', 668, 'units', 'input', 1 / 9.80665, 'g by m/s^2',
      on('input', scaled, 1 / 9.80665, **_ACCELERATION),
      alike='parameter accelerometer_scale'),
    R('headset', 'imu_quarter_turn', 669, 'mounting', 'input', 90, 'deg about z',
      on('input', mounted, 2, 90),
      alike='mounting of camera'),
    R('headset', 'gyro_4_percent', 670, 'scale', 'input', 1.04, 'of the rates',
      on('input', scaled, 1.04, **_TURN),
      alike='parameter gyro_scale'),

    R('gantry', 'payload', 671, 'parameter', 'A, C', 6, 'kg, declared 5', physics={'mass': 6.0}),
    R('gantry', 'belt_worn', 672, 'parameter', 'A, C', 2500, 'N/m, declared 3000',
      physics={'belt': 2500.0}),
    R('gantry', 'stiction', 673, 'dead zone', 'input', 4, 'N', physics={'stuck': 4.0}),
    R('gantry', 'force_late', 674, 'input delay', 'input', 0.02, 's', on('input', early, 0.02)),
    R('gantry', 'encoder_coarse', 675, 'quantised', 'encoder', 0.15, 'rad',
      on('encoder', quantised, 0.15)),
    R('gantry', 'encoder_batched', 676, 'stamps', 'encoder', 10, 'messages within 10 ms',
      on('encoder', batched, 10, 1e-3)),
    R('gantry', 'laser_averages', 677, 'lag', 'laser', 0.03, 's', on('laser', lagging, 0.03),
      alike='delay'),
    R('gantry', 'imu_limit', 678, 'saturation', 'imu', 2.5, 'm/s^2', on('imu', limited, 2.5)),
    R('gantry', 'pulley', 679, 'scale', 'encoder', 0.97, '', on('encoder', scaled, 0.97)),

    R('silo', 'filling', 680, 'outliers', 'radar', 0.5, 'm, clusters of 12 s',
      on('radar', displaced, (40, 110, 175, 250), 12, (0.5,))),
    R('silo', 'cells_creep', 681, 'drift', 'cells', 5, 'N/s', on('cells', drifting, 5)),
    R('silo', 'ultrasound_offset', 682, 'bias', 'ultrasound', 0.12, 'm',
      on('ultrasound', shifted, 0.12)),
    R('silo', 'radar_stuck', 683, 'frozen', 'radar', 40, 's', on('radar', frozen, 160, 40)),
    R('silo', 'dust', 684, 'correlated noise', 'radar ultrasound', 0.8, '',
      shared('radar', 'ultrasound', 0.8, 5 / 3)),
    R('silo', 'radar_feet', 685, 'units', 'radar', 3.28084, 'ft/m', on('radar', scaled, 3.28084)),
    R('silo', 'all_noise_half', 686, 'noise', 'all', 0.5, '', all_noisy(0.5)),

    R('turbine', 'iced', 687, 'parameter', 'inertia', 560, 'kg m^2, declared 400',
      physics={'inertia': 560.0}),
    R('turbine', 'cracked', 688, 'parameter', 'shaft', 5500, 'N m, declared 8000',
      physics={'shaft': 5500.0}),
    R('turbine', 'wake', 689, 'scale', 'anemometer', 0.85, '', on('anemometer', scaled, 0.85),
      alike='bias'),
    R('turbine', 'torque_10_percent', 690, 'scale', 'input', 1.1, '', on('input', scaled, 1.1)),
    R('turbine', 'rotor_rough', 691, 'noise', 'rotor', 3, '', on('rotor', noisy, 3)),

    R('plate', 'camera_late', 692, 'delay', 'camera', 0.08, 's', on('camera', late, 0.08)),
    R('plate', 'camera_turned', 693, 'mounting', 'camera', 10, 'deg about z',
      on('camera', tilted, 10)),
    R('plate', 'camera_swapped', 694, 'axes', 'camera', 0, 'x and y swapped',
      on('camera', swapped)),
    R('plate', 'tilt_zero', 695, 'bias', 'tilt alpha', 0.01, 'rad',
      on('tilt', shifted, 0.01, **_FIRST)),
    R('plate', 'slow_servos', 696, 'parameter', 'A, B', 0.12, 's, declared 0.08',
      physics={'servo': 0.12},
      alike='input delay of input'),
    R('plate', 'lights_out', 697, 'losses', 'camera', 2, 's, thrice',
      on('camera', interrupted, (11, 22, 34), 2)),
    R('plate', 'beta_reversed', 698, 'sign', 'input', -1, 'of beta',
      on('input', scaled, -1, **_SECOND)),
)
# fmt: on
RECORDINGS = {recording.name: recording for recording in TABLE}


def write(name: str, folder: str | Path) -> None:
    """Write ``recording.mcap`` and ``robot.yaml`` of a recording into a new or an empty folder."""
    recording = RECORDINGS[name]
    write_files(recording, SYSTEMS[recording.system], folder, FORMS)
