# SPDX-License-Identifier: Apache-2.0
"""A satellite receiver that is read without navsat_transform."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .their_file import TheirNode


def receiver(
    node: TheirNode,
    name: str,
    made: Mapping[str, Mapping[str, Any]],
    navigation: TheirNode,
    parameters: dict[str, Any],
) -> dict[str, dict[str, Any]]:
    """Return a sensor of the fixes, in place of the sensors of navsat_transform's output."""
    position = next((sensor for key, sensor in made.items() if key.endswith('_position')), None)
    if position is None:
        return {key: dict(sensor) for key, sensor in made.items()}
    # of a change of the pose the measures are those of the velocity
    read = [field[-1] for field in position['fields']]
    axes = [axis for axis in read if axis != 'z' or not _flat_ground(navigation)]
    fields = [{'x': 'east', 'y': 'north', 'z': 'up'}[axis] for axis in axes]
    number = len(axes)
    node.note(
        name,
        f'sensor {name}_fix: the fixes on gps/fix, without navsat_transform; where the antenna is '
        f'off the centre, add {name}_fix.mount.tf: true, or its mount.translation',
    )
    changed = {f'{name}_{word}' for word in ('differential', 'relative', 'config')}
    node.rows[:] = [
        row for row in node.rows if row.name not in changed | {name} or '_fix:' in row.what
    ]
    others = [key.removeprefix(f'{name}_') for key in made if not key.endswith('_position')]
    lost = f'; not in a fix: {", ".join(others)}' if others else ''
    node.note(f'{name}_config', f'{name}_fix{lost}', carried=not lost)
    for word in ('differential', 'relative'):
        wanted = node.value(f'{name}_{word}', False)
        why = 'fixes are read as positions' if wanted else 'false'
        node.note(f'{name}_{word}', why, carried=not wanted)
    # in ROS 1 the names of two frames follow
    numbers = navigation.numbers('datum', (2, 3), words=True)
    if numbers is not None and not navigation.value('wait_for_datum', False):
        navigation.note('datum', 'not used: wait_for_datum is false, there as well')
    elif numbers is not None:
        parameters['datum'] = [numbers[0], numbers[1], 0.0]
        turned = len(numbers) > 2 and numbers[2] != 0.0
        what = "; its heading is lost: write the state's in initial_estimate" if turned else ''
        navigation.note('datum', f'datum, with an altitude of 0{what}', carried=not turned)
    parameters['publish_fix'] = navigation.value('publish_filtered_gps', True)
    for key, outcome in _NAVIGATION.items():
        navigation.note(key, outcome)
    return {
        f'{name}_fix': {
            **{key: value for key, value in position.items() if key == 'gate'},
            'kind': 'states', 'measures': axes, 'topic': 'gps/fix',
            'type': 'sensor_msgs/NavSatFix', 'fields': fields, 'noise': [2.0] * number,
        },
    }  # fmt: skip


def turn_headings(sensors: Mapping[str, dict[str, Any]], navigation: TheirNode) -> None:
    """Add declination and offset, which navsat_transform adds to an IMU's heading, to that.

    There the fixes are turned into the map of the IMU; here the map is east and north.
    """
    total = sum(navigation.value(key, 0.0) for key in _TURNS)
    headings = [
        name
        for name, sensor in sensors.items()
        if sensor['type'] == 'sensor_msgs/Imu'
        and 'pose' not in sensor
        and any(field in ('orientation.yaw', 'orientation.rz') for field in sensor['fields'])
    ]
    for name in headings if total else ():
        sensors[name]['mount.heading'] = total
    listed = ', '.join(f'{name}.mount.heading' for name in headings)
    for key in _TURNS:
        off = navigation.value(key, 0.0) == 0.0
        what = f'{listed}: {total:g}' if headings else _UNREAD
        known = off or bool(headings)
        navigation.note(key, 'zero: nothing to do' if off else what, carried=known)


def _flat_ground(navigation: TheirNode) -> bool:
    return bool(navigation.value('zero_altitude', False))


_UNREAD = (
    'no heading of an IMU is read: the first one is initial_estimate, in a map that is east and '
    'north; read the yaw of an IMU, or widen its initial_std'
)
_TURNS = 'magnetic_declination_radians', 'yaw_offset'
_NAVIGATION = {
    'frequency': 'not needed: there is no second node',
    'delay': 'not needed: there is no second node',
    'wait_for_datum': 'whether datum counts; without one the first good fix is it',
    'zero_altitude': 'up is no field where it is true, or z is not used',
    'publish_filtered_gps': 'publish_fix, true by default',
    'use_odometry_yaw': 'not needed: the heading is a state',
    'broadcast_utm_transform': 'not needed: there is no UTM zone',
    'broadcast_cartesian_transform': 'not needed: estimate/datum is the origin',
    'broadcast_utm_transform_as_parent_frame': 'not needed: there is no UTM zone',
    'broadcast_cartesian_transform_as_parent_frame': 'not needed: estimate/datum is the origin',
    'use_local_cartesian': 'not needed: the plane is always the local one',
    'use_sim_time': 'not needed: there is no second node',
    'transform_timeout': 'not needed: declare mount of the receiver',
}
