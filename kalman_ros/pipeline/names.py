# SPDX-License-Identifier: Apache-2.0
"""The names of the nodes' parameters beside the scenario; every node accepts them all.

Nodes share one parameter file, so a name of another node is valid, and an unknown name is not.
Only names are listed, so that no node imports the options of another; a test compares them with
the options.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Container, Iterable

from kalman_ros.core import refuse_unknown
from kalman_ros.estimators import FILTERS, filter_options

#: Parameters that a filter of robot_localization has, and a node of this package has not.
_THEIRS = re.compile(r'(odom|pose|twist|imu)\d+(_config)?|two_d_mode|base_link_frame|world_frame')

#: Names of options, by the node or the object that has them.
NAMES = {
    'plant': (
        'actuator_dead_zone actuator_delay actuator_gain actuator_loss autostart child_frame '
        'disturbance_amplitude disturbance_constant disturbance_frequency disturbance_noise '
        'fault_window force_timeout frame idle_input learn_layouts lockstep lockstep_timeout '
        'lockstep_window max_message_size realtime_priority rest_until_input run_until seed '
        'wait_for_estimate'
    ),
    'estimator': (
        'arithmetic autostart child_frame datum_file fixed_lag frame future_tolerance '
        'gate_recover_after idle_input implementation initialize input_timeout learn_layouts '
        'lockstep max_gap max_message_size odom_frame publish_fix publish_odometry publish_rate '
        'publish_tf realtime_priority rest_until_input restart_after tf_time_offset tf_timeout '
        'window'
    ),
    'controller': (
        'autostart enabled estimate_timeout frame future_tolerance heartbeat_timeout idle_input '
        'input_limit input_lower_limit input_rate_limit learn_layouts lockstep max_message_size '
        'max_std path_acceleration path_speed path_tolerance predict_latency realtime_priority '
        'reference_timeout resume solve_timeout transition_time'
    ),
    'monitor': 'autostart confidence learn_layouts max_message_size monitor_window',
    'markers': 'autostart frame learn_layouts marker_rate max_message_size track_length',
    'microphone_array': (
        'autostart band bearing_sensor frame frame_duration largest_std learn_layouts least_odds '
        'lockstep max_message_size microphone_noise microphones recording sample_rate seed '
        'sound_level speed_of_sound'
    ),
    'laws': (
        'horizon input_cost integral_cost law moves regulator_frequencies regulator_poles '
        'state_cost state_price tracked'
    ),
}
#: How names of limits of states begin, before that of the state.
STATE_LIMIT = 'state_limit.'
#: Options of sensors of every kind.
_OF_SENSOR = {'type', 'fields', 'topic', 'noise', 'rate', 'measures', 'kind'}
#: Names of the faults of each sensor, in the plant: `SENSOR.NAME`.
FAULTS = (
    'bias burst_length burst_loss delay drift dropout duplication fault_window freeze jitter nan '
    'outlier_size outliers random_walk reordering'
)


def known(
    sensors: Iterable[str], parameters: Iterable[str], options: Container[str], *, driven: bool
) -> set[str]:
    """Return the names that any node has, with these ``sensors`` and, if ``driven``, an input.

    The options of the filters are among them only if one of the ``parameters`` is neither another
    name nor one of the ``options``, since they require an import of the filters' modules.
    """
    accepted = {
        name for kind, names in NAMES.items() for name in names.split() if driven or kind != 'laws'
    }
    if driven and 'law' not in options:  # who has the law checks the names of states
        accepted |= {name for name in parameters if name.startswith(STATE_LIMIT)}
    accepted |= {f'{sensor}.{name}' for sensor in sensors for name in FAULTS.split()}
    if any(name not in accepted and name not in options for name in parameters):
        accepted |= {option.name for kind in FILTERS for option in filter_options(kind)}
    return accepted


def refuse(parameters: Collection[str], known: Collection[str], sensors: Collection[str]) -> None:
    """Raise ValueError for the first of the ``parameters`` that is not ``known``, with a hint."""
    _refuse_foreign(parameters)
    if 'initial' in parameters:
        raise ValueError(
            "unknown parameter 'initial', an argument of kr.filter: in a file these are "
            'initial_estimate and initial_std, .inf for what is unknown'
        )
    _refuse_unlisted(parameters, known, sensors)
    refuse_unknown(parameters, known, 'parameter')


def _refuse_foreign(parameters: Iterable[str]) -> None:
    """Raise ValueError for parameters that are those of robot_localization."""
    theirs = next(filter(_THEIRS.fullmatch, parameters), '')
    if theirs:
        raise ValueError(
            f"unknown parameter '{theirs}': that is one of robot_localization, whose files "
            'from_robot_localization FILE converts'
        )


def _refuse_unlisted(
    parameters: Iterable[str], known: Container[str], sensors: Collection[str]
) -> None:
    """Raise ValueError for a section of a sensor that is not among the ``sensors``.

    A single parameter of such a section is taken for a misspelt one, which has a nearest name.
    """
    seen: set[str] = set()
    for name in parameters:
        sensor, _, option = name.partition('.')
        alike = option in _OF_SENSOR or any(f'{other}.{option}' in known for other in sensors)
        if name in known or not alike or sensor in (*sensors, 'state', 'input'):
            continue
        if sensor in seen:
            listed = ', '.join(sensors) or 'none'
            expected = f"expected '{sensor}', which has parameters such as {name}, among them"
            raise ValueError(f'sensors: {expected}, got {listed}')
        seen.add(sensor)


def check_kinds(options: Container[str], sensors: Iterable[str]) -> None:
    """Raise ValueError if an option of a sensor's kind has the name of a fault."""
    for sensor in sensors:
        for name in FAULTS.split():
            if f'{sensor}.{name}' in options:
                raise ValueError(f"{sensor}.kind: its option '{name}' is the name of a fault")
