# SPDX-License-Identifier: Apache-2.0
"""Process noise and first belief, from the 15 states of robot_localization."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.core import rotations as so3

from .their_file import TheirNode
from .their_sensors import Sensors

#: Indices into their 15 states of our process noises, in the plane (True) and in space.
_PROCESS: Mapping[bool, Mapping[str, Any]] = {
    True: {
        'position_noise': (0, 1), 'heading_noise': 5, 'velocity_noise': (6, 7), 'turn_noise': 11,
        'acceleration_noise': (12, 13),
    },
    False: {
        'position_noise': (0, 1, 2), 'orientation_noise': (3, 4, 5), 'velocity_noise': (6, 7, 8),
        'turn_noise': (9, 10, 11), 'acceleration_noise': (12, 13, 14),
    },
}  # fmt: skip
_PLANAR = [0, 1, 5, 6, 7, 11, 12, 13]
_STATES, _YAW = 15, 5
#: Their process noise where a file has none: the diagonal that FilterBase::reset() sets.
_PROCESS_NOISE = (
    0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015,
)  # fmt: skip
#: Standard deviations of an initial belief; robot_localization's is the root of 1e-9, and
#: overwritten by the first measurement.
_KNOWN, _UNKNOWN = 1e-9**0.5, 1.0
#: Standard deviation, in m, of a first position that poses in a frame of the world will give.
_ANYWHERE = 1e3
_DEFAULT = 'the default of robot_localization in model_parameters'


def noise_and_first_belief(
    node: TheirNode, parameters: dict[str, Any], sensors: Sensors, *, planar: bool
) -> None:
    """Set the process noise and the initial belief.

    Without an initial covariance, a pose that nothing measures starts at the origin, and all else
    is unknown. A heading is unknown as well if only positions in a map show it.
    """
    density = _diagonal(node, 'process_noise_covariance', 'model_parameters')
    if density is None:
        density = np.array(_PROCESS_NOISE)
        if 'process_noise_covariance' not in node.values:
            node.add('process_noise_covariance', f'not given: {_DEFAULT}')
    for name, which in _PROCESS[planar].items():
        parameters[f'model_parameters.{name}'] = density[np.array(which)].tolist()
    chosen = _PLANAR if planar else [*range(_STATES)]
    variance = _diagonal(node, 'initial_estimate_covariance', 'initial_std, its root')
    if variance is None:
        used = [sensor for sensor in sensors.values() if sensor.get('pose') != 'differential']
        read = ' '.join(field for sensor in used for field in sensor['fields'])
        place = _UNKNOWN if 'position' in read or 'east' in read else _KNOWN
        if any('pose' not in sensor and 'position' in str(sensor['fields']) for sensor in used):
            place = _ANYWHERE
        known = place, _UNKNOWN if 'orientation' in read else _KNOWN, _UNKNOWN
        std = np.repeat(known, (3, 3, 9))
        if _shows_heading(sensors):
            std[_YAW] = np.pi
            parameters.setdefault('filter', 'gaussian_sum')
    else:
        std = np.sqrt(variance)
    parameters['initial_std'] = std[chosen].tolist()
    # theirs is at zero, and the first reading replaces what it measures
    x = np.array(node.numbers('initial_state', (_STATES,)) or [0.0] * _STATES)
    if not planar:
        x[3:6] = so3.from_euler(x[3:6])
    parameters['initial_estimate'] = x[chosen].tolist()
    parameters['initialize'] = 'reading'
    node.note('initial_state', 'initial_estimate')


def _shows_heading(sensors: Sensors) -> bool:
    """Return whether positions are absolute, and no heading is read."""
    absolute = [sensor['fields'] for sensor in sensors.values() if 'pose' not in sensor]
    read = ' '.join(field for fields in absolute for field in fields)
    turned = 'orientation.yaw' in read or 'orientation.rz' in read
    return ('position.x' in read or 'east' in read) and not turned


def _diagonal(node: TheirNode, name: str, ours: str) -> Array | None:
    """Return the diagonal of a matrix of 15 states, from its 225 entries or from the 15."""
    entries = node.numbers(name, (_STATES, _STATES**2))
    if entries is None:
        return None
    numbers = np.array(entries)
    whole = numbers.size > _STATES
    diagonal = numbers[:: _STATES + 1] if whole else numbers
    if not np.isfinite(numbers).all() or (diagonal < 0.0).any():
        node.leave_out(name, 'expected finite variances')
        return None
    rest = numbers.reshape(_STATES, _STATES) - np.diag(diagonal) if whole else np.zeros(1)
    lost = ', its diagonal: the rest is not carried over' if rest.any() else ''
    node.note(name, f'{ours}{lost}', carried=not lost)
    return diagonal
