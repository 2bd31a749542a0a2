# SPDX-License-Identifier: Apache-2.0
"""Sensors from the 15 flags of robot_localization: one for each part of a message."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from scipy.stats import chi2

from .their_file import TheirNode, in_ros

TYPES = {
    'odom': 'nav_msgs/Odometry',
    'pose': 'geometry_msgs/PoseWithCovarianceStamped',
    'twist': 'geometry_msgs/TwistWithCovarianceStamped',
    'imu': 'sensor_msgs/Imu',
}
#: The flags of x, y, z, of the angles, and of their rates and accelerations.
_FLAGS = (
    'x', 'y', 'z', 'roll', 'pitch', 'yaw', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz', 'ax', 'ay', 'az',
)  # fmt: skip
_PLANAR = {'x', 'y', 'yaw', 'vx', 'vy', 'wz', 'ax', 'ay'}
_ANGLES = ('roll', 'pitch', 'yaw')
#: Noise where a message has no covariance: m, rad, m/s, rad/s, m/s^2.
_NOISE = (0.5,) * 3 + (0.05,) * 3 + (0.1,) * 3 + (0.05,) * 3 + (0.5,) * 3
#: The lowest probability of a gate, and the one below which a gate rejects more than is usual.
_LEAST, _USUAL = 0.5, 0.95
_REJECTION = 'rejection_threshold'
#: The longest topic, of the 255 letters that ROS 2 takes, with room for a namespace.
_LONGEST = 200
GRAVITY = 9.80665


class Part(NamedTuple):
    """A part of a message: its flags, the path of each, and the name of its threshold."""

    name: str
    flags: Sequence[str]
    path: str
    threshold: str

    @property
    def of_the_body(self) -> bool:
        """Whether it is in the frame of the sensor; a pose is in that of the world."""
        return not self.path.startswith('pose.')


def _parts(kind: str) -> list[Part]:
    """Return the parts of a message; rejection is decided for each part."""
    place, turn, speed, rate, force = (_FLAGS[i : i + 3] for i in range(0, 15, 3))
    pose, twist = 'pose_rejection_threshold', 'twist_rejection_threshold'
    if kind == 'imu':
        return [
            Part('orientation', turn, 'orientation.{}', pose),
            Part('rate', rate, 'angular_velocity.{}', twist),
            Part(
                'acceleration',
                force,
                'linear_acceleration.{}',
                'linear_acceleration_rejection_threshold',
            ),
        ]
    poses = [
        Part('position', place, 'pose.pose.position.{}', pose),
        Part('orientation', turn, 'pose.pose.orientation.{}', pose),
    ]
    twists = [
        Part('velocity', speed, 'twist.twist.linear.{}', twist),
        Part('rate', rate, 'twist.twist.angular.{}', twist),
    ]
    return {'odom': [*poses, *twists], 'pose': poses, 'twist': twists}[kind]


def _topic(node: TheirNode, name: str) -> str:
    """Return the topic of a sensor, with what ROS refuses in a name replaced."""
    topic = str(node.value(name, ''))
    head, tail = ('~', topic[1:]) if topic.startswith('~') else ('', topic)
    usable = [in_ros(part) for part in tail.split('/') if part]
    first = '/' if head or tail.startswith('/') else ''
    mended = head + first + '/'.join(usable)
    if not usable or not re.search('[A-Za-z0-9]', mended):
        raise ValueError(f"expected the name of a topic, got '{topic}'")
    if len(mended) > _LONGEST:
        raise ValueError(f'expected a topic of {_LONGEST} letters or fewer, got {len(mended)}')
    if mended != topic:
        node.note(name, f"topic {mended}: '{topic}' is no name in ROS 2", carried=False)
    return mended


def _flags(node: TheirNode, name: str) -> list[str]:
    key = f'{name}_config'
    if key not in node.values:
        raise ValueError(f'{key}: expected 15 flags, got none')
    value, _ = node.values[key]
    flags = [flag for flag in value if isinstance(flag, bool)] if isinstance(value, list) else []
    if value != flags or len(flags) != len(_FLAGS):
        got = f'{len(flags)} of {len(value)}' if isinstance(value, list) else 'no list'
        raise ValueError(f'{key}: expected 15 times true or false, got {got}')
    return [name for name, flag in zip(_FLAGS, value) if flag]


#: Values of sensors by their names.
Sensors = dict[str, dict[str, Any]]


def sensors_of(node: TheirNode, name: str, kind: str, *, planar: bool) -> Sensors:
    """Return our sensors for one sensor of theirs, and account for its parameters.

    A sensor with a value without which there is none is left out.
    """
    try:
        topic, flags = _topic(node, name), _flags(node, name)
    except ValueError as error:
        leave_out_sensor(node, name, str(error))
        return {}
    sensors: Sensors = {}
    used: list[str] = []
    for part in _parts(kind):
        chosen = [flag for flag in part.flags if flag in flags]
        used += chosen
        chosen = [flag for flag in chosen if not planar or flag in _PLANAR]
        if not chosen:
            continue
        pose = _pose(node, name) if part.name in ('position', 'orientation') else ''
        ours = f'{name}_{part.name}'
        sensors[ours] = {
            **_reading(part, chosen, planar=planar, pose=pose),
            'topic': topic,
            'type': TYPES[kind],
            **({'mount.tf': True} if part.of_the_body else {}),
            **_gate(node, name, part, len(chosen), ours),
        }
        if part.name == 'acceleration' and not planar:
            removes = node.value(f'{name}_remove_gravitational_acceleration', False)
            gravity = node.value('gravitational_acceleration', GRAVITY)
            sensors[ours]['mount.gravity'] = gravity if removes else 0.0
    left = [flag for flag in flags if flag not in used]
    flat = [flag for flag in used if planar and flag not in _PLANAR]
    _account(node, name, [*sensors], left, flat, planar=planar)
    return sensors


def leave_out_sensor(node: TheirNode, name: str, why: str) -> None:
    """Leave out a sensor with all its parameters."""
    node.leave_out(name, why)
    for key in node.unaccounted:
        if key.startswith(f'{name}_'):
            node.leave_out(key, f'its sensor {name} is')


def _pose(node: TheirNode, name: str) -> str:
    """Return how a pose is used; both packages have the same words for it."""
    words = ('differential', 'relative')
    return next((word for word in words if node.value(f'{name}_{word}', False)), '')


def _reading(part: Part, chosen: Sequence[str], *, planar: bool, pose: str) -> dict[str, Any]:
    axes = {flag: flag if flag in _ANGLES else flag[-1] for flag in chosen}
    values: dict[str, Any] = {'kind': 'states', 'measures': list(chosen)}
    if pose:
        values['pose'] = pose
    if pose == 'differential':
        values['measures'] = [_FLAGS[_FLAGS.index(flag) + 6] for flag in chosen]
    elif part.name == 'orientation' and not planar:
        if len(chosen) == 3:
            axes = dict(zip(chosen, ('rx', 'ry', 'rz')))
            values['measures'] = [*axes.values()]
        else:
            values.update(kind='euler', measures=['rx', 'ry', 'rz'], angles=list(chosen))
    values['fields'] = [part.path.format(axis) for axis in axes.values()]
    values['noise'] = [_NOISE[_FLAGS.index(flag)] for flag in chosen]
    return values


def _gate(node: TheirNode, name: str, part: Part, size: int, ours: str) -> dict[str, float]:
    """Return the gate: a Mahalanobis distance as a probability, for ``size`` numbers."""
    for key in (f'{name}_{part.threshold}', f'{name}_{_REJECTION}'):
        if key in node.values:
            distance = node.value(key, 0.0)
            if not distance > 0.0:
                expected = 'expected a distance above 0'
                node.leave_out(key, f'{expected}, got {distance:g}')
                return {}
            probability = float(chi2.cdf(distance * distance, size))
            gate = min(max(_LEAST, probability), 1.0)
            low = ', the lowest' if probability < _LEAST else ''
            lost = f'; it rejects {1.0 - gate:.0%} of good readings' if gate < _USUAL else ''
            node.note(key, f'{ours}.gate: {gate:.3g}{low}{lost}')
            return {'gate': gate}
    return {}


def _account(
    node: TheirNode, name: str, ours: list[str], left: list[str], flat: list[str], *, planar: bool
) -> None:
    """Account for the parameters of a sensor."""
    outcome = f'sensors {", ".join(ours)}' if ours else 'none of its flags can be used'
    node.note(name, outcome, carried=bool(ours))
    notes = []
    if left:
        notes.append(f'{", ".join(left)}: not in such a message')
    if flat:
        notes.append(f'{", ".join(flat)}: not in the plane')
    node.note(f'{name}_config', '; '.join([', '.join(ours), *notes]) if ours else '; '.join(notes))
    key = f'{name}_remove_gravitational_acceleration'
    pulled = any(sensor.endswith('_acceleration') for sensor in ours)
    if pulled and planar and node.value(key, False):
        node.note(key, 'in the plane a tilt reads as an acceleration', carried=False)
    else:
        gravity = 'mount.gravity: by the attitude of the state'
        node.note(key, gravity if pulled and not planar else 'nothing to do')
    poses = [sensor for sensor in ours if sensor.endswith(('_position', '_orientation'))]
    for word in ('differential', 'relative'):
        if not node.value(f'{name}_{word}', False):
            outcome = 'false'
        elif _pose(node, name) != word:
            outcome = f'not needed: {_pose(node, name)} counts'
        else:
            outcome = (
                f'pose: {word}, of {", ".join(poses)}' if poses else 'not needed: no pose is used'
            )
        node.note(f'{name}_{word}', outcome)
    for key in node.unaccounted:
        if key.startswith(f'{name}_') and key.endswith(_REJECTION):
            node.note(key, 'not needed: no such part of its messages is used')
    for word, why in _NOT_NEEDED.items():
        node.note(f'{name}_{word}', why)
    child = f'{name}_pose_use_child_frame'
    wanted = node.value(child, False)
    why = 'declare frame and mount of the sensor instead' if wanted else 'false'
    node.note(child, why, carried=not wanted)


_NOT_NEEDED: Mapping[str, str] = {
    'queue_size': 'not needed: all messages that wait are fused, by their stamps',
    'nodelay': 'not needed: a matter of TCP in ROS 1',
}
