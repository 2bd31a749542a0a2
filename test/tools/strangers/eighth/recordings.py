# SPDX-License-Identifier: Apache-2.0
"""The recordings of the eighth set, with what is wrong with each."""

from __future__ import annotations

from pathlib import Path

from ..faults import (
    Generator,
    all_noisy,
    batched,
    both,
    coloured,
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
)
from ..fifth.recordings import shaken
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
from ..seventh.recordings import jittery
from ..simulation import Channel
from ..sixth.faults import connected
from ..third.faults import limited, magnetised, shifted_from, slipping
from .messages import FORMS
from .systems import SYSTEMS


def north_first(channel: Channel, rng: Generator) -> None:
    """Give vectors by north, east and down in place of east, north and up."""
    for part in (channel.value, channel.noise):
        part[:, :2] = part[:, 1::-1].copy()
        part[:, 2] *= -1.0


_FIRST, _SECOND, _THIRD = ({'columns': slice(k, k + 1)} for k in range(3))
_TURN = {'columns': slice(0, 3)}

# fmt: off
R = Recording
TABLE = (
    R('wheelchair', 'clean_long', 801, physics={'seconds': 600.0}),
    R('wheelchair', 'clean_waits', 802, physics={'halt': 38.0}),
    R('ebike', 'clean', 803),
    R('kiwi', 'clean_blocks', 804, fault=on('mocap', delivered_in_blocks, 0.3)),
    R('hexacopter', 'clean', 805),
    R('hexacopter', 'clean_slow_gnss', 806,
      fault=both(on('gnss', thinned, 5), on('velocity', thinned, 5))),
    R('cyclist', 'clean_no_phone', 807,
      edits={'fields: [east, north]': 'fields: [east, north]\n      enabled: false'}),
    R('turntable', 'clean_still', 808, physics={'halt': 11.0}),
    R('shaker', 'clean_short', 809, physics={'seconds': 20.0}),
    R('canal', 'clean_gaps', 810, fault=on('middle', interrupted, (150, 370), 60),
      alike='losses of middle'),
    R('reactor', 'clean', 811),
    R('hydrofoil', 'clean_jitter', 812, fault=on('imu', jittery, 0.06)),

    R('wheelchair', 'gyro_offset', 822, 'bias', 'gyro', 0.02, 'rad/s',
      on('gyro', shifted, 0.02, **_TURN)),
    R('wheelchair', 'wheels_apart', 824, 'scale', 'odom omega', 1.12, '',
      on('odom', scaled, 1.12, **_SECOND)),
    R('wheelchair', 'turn_mirrored', 825, 'sign', 'odom omega', -1, '',
      on('odom', scaled, -1, **_SECOND)),
    R('wheelchair', 'scanner_turned', 826, 'mounting', 'amcl', 3, 'deg about z',
      on('amcl', shifted, 3 * DEGREE, **_THIRD),
      alike='bias of amcl psi'),
    R('wheelchair', 'amcl_when_done', 827, 'delay', 'amcl', 0.25, 's', on('amcl', late, 0.25)),
    R('wheelchair', 'amcl_covariance', 828, 'noise', 'amcl', 3, '', on('amcl', declared_noise, 3)),
    R('wheelchair', 'amcl_long_corridor', 829, 'outliers', 'amcl', 0.5, 'm, clusters of 3 s',
      on('amcl', displaced, (20, 47, 71), 3, (0.4, -0.3, 0, 0))),
    R('wheelchair', 'ramp_slips', 830, 'slip', 'odom', 1.3, 'of the true rates, 3 s, four times',
      on('odom', slipping, (14, 36, 59, 80), 3, 1.3)),
    R('wheelchair', 'joystick_late', 831, 'input delay', 'input', 0.25, 's',
      on('input', early, 0.25)),

    R('ebike', 'doppler_late', 834, 'delay', 'doppler', 0.8, 's', on('doppler', late, 0.8)),
    R('ebike', 'accelerometer_nods', 835, 'bias', 'accelerometer', 0.3, 'm/s^2',
      on('accelerometer', shifted, 0.3, columns=slice(3, 4)),
      alike='mounting'),
    R('ebike', 'child_seat', 836, 'parameter', 'mass', 120, 'kg, declared 100',
      physics={'mass': 120.0}),
    R('ebike', 'barometer_hpa', 838, 'units', 'barometer', 0.01, 'hPa by Pa',
      on('barometer', scaled, 0.01)),
    R('ebike', 'barometer_in_wind', 839, 'disturbed', 'barometer', 60, 'Pa for 15 s',
      on('barometer', disturbed, 90, 15, 60)),
    R('ebike', 'crank_15_percent', 840, 'scale', 'input', 1.15, '', on('input', scaled, 1.15)),
    R('ebike', 'magnet_skips', 841, 'losses', 'wheel', 0.35, 'of all, each by itself',
      on('wheel', lost, 0.35)),

    R('kiwi', 'small_roller', 842, 'scale', 'wheels b', 1.08, '',
      on('wheels', scaled, 1.08, **_SECOND)),
    R('kiwi', 'gyro_below', 844, 'mounting', 'gyro', 180, 'deg about x',
      on('gyro', mounted, 0, 180),
      alike='sign'),
    R('kiwi', 'marker_ahead', 845, 'lever arm', 'mocap', 0.06, 'm forward, declared 0',
      physics={'marker': 0.06}),
    R('kiwi', 'mocap_y_up', 846, 'axes', 'mocap', 0, 'x and y swapped',
      on('mocap', exchanged, 0, 1)),
    R('kiwi', 'mocap_rigid_body', 847, 'mounting', 'mocap', 4, 'deg about z',
      on('mocap', shifted, 4 * DEGREE, columns=slice(5, 6)),
      alike='bias of mocap yaw'),
    R('kiwi', 'mocap_rounded', 848, 'stamps', 'mocap', 0.1, 's', on('mocap', rounded, 0.1)),
    R('kiwi', 'mocap_hidden', 850, 'losses', 'mocap', 3, 's, thrice',
      on('mocap', interrupted, (12, 29, 45), 3)),
    R('kiwi', 'drives_stick', 851, 'dead zone', 'input', 0.08, 'm/s',
      physics={'least': 0.08}),

    R('hexacopter', 'imu_arrow_left', 854, 'mounting', 'input', 90, 'deg about z',
      on('input', mounted, 2, 90),
      alike='mounting of compass; bias of compass'),
    R('hexacopter', 'declination_missing', 855, 'bias', 'compass', 12 * DEGREE, 'rad',
      on('compass', shifted, 12 * DEGREE),
      alike='mounting of compass; mounting of input'),
    R('hexacopter', 'motor_currents', 856, 'hard iron', 'compass', 0.25, 'rad',
      on('compass', magnetised, 0.25)),
    R('hexacopter', 'antenna_on_tail', 857, 'lever arm', 'gnss', -0.3,
      'm forward, declared 0', physics={'antenna': 0.3},
      alike='lever arm of velocity'),
    R('hexacopter', 'gnss_late', 858, 'delay', 'gnss', 0.15, 's', on('gnss', late, 0.15)),
    R('hexacopter', 'velocity_ned', 859, 'axes', 'velocity', 0, 'north, east and down',
      on('velocity', north_first)),
    R('hexacopter', 'gyro_degrees', 860, 'units', 'input', 1 / DEGREE, 'deg/rad, of the rates',
      on('input', scaled, 1 / DEGREE, **_TURN)),
    R('hexacopter', 'low_pressure', 861, 'bias', 'barometer', -250, 'Pa',
      on('barometer', shifted, -250),
      alike='parameter of sea_level_pressure barometer.sea_level_pressure; '
            'parameter of altitude barometer.altitude'),
    R('hexacopter', 'hot_barometer', 862, 'drift', 'barometer', 1.2, 'Pa/s',
      on('barometer', drifting, 1.2)),
    R('hexacopter', 'propellers_unbalanced', 863, 'process noise', 'accelerometer_noise', 100,
      'of the variance that is declared', physics={'shaking': 10.0}),
    R('hexacopter', 'corrections_lost', 864, 'disturbed', 'gnss', 8, 'of the noise for 20 s',
      on('gnss', shaken, 25, 20, 8)),

    R('cyclist', 'radar_aim', 865, 'mounting', 'radar', 1.5, 'deg about z',
      on('radar', shifted, 1.5 * DEGREE, **_SECOND),
      alike='bias of radar bearing'),
    R('cyclist', 'radar_bearing_degrees', 866, 'units', 'radar bearing', 1 / DEGREE, 'deg/rad',
      on('radar', scaled, 1 / DEGREE, **_SECOND)),
    R('cyclist', 'closing_is_positive', 867, 'sign', 'radar range_rate', -1, '',
      on('radar', scaled, -1, **_THIRD)),
    R('cyclist', 'radar_ghosts', 868, 'outliers', 'radar range', 5, 'm, 4 % of all',
      on('radar', outlying, 0.04, (5, 0, 0))),
    R('cyclist', 'camera_clock', 870, 'clock offset', 'camera', -0.5, 's',
      on('camera', misdated, -0.5)),
    R('cyclist', 'camera_bumped', 871, 'frame', 'camera', 5, 'deg for 25 s',
      on('camera', tilted, 5, 60, 25)),
    R('cyclist', 'phone_late', 873, 'delay', 'phone', 2.5, 's', on('phone', late, 2.5)),
    R('cyclist', 'too_lazy', 875, 'process noise', 'acceleration_noise', 30,
      'of the variance that is declared',
      edits={'acceleration_noise: 0.03': 'acceleration_noise: 0.001'}),

    R('turntable', 'disc_added', 876, 'parameter', 'inertia', 0.026, 'kg m^2, declared 0.02',
      physics={'inertia': 0.026}),
    R('turntable', 'bridge_loses', 878, 'dead zone', 'input', 0.7, 'V', physics={'lost': 0.7}),
    R('turntable', 'weak_half_bridge', 879, 'asymmetry', 'input', 0.85, 'backwards',
      physics={'back': 0.85}),
    R('turntable', 'wrong_line_count', 880, 'scale', 'encoder', 0.5, '',
      on('encoder', scaled, 0.5)),
    R('turntable', 'channels_swapped', 881, 'sign', 'encoder', -1, '', on('encoder', scaled, -1)),
    R('turntable', 'shunt_zero', 882, 'bias', 'shunt', 0.15, 'A', on('shunt', shifted, 0.15)),
    R('turntable', 'shunt_clips', 883, 'saturation', 'shunt', 2.5, 'A', on('shunt', limited, 2.5)),
    R('turntable', 'encoder_in_packets', 884, 'stamps', 'encoder', 5, 'messages within 5 ms',
      on('encoder', batched, 5, 1e-3)),
    R('turntable', 'gyro_rough', 885, 'noise', 'gyro', 2.5, '', on('gyro', noisy, 2.5)),

    R('shaker', 'specimen', 886, 'parameter', 'mass', 13.5, 'kg, declared 12',
      physics={'mass': 13.5}),
    R('shaker', 'coil_reversed', 887, 'sign', 'input', -1, '', on('input', scaled, -1)),
    R('shaker', 'vibrometer_mm', 888, 'units', 'vibrometer', 1000, 'mm by m',
      on('vibrometer', scaled, 1000)),
    R('shaker', 'lvdt_coarse', 889, 'quantised', 'lvdt', 0.005, 'm',
      on('lvdt', quantised, 0.005)),
    R('shaker', 'mains_hum', 893, 'correlated noise', 'lvdt cell', 0.85, '',
      shared('lvdt', 'cell', 0.85, 4 / 5e-4)),
    R('shaker', 'everything_rough', 894, 'noise', 'all', 1.5, '', all_noisy(1.5)),

    R('canal', 'silted', 895, 'parameter', 'A, C', 0.42, 'm^2/s, declared 0.5',
      physics={'culvert': 0.42}),
    R('canal', 'stolen_water', 896, 'bias', 'input', -0.05, 'm^3/s of the offtake',
      physics={'thief': 0.05}),
    R('canal', 'gauges_exchanged', 899, 'axes', 'upper', 0, 'upper and middle exchanged',
      connected('upper', 'middle'),
      alike='axes of middle'),
    R('canal', 'wind', 900, 'coloured noise', 'middle', 8, 's', on('middle', coloured, 8)),
    R('canal', 'spider', 901, 'frozen', 'upper', 50, 's', on('upper', frozen, 260, 50)),
    R('canal', 'sluice_15_percent', 902, 'scale', 'input', 1.15, 'of the inflow',
      on('input', scaled, 1.15, **_FIRST),
      alike='parameter B'),
    R('canal', 'water_arrives_late', 903, 'input delay', 'input', 12, 's', on('input', early, 12)),

    R('reactor', 'fouled_wall', 905, 'parameter', 'transfer', 0.016, '1/s, declared 0.02',
      physics={'transfer': 0.016}),
    R('reactor', 'old_catalyst', 906, 'parameter', 'rate', 0.0075, '1/s, declared 0.01',
      physics={'rate': 0.0075}),
    R('reactor', 'thermowell_thick', 907, 'lag', 'thermowell', 12, 's',
      on('thermowell', lagging, 12),
      alike='delay'),
    R('reactor', 'jacket_fahrenheit', 908, 'units', 'jacket', 1.8, 'degF by degC, from 32',
      both(on('jacket', scaled, 1.8), on('jacket', shifted, 32)),
      alike='scale and bias'),
    R('reactor', 'sample_line', 909, 'delay', 'analyser', 15, 's', on('analyser', late, 15)),
    R('reactor', 'jacket_step', 911, 'bias step', 'jacket', 0.8, 'degC from 400 s on',
      on('jacket', shifted_from, 400, 0.8),
      alike='bias'),

    R('hydrofoil', 'bow_bracket', 914, 'lever arm', 'bow', 1.9, 'm forward, declared 1.5',
      physics={'bow': 1.9},
      alike='parameter C'),
    R('hydrofoil', 'flaps_crossed', 916, 'axes', 'input', 0, 'fore and aft exchanged',
      on('input', exchanged, 0, 1)),
    R('hydrofoil', 'fore_trim', 918, 'bias', 'input', 0.015, 'rad of the fore flap',
      on('input', shifted, 0.015, **_FIRST)),
    R('hydrofoil', 'imu_late', 919, 'delay', 'imu', 0.03, 's', on('imu', late, 0.03)),
    R('hydrofoil', 'ahrs_clock', 920, 'clock drift', 'attitude', 0.003, 's/s',
      on('attitude', fast_clock, 0.003)),
    R('hydrofoil', 'rough_sea', 921, 'process noise', 'noise_density', 5,
      'of the variance that is declared', physics={'sea': 5.0}),
    R('hydrofoil', 'ahrs_wanders', 923, 'random walk', 'attitude', 0.004, 'rad/sqrt(s)',
      on('attitude', wandering, 0.004, **_SECOND)),
)
# fmt: on
RECORDINGS = {recording.name: recording for recording in TABLE}


def write(name: str, folder: str | Path) -> None:
    """Write ``recording.mcap`` and ``robot.yaml`` of a recording into a new or an empty folder."""
    recording = RECORDINGS[name]
    write_files(recording, SYSTEMS[recording.system], folder, FORMS)
