# SPDX-License-Identifier: Apache-2.0
"""The recordings of the seventh set, with what is wrong with each."""

from __future__ import annotations

import numpy as np

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
from ..fifth.recordings import shaken
from ..recordings import DEGREE, Recording
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
from ..third.faults import limited, magnetised, shifted_from, slipping


def jittery(channel: Channel, rng: Generator, most: float) -> None:
    """Receive messages with right stamps up to some time later, in their order."""
    waited = channel.received + rng.uniform(0.0, most, len(channel.received))
    channel.received[:] = np.maximum.accumulate(waited)


_FIRST, _SECOND = ({'columns': slice(k, k + 1)} for k in range(2))
_TURN = {'columns': slice(0, 3)}
#: What the file of the mixer has on its flow meter.
_FLOW = """    flow:                        # of the outlet
      kind: tools.strangers.seventh.models:Outflow
      outlet: 0.015
      topic: outflow
      type: geometry_msgs/TwistStamped
      fields: [twist.linear.x]
      noise: [0.0003]
"""

# fmt: off
R = Recording
TABLE = (
    R('weeder', 'clean', 701),
    R('weeder', 'clean_stands', 702, physics={'halt': 40.0}),
    R('trolley', 'clean_blocks', 703, fault=on('laser', delivered_in_blocks, 1.0)),
    R('yacht', 'clean', 704),
    R('yacht', 'clean_slow_gnss', 705, fault=on('gnss', thinned, 12)),
    R('parafoil', 'clean_jitter', 706, fault=on('gyro', jittery, 0.08)),
    R('horse', 'clean', 707),
    R('elbow', 'clean_short', 708, physics={'seconds': 20.0}),
    R('ram', 'clean', 709),
    R('orangery', 'clean', 710),
    R('telescope', 'clean_pauses', 711, fault=on('stars', interrupted, (15, 35), 8),
      alike='losses of stars'),
    R('mixer', 'clean_no_flow', 712, edits={'probe, flow]': 'probe]', _FLOW: ''}),

    R('weeder', 'right_wheel', 721, 'scale', 'wheels right', 0.94, '',
      on('wheels', scaled, 0.94, **_SECOND)),
    R('weeder', 'gyro_bias', 723, 'bias', 'gyro', 0.03, 'rad/s',
      on('gyro', shifted, 0.03, **_TURN)),
    R('weeder', 'gnss_late', 724, 'delay', 'gnss', 0.25, 's', on('gnss', late, 0.25)),
    R('weeder', 'antenna_ahead', 725, 'lever arm', 'gnss', 0.3,
      'm forward, beyond the declared 0.3',
      physics={'antenna': 0.6}),
    R('weeder', 'turn_reversed', 726, 'sign', 'input', -1, 'of the turn',
      on('input', scaled, -1, **_SECOND)),
    R('weeder', 'commands_late', 727, 'input delay', 'input', 0.2, 's', on('input', early, 0.2),
      alike='parameter command_time'),
    R('weeder', 'wet_soil', 728, 'slip', 'wheels', 1.35, 'of the true rates, 3 s, four times',
      on('wheels', slipping, (15, 34, 52, 71), 3, 1.35)),
    R('weeder', 'no_corrections', 729, 'outliers', 'gnss', 0.7, 'm, clusters of 4 s',
      on('gnss', displaced, (18, 43, 66), 4, (0.6, -0.35))),
    R('weeder', 'wheels_rounded', 730, 'stamps', 'wheels', 0.2, 's', on('wheels', rounded, 0.2)),

    R('trolley', 'odometer_worn', 731, 'scale', 'odometer', 1.03, '',
      on('odometer', scaled, 1.03)),
    R('trolley', 'doppler_km_h', 732, 'units', 'doppler', 3.6, 'km/h by m/s',
      on('doppler', scaled, 3.6)),
    R('trolley', 'laser_clock', 733, 'clock offset', 'laser', -0.3, 's',
      on('laser', misdated, -0.3)),
    R('trolley', 'odometer_coarse', 734, 'quantised', 'odometer', 2, 'rad',
      on('odometer', quantised, 2.0)),
    R('trolley', 'doppler_stuck', 735, 'frozen', 'doppler', 5, 's', on('doppler', frozen, 62, 5)),
    R('trolley', 'loaded', 736, 'parameter', 'A, B', 60, 'kg, declared 40',
      physics={'mass': 60.0}),
    R('trolley', 'push_in_pounds', 739, 'units', 'input', 0.2248089, 'lbf by N',
      on('input', scaled, 0.2248089), alike='parameter B'),

    R('yacht', 'declination', 741, 'bias', 'compass', 8 * DEGREE, 'rad',
      on('compass', shifted, 8 * DEGREE), alike='mounting of compass; mounting of gnss'),
    R('yacht', 'keel_up', 743, 'parameter', 'leeway', 2.5, 's, declared 1.5',
      physics={'leeway': 2.5}, alike='scale of input'),
    R('yacht', 'rig_zero', 747, 'bias', 'input', 0.15, 'm/s^2 ahead',
      on('input', shifted, 0.15, **_FIRST)),
    R('yacht', 'antenna_ahead', 748, 'lever arm', 'gnss', 4, 'm forward, declared 0',
      physics={'masthead': 4.0}),
    R('yacht', 'gnss_jumps', 749, 'outliers', 'gnss', 6, 'm, 4 % of all',
      on('gnss', outlying, 0.04, 6)),
    R('yacht', 'gyro_upside_down', 750, 'sign', 'gyro', -1, '', on('gyro', scaled, -1, **_TURN),
      alike='mounting'),
    R('yacht', 'iron', 751, 'hard iron', 'compass', 0.15, 'rad', on('compass', magnetised, 0.15)),

    R('parafoil', 'barometer_feet', 752, 'units', 'barometer', 3.28084, 'ft/m',
      on('barometer', scaled, 3.28084)),
    R('parafoil', 'barometer_drifts', 753, 'drift', 'barometer', 0.6, 'm/s',
      on('barometer', drifting, 0.6), alike='parameter glide'),
    R('parafoil', 'heavy', 754, 'parameter', 'airspeed', 12.5, 'm/s, declared 11',
      physics={'airspeed': 12.5}),
    R('parafoil', 'slack_line', 755, 'parameter', 'response', 0.4, 'rad/s, declared 0.5',
      physics={'response': 0.4}),
    R('parafoil', 'gyro_shaken', 757, 'noise', 'gyro', 2, '', on('gyro', noisy, 2)),
    R('parafoil', 'barometer_freezes', 760, 'frozen', 'barometer', 5, 's',
      on('barometer', frozen, 50, 5)),
    R('parafoil', 'gnss_coloured', 761, 'coloured noise', 'gnss', 5, 's',
      on('gnss', coloured, 5)),

    R('horse', 'gnss_covariance', 762, 'noise', 'gnss', 2.5, '', on('gnss', declared_noise, 2.5)),
    R('horse', 'velocity_knots', 763, 'units', 'velocity', 1.943844, 'knots by m/s',
      on('velocity', scaled, 1.943844)),
    R('horse', 'velocity_north_first', 764, 'axes', 'velocity', 0, 'east and north swapped',
      on('velocity', swapped)),
    R('horse', 'velocity_south', 765, 'sign', 'velocity v_y', -1, '',
      on('velocity', scaled, -1, **_SECOND)),
    R('horse', 'mast_moved', 766, 'parameter', 'positions masts.positions', 305,
      'm along x, declared 300',
      physics={'mast': 305.0}),
    R('horse', 'radio_delay', 767, 'bias', 'masts', 2, 'm', on('masts', shifted, 2),
      alike='parameter of range_offset masts.range_offset'),
    R('horse', 'masts_clock', 768, 'clock offset', 'masts', -1, 's', on('masts', misdated, -1)),
    R('horse', 'barn', 769, 'outliers', 'masts range_2', 4, 'm, clusters of 6 s',
      on('masts', displaced, (30, 74, 121, 160), 6, (0, 4))),
    R('horse', 'lazy', 770, 'process noise', 'acceleration_noise', 25,
      'of the variance that is declared',
      edits={'acceleration_noise: 0.05': 'acceleration_noise: 0.002'}),

    R('elbow', 'tool', 772, 'parameter', 'mass', 4.5, 'kg, declared 3.5', physics={'mass': 4.5}),
    R('elbow', 'play', 774, 'backlash', 'joint', 0.02, 'rad to each side',
      physics={'play': 0.02}, alike='backlash of motor'),
    R('elbow', 'motor_degrees', 775, 'units', 'motor', 57.29578, 'deg/rad',
      on('motor', scaled, 57.29578)),
    R('elbow', 'joint_zero', 776, 'bias', 'joint', 0.03, 'rad', on('joint', shifted, 0.03)),
    R('elbow', 'gyro_turned', 777, 'mounting', 'gyro', 30, 'deg about x',
      on('gyro', mounted, 0, 30), alike='scale of gyro'),
    R('elbow', 'torque_constant', 779, 'scale', 'input', 1.15, '', on('input', scaled, 1.15)),
    R('elbow', 'motor_batched', 782, 'stamps', 'motor', 8, 'messages within 8 ms',
      on('motor', batched, 8, 1e-3)),
    R('elbow', 'all_noise', 783, 'noise', 'all', 1.8, '', all_noisy(1.8)),

    R('ram', 'overlap', 784, 'dead zone', 'input', 0.06, 'of the opening',
      physics={'overlap': 0.06}),
    R('ram', 'one_side', 785, 'asymmetry', 'input', 0.8, 'backwards', physics={'back': 0.8}),
    R('ram', 'valve_late', 786, 'input delay', 'input', 0.02, 's', on('input', early, 0.02)),
    R('ram', 'pressure_bar', 787, 'units', 'pressure', 1e-5, 'bar by Pa',
      on('pressure', scaled, 1e-5)),
    R('ram', 'pressure_filter', 788, 'lag', 'pressure', 0.04, 's',
      on('pressure', lagging, 0.04), alike='delay'),
    R('ram', 'rod_leans', 790, 'bias', 'rod', 0.4, 'm/s^2',
      on('rod', shifted, 0.4, columns=slice(3, 4))),
    R('ram', 'rod_limit', 791, 'saturation', 'rod', 4, 'm/s^2', on('rod', limited, 4)),
    R('ram', 'pressure_spikes', 793, 'outliers', 'pressure', 4e5, 'Pa, 2 % of all',
      on('pressure', outlying, 0.02, 4e5)),
    R('ram', 'hum', 823, 'correlated noise', 'pressure rod', 0.8, '',
      shared('pressure', 'rod', 0.8, 0.2 / 3e4)),

    R('orangery', 'probes_swapped', 794, 'axes', 'probes', 0, 'air and soil swapped',
      on('probes', swapped)),
    R('orangery', 'leaves_kelvin', 795, 'bias', 'leaves', 273.15, 'K',
      on('leaves', shifted, 273.15)),
    R('orangery', 'vent_open', 796, 'parameter', 'A, B', 0.016, '1/s, declared 0.01',
      physics={'loss': 0.016}),
    R('orangery', 'heater_weak', 797, 'scale', 'input', 1.25, 'of the heat',
      on('input', scaled, 1.25, **_FIRST), alike='parameter B'),
    R('orangery', 'leaves_in_smoke', 798, 'disturbed', 'leaves', 3, 'degC for 80 s',
      on('leaves', disturbed, 260, 80, 3)),
    R('orangery', 'soil_drifts', 799, 'drift', 'probes soil', 0.006, 'degC/s',
      on('probes', drifting, 0.006, **_SECOND)),
    R('orangery', 'leaves_step', 800, 'bias step', 'leaves', 1.2, 'degC from 330 s on',
      on('leaves', shifted_from, 330, 1.2)),
    R('orangery', 'heat_late', 801, 'input delay', 'input', 20, 's', on('input', early, 20)),

    R('telescope', 'stars_rolled', 803, 'mounting', 'stars', 2, 'deg about z',
      on('stars', tilted, 2)),
    R('telescope', 'stars_swapped', 804, 'axes', 'stars', 0, 'azimuth and altitude swapped',
      on('stars', swapped)),
    R('telescope', 'stars_late', 805, 'delay', 'stars', 0.05, 's', on('stars', late, 0.05)),
    R('telescope', 'azimuth_gear', 806, 'scale', 'encoders azimuth', 1.02, '',
      on('encoders', scaled, 1.02, **_FIRST)),
    R('telescope', 'camera_added', 809, 'parameter', 'A, B', 14,
      'kg m^2 of the altitude, declared 10',
      physics={'inertia': 14.0}),
    R('telescope', 'clouds', 810, 'losses', 'stars', 6, 's, thrice',
      on('stars', interrupted, (12, 27, 45), 6)),
    R('telescope', 'stars_clock', 811, 'clock drift', 'stars', 0.002, 's/s',
      on('stars', fast_clock, 0.002)),
    R('telescope', 'gyro_walks', 812, 'random walk', 'gyro', 0.004, 'rad/s/sqrt(s)',
      on('gyro', wandering, 0.004, **_TURN)),

    R('mixer', 'clogged', 813, 'parameter', 'outlet flow.outlet', 0.0125,
      'm^2.5/s, declared 0.015',
      physics={'outlet': 0.0125}),
    R('mixer', 'weak_brine', 814, 'parameter', 'strength', 7.5, 'g/l, declared 10',
      physics={'brine': 7.5}, alike='scale of probe'),
    R('mixer', 'foam', 817, 'outliers', 'level', 0.06, 'm, clusters of 8 s',
      on('level', displaced, (40, 120, 190, 251), 8, (0.06,))),
    R('mixer', 'probe_slow', 819, 'lag', 'probe', 15, 's', on('probe', lagging, 15),
      alike='delay'),
    R('mixer', 'pumps_swapped', 820, 'axes', 'input', 0, 'brine and water swapped',
      on('input', exchanged, 0, 1)),
    R('mixer', 'interference', 821, 'disturbed', 'flow', 4, 'of the noise for 40 s',
      on('flow', shaken, 150, 40, 4)),
)
