# SPDX-License-Identifier: Apache-2.0
"""Parameters of our estimator from those of a filter of robot_localization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .their_file import SENSOR, Row, TheirNode
from .their_noise import noise_and_first_belief
from .their_receiver import receiver, turn_headings
from .their_sensors import Sensors, leave_out_sensor, sensors_of

#: Parameters without a counterpart that need none, with the reason.
_NOT_NEEDED = {
    'sensor_timeout': 'not needed: the estimate is predicted at publish_rate',
    'transform_timeout': 'not needed: transforms of sensors are those on /tf_static',
    'print_diagnostics': 'not needed: /diagnostics always says what was fused, and why not',
    'predict_to_current_time': 'not needed: with publish_rate it always is',
    'reset_on_time_jump': 'not needed: a clock that goes back restarts the estimator',
    'smooth_lagged_data': 'not needed: late readings are always fused at their stamps',
    'stamped_control': 'not needed without use_control',
    'control_timeout': 'not needed without use_control',
    'control_config': 'not needed without use_control',
    'tf_prefix': 'not needed if it is empty: write the frames with it',
}
#: Parameters that are not carried over, with the reason or what to do instead.
_NOT_CARRIED = {
    'debug': 'there is no such file; record the topics, and replay them',
    'debug_out_file': 'there is no such file; record the topics, and replay them',
    'permit_corrected_publication': 'estimates are published as they are at the time',
    'base_link_frame_output': 'the estimate is that of child_frame',
    'disabled_at_startup': 'start with autostart: false, and configure on ~/change_state',
    'acceleration_gains': 'the lag command_time limits the acceleration',
    'deceleration_gains': 'the lag command_time limits the acceleration',
}
#: Parameters of their ukf_node only.
_UNSCENTED = {'alpha', 'beta', 'kappa'}
#: Limits of accelerations by commands, of six axes, of which three are in the plane.
_LIMITS = 'acceleration_limits', 'deceleration_limits'
_AXES, _PLANAR_AXES = 6, [0, 1, 5]
_COMMANDS = 'cmd_vel is the input; where it stays out it is 0, theirs then has none'
#: Their topic of the odometry, and those of two filters in the launch file of their example.
FIXES = 'gps/filtered'
ODOMETRY, LOCAL, GLOBAL = 'odometry/filtered', 'odometry/local', 'odometry/global'
#: Values without the parameter: those of robot_localization's own file of defaults.
_FREQUENCY, _RATE = 30.0, 100.0
_CONTROL_TIMEOUT = 0.2
#: Rates in Hz of satellite receivers and of other sensors, as most have them.
_FIXES, _READINGS = 5.0, 50.0
_GPS = 'odometry/gps'
_UNREAD = f'not used: no filter in this file reads {_GPS}; where a remap leads to it, write that'
_NO_NAVIGATION = (
    'it takes navsat_transform, whose parameters are not in this file: append them, and the fixes '
    'are read without it'
)


@dataclass(frozen=True)
class Translation:
    """Parameters of our estimator, and the outcome of theirs."""

    node: TheirNode
    values: dict[str, Any]
    #: Their topics by ours, where no other filter has these.
    remaps: dict[str, str] = field(default_factory=dict)

    @property
    def odometry(self) -> str:
        """Our topic of the odometry of a filter."""
        return f'{self.values.get("state.topic", "estimate")}/odometry'

    @property
    def name(self) -> str:
        """The name of the node."""
        return self.node.name

    @property
    def namespace(self) -> str:
        """The namespace of the node."""
        return self.node.namespace

    @property
    def rows(self) -> Sequence[Row]:
        """Outcomes of the parameters of the node."""
        return self.node.rows

    @property
    def title(self) -> str:
        """The name with its namespace."""
        return f'{self.namespace}/{self.name}' if self.namespace else self.name


def translated(nodes: Sequence[TheirNode]) -> list[Translation]:
    """Return our parameters for each filter among the nodes of a file.

    Raises
    ------
    ValueError
        If a parameter has another type or size; the message names the line.
    """
    spaces = dict.fromkeys(node.namespace for node in nodes)
    return [
        translation
        for space in spaces
        for translation in _translated([node for node in nodes if node.namespace == space])
    ]


def _translated(nodes: Sequence[TheirNode]) -> list[Translation]:
    """Translate the nodes of one namespace, which work together."""
    navigation = next((node for node in nodes if node.navigates), None)
    filters = [node for node in nodes if node.filters]
    several = len(filters) > 1
    translations = []
    for node in filters:
        values = _filter(node, navigation)
        values['publish_odometry'] = True
        if several:
            values['state.topic'] = f'{node.name}/estimate'
        if values['publish_tf'] and _is_global(node):
            values['odom_frame'] = node.value('odom_frame', 'odom').lstrip('/')
        for name in node.unaccounted:
            node.note(name, 'unknown to this program', carried=False)
        translations.append(Translation(node, values))
        if values.get('publish_fix'):
            translations[-1].remaps[f'{values.get("state.topic", "estimate")}/fix'] = FIXES
    _name_topics(translations)
    for node in nodes:
        if not node.filters:
            read = any(
                name.endswith('_fix.topic')
                for translation in translations
                for name in translation.values
            )
            outcome = 'unknown to this program' if node.navigates and read else _UNREAD
            for name in node.unaccounted:
                node.note(name, outcome, carried=False)
            translations.append(Translation(node, {}))
    return translations


def _name_topics(filters: Sequence[Translation]) -> None:
    """Add the remaps to their topics.

    Of two they are those of the launch file of their example: one in the frame of the odometry,
    and one in that of a map.
    """
    if len(filters) == 1:
        (alone,) = filters
        alone.remaps[alone.odometry] = ODOMETRY
        return
    kinds = [_is_global(translation.node) for translation in filters]
    if sorted(kinds) != [False, True]:
        return
    other, local = filters[kinds.index(True)], filters[kinds.index(False)]
    local.remaps[local.odometry] = LOCAL
    other.remaps[other.odometry] = GLOBAL


def _is_global(node: TheirNode) -> bool:
    odom = node.value('odom_frame', 'odom')
    return bool(node.value('world_frame', odom).lstrip('/') != odom.lstrip('/'))


def _missing_before(node: TheirNode, kind: str, number: str) -> str:
    """Return the sensor that would have to precede one of a kind; '' if all are there."""
    before = (f'{kind}{k}' for k in range(int(number)))
    return next((name for name in before if name not in node.values), '')


def _filter(node: TheirNode, navigation: TheirNode | None) -> dict[str, Any]:
    """Return our parameters for a filter, and account for its parameters."""
    planar = node.value('two_d_mode', False)
    parameters: dict[str, Any] = {'model': 'robot_2d' if planar else 'robot_3d', 'rate': _RATE}
    node.note('two_d_mode', f'model: {parameters["model"]}')
    parameters['publish_rate'] = node.value('frequency', _FREQUENCY)
    node.note('frequency', 'publish_rate')
    _frames(node, parameters)
    if not _UNSCENTED.isdisjoint(node.values):
        parameters['filter'] = 'ukf'
    for name in _UNSCENTED:
        node.note(name, 'filter: ukf, with sigma points of ours, none of negative weight')
    sensors: Sensors = {}
    for name in sorted(filter(SENSOR.fullmatch, node.values)):
        kind = SENSOR.fullmatch(name)
        assert kind is not None
        missing = _missing_before(node, kind[1], kind[2])
        if missing:
            leave_out_sensor(node, name, f'there is no {missing}, behind which none is read')
            continue
        made = sensors_of(node, name, kind[1], planar=planar)
        if node.value(name, '').endswith(_GPS):
            if navigation is None:
                node.note(name, _NO_NAVIGATION, carried=False)
            else:
                made = receiver(node, name, made, navigation, parameters)
        sensors.update(made)
    if navigation is not None and any(name.endswith('_fix') for name in sensors):
        turn_headings(sensors, navigation)
    if not sensors:
        whys = [
            f'line {row.line}: {row.name}: {row.what}'
            for row in node.rows
            if row.name in node.unusable and SENSOR.fullmatch(row.name)
        ]
        raise ValueError(f'{node.name}: {(*whys, "expected a flag that is true, got none")[0]}')
    parameters['sensors'] = list(sensors)
    for name, values in sensors.items():
        parameters.update({f'{name}.{key}': value for key, value in values.items()})
        parameters[f'{name}.rate'] = _FIXES if name.endswith('_fix') else _READINGS
    noise_and_first_belief(node, parameters, sensors, planar=planar)
    if node.value('dynamic_process_noise_covariance', False):
        parameters['model_parameters.noise_by_speed'] = True
    node.note('dynamic_process_noise_covariance', 'model_parameters.noise_by_speed')
    _window(node, parameters)
    _commands(node, parameters, planar=planar)
    node.note('use_sim_time', 'use_sim_time')
    if 'use_sim_time' in node.values:
        parameters['use_sim_time'] = node.value('use_sim_time', False)
    node.note('gravitational_acceleration', 'mount.gravity of the accelerometers')
    for name in node.unaccounted:
        if name in _NOT_NEEDED:
            node.note(name, _NOT_NEEDED[name])
    acceleration = node.value('publish_acceleration', False)
    why = (
        'the acceleration is in estimate; there is no accel/filtered' if acceleration else 'false'
    )
    node.note('publish_acceleration', why, carried=not acceleration)
    if parameters['publish_tf']:
        node.add('tf_timeout', '1 s without a fused reading ends the transform; theirs goes on')
    for name, why in _NOT_CARRIED.items():
        # a switch that is off is nothing to carry over
        off = name in node.values and node.values[name].value is False
        node.note(name, 'not used' if off else why, carried=off)
    return parameters


def _frames(node: TheirNode, parameters: dict[str, Any]) -> None:
    base, odom = node.value('base_link_frame', 'base_link'), node.value('odom_frame', 'odom')
    world = node.value('world_frame', odom)
    parameters.update(frame=world.lstrip('/'), child_frame=base.lstrip('/'))
    known = {frame.lstrip('/') for frame in (odom, node.value('map_frame', 'map'), base, '')}
    nowhere = world.lstrip('/') not in known
    parameters['publish_tf'] = node.value('publish_tf', True) and not nowhere
    if nowhere:
        node.add('publish_tf', 'false: world_frame is neither map_frame nor odom_frame')
    parameters['tf_time_offset'] = node.value('transform_time_offset', 0.0)
    node.note('transform_time_offset', 'tf_time_offset')
    node.note('publish_tf', 'publish_tf', carried=not nowhere)
    node.note('base_link_frame', 'child_frame')
    node.note('world_frame', 'frame')
    node.note('map_frame', 'frame, where it is world_frame')
    used = 'odom_frame' if parameters['publish_tf'] and _is_global(node) else 'frame'
    node.note('odom_frame', f'{used}, where it is world_frame' if used == 'frame' else used)


def _commands(node: TheirNode, parameters: dict[str, Any], *, planar: bool) -> None:
    """Use the commands as input of the planar model; the other model has no input."""
    control = node.value('use_control', False)
    if not control or not planar:
        why = 'robot_3d has no input; robot_2d has (two_d_mode)' if control else 'not used'
        node.note('use_control', why, carried=not control)
        for name in _LIMITS:
            node.note(name, why, carried=not control)
        return
    lag = node.value('control_timeout', _CONTROL_TIMEOUT)
    if lag < 0.0:
        node.leave_out('control_timeout', f'expected 0 or more, got {lag:g}')
        lag = _CONTROL_TIMEOUT
    lag = max(lag, 1e-3)
    parameters['model_parameters.command_time'] = parameters['input_timeout'] = lag
    node.note('use_control', f'model_parameters.command_time: {_COMMANDS}')
    node.note('control_timeout', 'model_parameters.command_time and input_timeout')
    _limits(node, parameters)
    flags = node.values['control_config'].value if 'control_config' in node.values else None
    used = isinstance(flags, list) and len(flags) == 6 and flags[0] and flags[1] and flags[5]
    all_used = 'commands of forward, sideways and turn are all used'
    node.note('control_config', all_used, carried=bool(used))
    if node.value('stamped_control', False):
        fields = [f'twist.{field}' for field in ('linear.x', 'linear.y', 'angular.z')]
        parameters.update({'input.type': 'geometry_msgs/TwistStamped', 'input.fields': fields})
    node.note('stamped_control', 'input.type')


def _limits(node: TheirNode, parameters: dict[str, Any]) -> None:
    """Limit the acceleration by commands; a robot that brakes harder has the larger of both."""
    given = [node.numbers(name, (_AXES,)) for name in _LIMITS]
    known = [np.array(numbers)[_PLANAR_AXES] for numbers in given if numbers is not None]
    if not known:
        return
    largest = np.max(known, axis=0)
    # 0 stands where a robot has no such command, as that to the left of most
    largest[largest <= 0.0] = np.inf
    if np.isinf(largest).all():
        for name in _LIMITS:
            node.leave_out(name, 'expected a positive number forward, left or about z')
        return
    parameters['model_parameters.acceleration_limits'] = largest.tolist()
    both = len(known) == 2 and bool(np.any(known[0] != known[1]))
    lost = ', the larger of both' if both else ''
    for name in _LIMITS:
        node.note(name, f'model_parameters.acceleration_limits{lost}', carried=not both)


def _window(node: TheirNode, parameters: dict[str, Any]) -> None:
    if node.value('smooth_lagged_data', False):
        parameters['window'] = node.value('history_length', 1.0)
        node.note('history_length', 'window')
    else:
        node.note('history_length', 'not needed: late readings are fused within window')
