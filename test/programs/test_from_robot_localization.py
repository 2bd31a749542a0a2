# SPDX-License-Identifier: Apache-2.0
"""Parameter files of robot_localization become ours; what does not is named with its line."""

import math
from pathlib import Path

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')

from rclpy.validate_topic_name import validate_topic_name

from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.settings import choose, estimator_extra, settings
from kalman_ros.programs.from_robot_localization import program
from kalman_ros.programs.from_robot_localization.program import main
from kalman_ros.programs.from_robot_localization.their_file import their_nodes
from kalman_ros.programs.from_robot_localization.translation import translated
from kalman_ros.scenario import assemble
from kalman_ros.scenario.parameter_files import from_file

CONFIGS = (
    ('husky_a200_clearpath_common.yaml', ['robot_2d']),
    ('linorobot2_ekf.yaml', ['robot_2d']),
    ('nav2_gps_dual_ekf_navsat.yaml', ['robot_2d', 'robot_2d']),
    ('rl_dual_ekf_navsat_example.yaml', ['robot_3d', 'robot_3d']),
    ('rosbot_ekf.yaml', ['robot_2d']),
)
FLAGS = [
    'x',
    'y',
    'z',
    'roll',
    'pitch',
    'yaw',
    'vx',
    'vy',
    'vz',
    'wx',
    'wy',
    'wz',
    'ax',
    'ay',
    'az',
]


def config(*used):
    return f'[{", ".join(str(flag in used).lower() for flag in FLAGS)}]'


def theirs(tmp_path, *lines):
    file = tmp_path / 'ekf.yaml'
    text = '\n'.join(f'    {line}' for line in lines)
    file.write_text(f'ekf_filter_node:\n  ros__parameters:\n{text}\n')
    return file


def one(tmp_path, *lines):
    (found,) = translated(their_nodes(theirs(tmp_path, *lines)))
    return found.values, {row.name: row for row in found.rows}


@pytest.mark.parametrize(('name', 'models'), CONFIGS, ids=[name for name, _ in CONFIGS])
def test_files_of_five_robots_go_through_and_load(tmp_path, capsys, name, models):
    main([str(data(f'robot_localization_configs/{name}')), '--out', str(tmp_path / 'ours.yaml')])
    files = sorted(tmp_path.glob('ours*.yaml'))
    assert [from_file(file)['model'] for file in files] == models
    for file in files:
        known = settings(from_file(file, 'estimator'))
        known.estimator()
        assert known.scenario.enabled
    assert 'unknown to this program' not in capsys.readouterr().out


def test_in_the_plane_each_flag_is_a_state_of_the_robot(tmp_path):
    values, rows = one(
        tmp_path, 'two_d_mode: true', 'odom0: /wheel/odom',
        f'odom0_config: {config("x", "y", "z", "yaw", "vx", "wz", "ax")}',
    )  # fmt: skip
    assert values['sensors'] == [
        f'odom0_{part}' for part in ('position', 'orientation', 'velocity', 'rate')
    ]
    assert values['odom0_position.measures'] == ['x', 'y']
    assert values['odom0_orientation.fields'] == ['pose.pose.orientation.yaw']
    assert values['odom0_rate.topic'] == '/wheel/odom'
    assert rows['odom0_config'].what.endswith('ax: not in such a message; z: not in the plane')
    assert rows['odom0_config'].line == 5
    settings(values)


def test_in_space_a_whole_orientation_is_a_rotation_and_a_part_of_it_angles(tmp_path):
    values, _ = one(
        tmp_path, 'imu0: imu', f'imu0_config: {config("roll", "pitch", "yaw", "ax", "az")}',
        'imu0_remove_gravitational_acceleration: true', 'imu1: other',
        f'imu1_config: {config("roll", "pitch", "ay")}', 'gravitational_acceleration: 9.7',
    )  # fmt: skip
    assert values['model'] == 'robot_3d'
    assert values['imu0_orientation.measures'] == ['rx', 'ry', 'rz']
    assert values['imu0_orientation.fields'][0] == 'orientation.rx'
    assert values['imu0_acceleration.mount.gravity'] == 9.7
    assert values['imu1_acceleration.mount.gravity'] == 0.0
    assert values['imu1_orientation.kind'] == 'euler'
    assert values['imu1_orientation.angles'] == ['roll', 'pitch']
    built = settings(values).scenario
    level = np.zeros(15)
    reading = built.sensors['imu0_acceleration'].sensor.measure(level)
    np.testing.assert_allclose(reading, [0.0, 9.7])
    level[3] = 0.1  # a roll
    angles = built.sensors['imu1_orientation'].sensor.measure(level)
    np.testing.assert_allclose(angles, [0.1, 0.0], atol=1e-12)


def test_a_number_behind_a_missing_one_is_read_by_neither(tmp_path):
    values, rows = one(
        tmp_path, 'imu0: imu', f'imu0_config: {config("wz")}', 'imu2: other',
        f'imu2_config: {config("wz")}', 'odom0: odom', f'odom0_config: {config("vx")}',
    )  # fmt: skip
    assert [name for name in values['sensors'] if name.startswith('imu')] == ['imu0_rate']
    assert 'there is no imu1' in rows['imu2'].what and not rows['imu2'].carried
    assert not rows['imu2_config'].carried


@pytest.mark.parametrize(('removes', 'carried'), [('true', False), ('false', True)])
def test_in_the_plane_gravity_is_not_taken_out_of_an_acceleration(tmp_path, removes, carried):
    key = 'imu0_remove_gravitational_acceleration'
    _, rows = one(
        tmp_path, 'two_d_mode: true', 'imu0: imu', f'imu0_config: {config("wz", "ax")}',
        f'{key}: {removes}',
    )  # fmt: skip
    assert rows[key].carried is carried
    assert ('tilt' in rows[key].what) is not carried


def test_a_distance_becomes_the_probability_of_a_gate(tmp_path):
    values, rows = one(
        tmp_path, 'two_d_mode: true', 'imu0: imu', f'imu0_config: {config("wz")}', 'odom0: odom',
        f'odom0_config: {config("x", "y", "vx")}', 'imu0_twist_rejection_threshold: 2.0',
        'odom0_pose_rejection_threshold: 3', 'odom0_twist_rejection_threshold: 0.1',
        'imu0_pose_rejection_threshold: 0.8',
    )  # fmt: skip
    assert values['imu0_rate.gate'] == pytest.approx(math.erf(2.0 / math.sqrt(2.0)))
    assert values['odom0_position.gate'] == pytest.approx(1.0 - math.exp(-4.5))
    assert values['odom0_velocity.gate'] == 0.5
    assert rows['imu0_twist_rejection_threshold'].what == ('imu0_rate.gate: 0.954')
    assert rows['odom0_twist_rejection_threshold'].what == (
        'odom0_velocity.gate: 0.5, the lowest; it rejects 50% of good readings'
    )
    assert rows['imu0_pose_rejection_threshold'].what.startswith('not needed: no such part')


def test_noise_and_the_first_belief_go_by_their_15_states(tmp_path):
    numbers = [round(0.1 * k, 1) for k in range(1, 16)]
    whole = np.diag(numbers)
    whole[0, 1] = 0.5
    for planar in (True, False):
        values, rows = one(
            tmp_path, f'two_d_mode: {str(planar).lower()}', 'twist0: cmd',
            f'twist0_config: {config("vx", "wz")}',
            f'process_noise_covariance: {whole.ravel().tolist()}',
            f'initial_estimate_covariance: {numbers}', f'initial_state: {numbers}',
        )  # fmt: skip
        assert not rows['process_noise_covariance'].carried
        assert rows['initial_estimate_covariance'].carried
        assert values['model_parameters.velocity_noise'] == (
            [0.7, 0.8] if planar else [0.7, 0.8, 0.9]
        )
        if planar:
            np.testing.assert_allclose(np.square(values['initial_std'])[[2, 5]], [0.6, 1.2])
            assert values['initial_estimate'][2] == 0.6
        else:
            from scipy.spatial.transform import Rotation

            turn = Rotation.from_euler('xyz', [0.4, 0.5, 0.6]).as_rotvec()
            np.testing.assert_allclose(values['initial_estimate'][3:6], turn)
        settings(values)


@pytest.mark.parametrize('planar', [True, False])
def test_the_first_belief_is_theirs_and_not_that_of_our_demo(tmp_path, planar):
    lines = f'two_d_mode: {str(planar).lower()}', 'odom0: o', f'odom0_config: {config("vx")}'
    for more in ((), ('initial_state: [1.0, 2.0]',)):  # the second is of the wrong size
        values, _ = one(tmp_path, *lines, *more)
        assert values['initial_estimate'] == [0.0] * (8 if planar else 15)
        assert values['initialize'] == 'reading'


def test_a_position_in_a_map_is_unknown_until_it_is_read(tmp_path):
    lines = 'two_d_mode: true', f'pose0_config: {config("x", "y", "yaw")}'
    absolute, _ = one(tmp_path, *lines, 'pose0: amcl_pose')
    assert absolute['initial_std'][:3] == [1000.0, 1000.0, 1.0]
    relative, _ = one(tmp_path, *lines, 'pose0: amcl_pose', 'pose0_relative: true')
    assert relative['initial_std'][:3] == [1.0, 1.0, 1.0]


def test_a_datum_counts_where_it_is_waited_for_as_in_navsat_transform(tmp_path):
    file = tmp_path / 'theirs.yaml'
    text = (
        f'ekf:\n  odom0: odometry/gps\n  odom0_config: {config("x", "y")}\n  two_d_mode: true\n'
        'navsat_transform:\n  datum: [49.9, 8.7, 0.5]\n'
    )
    file.write_text(text)
    found, navigation = translated(their_nodes(file))
    (row,) = [row for row in navigation.rows if row.name == 'datum']
    assert 'datum' not in found.values and row.what.startswith('not used: wait_for_datum is')
    assert found.values['publish_fix'] and found.remaps['estimate/fix'] == 'gps/filtered'
    file.write_text(f'{text}  wait_for_datum: true\n  publish_filtered_gps: false\n')
    found, navigation = translated(their_nodes(file))
    (row,) = [row for row in navigation.rows if row.name == 'datum']
    assert found.values['datum'] == [49.9, 8.7, 0.0] and not found.values['publish_fix']
    assert not row.carried and 'its heading is lost' in row.what


def test_their_file_given_to_a_node_is_answered_with_the_importer():
    with pytest.raises(ValueError, match=r"^unknown parameter 'odom0': that is one of robot_lo"):
        settings({'frequency': 30.0, 'odom0': 'odom'})


def test_the_output_of_the_old_filter_is_found_by_the_names_of_their_example(tmp_path):
    file = tmp_path / 'ekf.yaml'
    one_of_two = f'    odom0: odom\n    odom0_config: {config("vx")}\n'
    file.write_text(
        f'one:\n  ros__parameters:\n    world_frame: odom\n{one_of_two}'
        f'two:\n  ros__parameters:\n    world_frame: map\n{one_of_two}'
    )
    pair = translated(their_nodes(file))
    found = [
        program._recorded_output(each, {'/odometry/local', '/odometry/global'}) for each in pair
    ]
    assert found == ['/odometry/local', '/odometry/global']
    assert program._recorded_output(pair[0], {'/odometry/filtered'}) == '/odometry/filtered'
    assert program._recorded_output(pair[0], {'/odom'}) == ''


@pytest.mark.parametrize('planar', [True, False])
def test_without_a_process_noise_that_of_robot_localization_counts(tmp_path, planar):
    values, rows = one(
        tmp_path, f'two_d_mode: {str(planar).lower()}', 'odom0: o', f'odom0_config: {config("vx")}'
    )
    noise = {name.split('.')[1]: n for name, n in values.items() if name.endswith('_noise')}
    assert noise == (
        {
            'position_noise': [0.05, 0.05], 'heading_noise': 0.06, 'velocity_noise': [0.025] * 2,
            'turn_noise': 0.02, 'acceleration_noise': [0.01, 0.01],
        }
        if planar
        else {
            'position_noise': [0.05, 0.05, 0.06], 'orientation_noise': [0.03, 0.03, 0.06],
            'velocity_noise': [0.025, 0.025, 0.04], 'turn_noise': [0.01, 0.01, 0.02],
            'acceleration_noise': [0.01, 0.01, 0.015],
        }
    )  # fmt: skip
    assert rows['process_noise_covariance'].what.startswith('not given: the default of')


def test_a_heading_that_only_positions_show_is_unknown(tmp_path):
    wheels = 'two_d_mode: true', 'odom0: odom', f'odom0_config: {config("vx", "wz")}'
    place = 'pose0: uwb', f'pose0_config: {config("x", "y")}'
    compass = 'imu0: imu', f'imu0_config: {config("yaw")}'
    values, _ = one(tmp_path, *wheels, *place)
    assert values['filter'] == 'gaussian_sum'
    assert values['initial_std'][2] == math.pi
    settings(values).estimator()
    believed = f'initial_estimate_covariance: {[1e-9] * 15}'
    for others in (
        (),
        compass,
        (*compass, *place),
        (*place, 'pose0_relative: true'),
        (*place, believed),
    ):
        values, _ = one(tmp_path, *wheels, *others)
        assert 'filter' not in values
        assert values['initial_std'][2] <= 1.0


def test_what_is_not_carried_over_is_named_with_its_reason_and_line(tmp_path, capsys):
    file = theirs(
        tmp_path, 'odom0: odom', f'odom0_config: {config("x", "yaw")}', 'odom0_differential: true',
        'use_control: true', 'control_timeout: 0.2', 'favourite_colour: red', 'debug: false',
    )  # fmt: skip
    main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    said = capsys.readouterr().out
    left = said[said.index('NOT carried over') :]
    for line, name in ((6, 'use_control'), (8, 'favourite_colour')):
        assert f'{line}  {name}' in left
    assert 'unknown to this program' in left
    assert 'debug' not in left


def test_commands_become_the_input_of_the_planar_model(tmp_path):
    lines = (
        'two_d_mode: true', 'odom0: odom', f'odom0_config: {config("vx")}', 'use_control: true',
        'stamped_control: true', 'control_timeout: 0.3', 'acceleration_gains: [0.8, 0.0, 0.9]',
    )  # fmt: skip
    values, rows = one(tmp_path, *lines)
    built = settings(values)
    assert built.scenario.input.topic == 'cmd_vel'
    assert built.scenario.input.type == 'geometry_msgs/TwistStamped'
    assert built.options.input_timeout == values['model_parameters.command_time'] == 0.3
    assert all(rows[name].carried for name in ('use_control', 'control_timeout'))
    assert not rows['acceleration_gains'].carried


def test_poses_as_changes_are_read_as_such(tmp_path):
    for planar, rate in ((True, ['wz']), (False, ['wx', 'wy', 'wz'])):
        values, rows = one(
            tmp_path, f'two_d_mode: {str(planar).lower()}', 'odom0: odom',
            f'odom0_config: {config("x", "y", "roll", "pitch", "yaw", "vx")}',
            'odom0_differential: true', 'pose0: uwb', f'pose0_config: {config("x", "yaw")}',
            'pose0_relative: true',
        )  # fmt: skip
        assert values['odom0_position.measures'] == ['vx', 'vy']
        assert values['odom0_orientation.measures'] == rate
        assert values['odom0_orientation.pose'] == 'differential'
        assert 'odom0_velocity.pose' not in values
        assert values['pose0_position.pose'] == values['pose0_orientation.pose'] == 'relative'
        assert rows['odom0_differential'].carried
        assert settings(values).scenario.sensors['odom0_position'].signal.pose == 'differential'


def test_fixes_are_read_without_navsat_transform(tmp_path):
    file = tmp_path / 'dual.yaml'
    file.write_text(
        'ekf_local:\n  ros__parameters:\n    two_d_mode: true\n    odom0: odom\n'
        f'    odom0_config: {config("vx", "wz")}\n    world_frame: odom\n'
        'ekf_global:\n  ros__parameters:\n    two_d_mode: true\n    odom0: odom\n'
        f'    odom0_config: {config("vx", "wz")}\n    world_frame: map\n'
        f'    odom1: odometry/gps\n    odom1_config: {config("x", "y")}\n'
        'navsat_transform:\n  ros__parameters:\n    datum: [49.9, 8.7, 0.0]\n'
        '    yaw_offset: 1.5\n    wait_for_datum: true\n'
    )
    local, everywhere, navigation = translated(their_nodes(file))
    assert everywhere.values['odom1_fix.fields'] == ['east', 'north']
    assert everywhere.values['datum'] == [49.9, 8.7, 0.0]
    assert everywhere.values['odom_frame'] == 'odom'
    assert (local.values['frame'], everywhere.values['frame']) == ('odom', 'map')
    assert 'odom_frame' not in local.values
    file.write_text(file.read_text().partition('navsat_transform')[0])
    _, alone = translated(their_nodes(file))
    assert alone.values['odom1_position.topic'] == 'odometry/gps'
    assert any('it takes navsat_transform' in row.what for row in alone.rows)
    (row,) = (row for row in navigation.rows if row.name == 'yaw_offset')
    assert not row.carried and row.what.startswith(
        'no heading of an IMU is read: the first one is'
    )


def test_dynamic_noise_and_limits_are_carried_over(tmp_path):
    speeding = 'acceleration_limits: [1.0, 0.5, 0.0, 0.0, 0.0, 2.0]'
    braking = 'deceleration_limits: [1.5, 0.25, 0.0, 0.0, 0.0, 2.0]'
    lines = [
        'odom0: odom', f'odom0_config: {config("vx", "wz")}', 'two_d_mode: true',
        'use_control: true', 'dynamic_process_noise_covariance: true',
    ]  # fmt: skip
    values, rows = one(tmp_path, *lines, speeding)
    assert values['model_parameters.noise_by_speed'] is True
    assert values['model_parameters.acceleration_limits'] == [1.0, 0.5, 2.0]
    assert rows['dynamic_process_noise_covariance'].carried and rows['acceleration_limits'].carried
    settings(values).fusion()
    values, rows = one(tmp_path, *lines, speeding, braking)
    assert values['model_parameters.acceleration_limits'] == [1.5, 0.5, 2.0]
    assert not rows['deceleration_limits'].carried
    assert 'the larger of both' in rows['acceleration_limits'].what
    values, rows = one(tmp_path, *lines, 'acceleration_limits: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]')
    assert 'model_parameters.acceleration_limits' not in values
    row = rows['acceleration_limits']
    assert not row.carried and 'expected a positive number' in row.what


@pytest.mark.parametrize(
    ('name', 'value', 'more'),
    [
        ('frequency', '-5', ()),
        ('frequency', '20000', ()),
        ('history_length', '-1', ('smooth_lagged_data: true',)),
        ('transform_time_offset', '1.0e12', ()),
        ('control_timeout', '1.0e9', ('use_control: true', 'two_d_mode: true')),
        ('world_frame', "''", ()),
        ('world_frame', 'base_link', ()),
        ('world_frame', '/', ()),
        ('base_link_frame', "''", ()),
        ('base_link_frame', 'odom', ()),
        ('initial_state', f'[1.0e+300{", 0.0" * 14}]', ()),
        ('initial_estimate_covariance', f'[1.0e+300{", 1.0" * 14}]', ()),
        ('process_noise_covariance', f'[1.0e+200{", 1.0" * 14}]', ()),
    ],
)
def test_a_value_that_no_estimator_starts_with_is_left_out_and_listed(
    tmp_path, capsys, name, value, more
):
    lines = 'odom0: odom', f'odom0_config: {config("vx", "wz")}', *more, f'{name}: {value}'
    file = theirs(tmp_path, *lines)
    main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    said = ' '.join(capsys.readouterr().out.split())
    assert f' {name} left out: ' in said
    settings(from_file(tmp_path / 'ours.yaml', 'estimator')).fusion()


def test_a_node_whose_name_ros_refuses_is_listed_with_the_name_it_gets(tmp_path):
    file = tmp_path / 'ekf.yaml'
    file.write_text(
        'ekf node-1:\n  ros__parameters:\n    odom0: odom\n'
        f'    odom0_config: {config("vx", "wz")}\n'
    )
    (found,) = translated(their_nodes(file))
    assert found.name == 'ekf_node_1'
    (row,) = (row for row in found.rows if row.name == 'ekf node-1')
    assert not row.carried and row.what == "node ekf_node_1: 'ekf node-1' is no name in ROS 2"


def test_a_robot_that_has_no_command_to_the_left_has_the_other_limits(tmp_path):
    lines = 'odom0: odom', f'odom0_config: {config("vx", "wz")}', 'two_d_mode: true'
    limits = 'acceleration_limits: [1.3, 0.0, 0.0, 0.0, 0.0, 3.4]'
    values, rows = one(tmp_path, *lines, 'use_control: true', limits)
    assert values['model_parameters.acceleration_limits'] == [1.3, np.inf, 3.4]
    assert rows['acceleration_limits'].carried


@pytest.mark.parametrize('planar', [True, False])
def test_declination_and_offset_turn_the_heading_of_the_imu(tmp_path, planar):
    file = tmp_path / 'dual.yaml'
    file.write_text(
        f'ekf:\n  ros__parameters:\n    two_d_mode: {str(planar).lower()}\n    world_frame: map\n'
        f'    odom0: odometry/gps\n    odom0_config: {config("x", "y")}\n'
        f'    imu0: imu\n    imu0_config: {config("roll", "pitch", "yaw", "wz")}\n'
        f'    imu1: imu1\n    imu1_config: {config("yaw")}\n    imu1_differential: true\n'
        'navsat_transform:\n  ros__parameters:\n    yaw_offset: 1.5\n'
        '    magnetic_declination_radians: 0.04\n'
    )
    ours, navigation = translated(their_nodes(file))
    turned = {key: value for key, value in ours.values.items() if key.endswith('mount.heading')}
    assert turned == {'imu0_orientation.mount.heading': pytest.approx(1.54)}
    rows = {row.name: row for row in navigation.rows}
    for name in ('yaw_offset', 'magnetic_declination_radians'):
        assert rows[name].carried and rows[name].what == 'imu0_orientation.mount.heading: 1.54'
    signal = settings(ours.values).scenario.sensors['imu0_orientation'].signal
    assert signal.mounting.heading == pytest.approx(1.54) and signal.mounting.turned


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('a: [1\n', 'not YAML'),
        ('a: 1\n', 'expected a node with one of odom0'),
        ('[1, 2]\n', 'expected a node with one of odom0'),
        ('', 'expected a node with one of odom0'),
        ('odom0: odom\n', 'line 1: odom0: left out: odom0_config: expected 15 flags, got none'),
        (
            'odom0: odom\nodom0_config: [true, 1]\n',
            'line 1: odom0: left out: odom0_config: expected 15 times true or false, got 1 of 2',
        ),
        ('odom0: odom\nodom0_config: true\n', 'expected 15 times true or false, got no list'),
        ('odom0: 7\nodom0_config: C\n', 'line 1: odom0: left out: expected a word, got 7'),
        ('odom0: odom\nodom0_config: F\n', 'expected a flag that is true, got none'),
        ("odom0: ''\nodom0_config: C\n", 'odom0: left out: expected the name of a topic'),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, capsys, text, why):
    file = tmp_path / 'theirs.yaml'
    file.write_text(text.replace(': C', f': {config("vx")}').replace(': F', f': {config()}'))
    with pytest.raises(SystemExit) as refused:
        main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    said = capsys.readouterr().err
    assert refused.value.code == 2 and why in said and said.count('\n') == 1
    assert not (tmp_path / 'ours.yaml').exists()


@pytest.mark.parametrize(
    ('line', 'why'),
    [
        ('frequency: fast', "expected a number, got 'fast'"),
        ('frequency: 1' + 400 * '0', 'expected a number'),
        ('process_noise_covariance: [1]', 'expected 15 or 225 finite numbers'),
        (f'process_noise_covariance: [{14 * "0.1, "}-0.1]', 'expected finite variances'),
        ('initial_state: [.nan]', 'expected 15 finite numbers'),
        (f'initial_state: [{14 * "0, "}1{400 * "0"}]', 'expected 15 finite numbers'),
        ('odom0_twist_rejection_threshold: -1.0', 'expected a distance above 0, got -1'),
        ('world_frame: $(var robot)/map', 'expected a value in place of a launch substitution'),
        ('two_d_mode: maybe', 'expected true or false'),
    ],
)
def test_a_wrong_value_is_left_out_and_listed_with_its_line(tmp_path, line, why):
    lines = 'odom0: odom', f'odom0_config: {config("vx")}'
    without, _ = one(tmp_path, *lines)
    values, rows = one(tmp_path, *lines, line)
    row = rows[line.partition(':')[0]]
    assert not row.carried and row.line == 5
    assert row.what.startswith(f'left out: {why}')
    assert values == without


@pytest.mark.parametrize(
    ('lines', 'why'),
    [
        (('pose0: 7', f'pose0_config: {config("x")}'), 'expected a word, got 7'),
        (('pose0: pose',), 'pose0_config: expected 15 flags, got none'),
        (('pose0: pose', 'pose0_config: [true]'), 'pose0_config: expected 15 times true or false'),
        (('pose0: $(var pose)', f'pose0_config: {config("x")}'), 'expected a value in place of'),
        (('pose0: "- /"', f'pose0_config: {config("x")}'), 'expected the name of a topic'),
    ],
)
def test_a_sensor_that_cannot_be_is_left_out_and_the_others_remain(tmp_path, lines, why):
    others = 'odom0: odom', f'odom0_config: {config("vx")}'
    without, _ = one(tmp_path, *others)
    values, rows = one(tmp_path, *others, *lines, 'pose0_differential: true')
    assert values == without
    assert rows['pose0'].what.startswith(f'left out: {why}') and not rows['pose0'].carried
    assert rows['pose0_differential'].what == 'left out: its sensor pose0 is'


@pytest.mark.parametrize(
    ('topic', 'mended'),
    [
        ('wheel odom', 'wheel_odom'),
        ('/robot-1//odom/', '/robot_1/odom'),
        ('2nd/odom', '_2nd/odom'),
        ('~/odom', '~/odom'),
        ('/odom', '/odom'),
    ],
)
def test_a_topic_that_ros_refuses_is_mended_and_listed(tmp_path, topic, mended):
    validate_topic_name(mended)
    values, _ = one(tmp_path, f'odom0: {topic}', f'odom0_config: {config("vx")}')
    assert values['odom0_velocity.topic'] == mended
    (found,) = translated(their_nodes(tmp_path / 'ekf.yaml'))
    listed = [row.what for row in found.rows if row.name == 'odom0' and not row.carried]
    expected = [f"topic {mended}: '{topic}' is no name in ROS 2"] if topic != mended else []
    assert listed == expected


@pytest.mark.parametrize('planar', ['true', 'false'])
def test_what_is_in_the_frame_of_a_sensor_is_placed_by_transforms(tmp_path, planar):
    """As robot_localization does; a pose is in the frame of the world."""
    flags = config('x', 'y', 'yaw', 'vx', 'wz', 'ax')
    lines = [line for kind in ('odom', 'pose', 'twist', 'imu')
             for line in (f'{kind}0: {kind}', f'{kind}0_config: {flags}')]  # fmt: skip
    values, _ = one(tmp_path, f'two_d_mode: {planar}', *lines)
    placed = {name.removesuffix('.mount.tf') for name in values if name.endswith('.mount.tf')}
    assert placed == {
        'odom0_velocity', 'odom0_rate', 'twist0_velocity', 'twist0_rate',
        'imu0_orientation', 'imu0_rate', 'imu0_acceleration',
    }  # fmt: skip
    built = settings(values).scenario
    assert {n for n, s in built.sensors.items() if s.signal.mounting.from_tf} == placed


def test_the_odometry_can_be_where_theirs_is(tmp_path, capsys):
    file = theirs(tmp_path, 'odom0: odom', f'odom0_config: {config("vx")}')
    main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    remap = '-r estimate/odometry:=odometry/filtered'
    assert remap in (tmp_path / 'ours.yaml').read_text()
    assert f'{remap} --params-file' in capsys.readouterr().out


def test_control_characters_are_escaped_in_what_is_written(tmp_path, capsys):
    ours = tmp_path / 'ours.yaml'
    file = tmp_path / 'th\x1b[2Jeirs.yaml'
    file.write_text(f'odom0: "o\\e[2J\\a"\nodom0_config: {config("vx")}\n')
    main([str(file), '--out', str(ours)])  # the parser of ROS has read it
    text = ours.read_text()
    assert text.replace('\n', '').isprintable()
    assert 'o__2J_' in from_file(ours).values()
    assert '\x1b' not in capsys.readouterr().out


def test_what_ros_does_not_read_is_not_left_behind(tmp_path, monkeypatch):
    ours = tmp_path / 'ours.yaml'
    monkeypatch.setattr(
        program, 'as_text', lambda *_: '/**:\n  ros__parameters:\n    a: &b [*b]\n'
    )
    with pytest.raises(SystemExit):
        main([str(theirs(tmp_path, 'odom0: odom', f'odom0_config: {config("vx")}')),
              '--out', str(ours)])  # fmt: skip
    assert not ours.exists()


def test_the_parameters_of_all_sensors_are_found_in_one_pass(tmp_path):
    """With 200 sources, one pass for each sensor takes 20 s."""
    lines = [
        line
        for number in range(200)
        for line in (f'odom{number}: odom/n{number}', f'odom{number}_config: {config("vx")}')
    ]
    given, _ = one(tmp_path, *lines)
    chosen = choose(given, EstimatorOptions, estimator_extra, with_law=False)
    values = {name: chosen.values[name] for name in chosen.shared}
    looked_at = 0

    class Counted(dict):
        def items(self):
            nonlocal looked_at
            looked_at += len(self)
            return super().items()

    assemble(Counted(values), with_law=False)
    assert looked_at <= len(values)


def test_a_threshold_that_keeps_everything_is_a_gate_of_one(tmp_path):
    file, ours = tmp_path / 'theirs.yaml', tmp_path / 'ours.yaml'
    config_of_speed = f'odom0_config: {config("vx")}'
    file.write_text(f'odom0: odom\n{config_of_speed}\nodom0_twist_rejection_threshold: 1.0e+300\n')
    main([str(file), '--out', str(ours)])
    assert 'gate: 1.0' in ours.read_text()


def test_filters_of_one_name_in_two_namespaces_are_two_files(tmp_path, capsys):
    file = tmp_path / 'theirs.yaml'
    ekf = f'{{ekf: {{ros__parameters: {{odom0: odom, odom0_config: {config("vx")}}}}}}}'
    file.write_text(f'/first: {ekf}\n/second: {ekf}\n')
    main([str(file), '--out', str(tmp_path / 'ours [b].yaml')])
    said = capsys.readouterr().out
    for space in ('first', 'second'):
        assert (tmp_path / f'ours [b]_{space}_ekf.yaml').is_file()
        remap = '-r estimate/odometry:=odometry/filtered'
        options = f'-r __ns:=/{space} -r __node:=ekf {remap} --params-file '
        assert f"{options}'{tmp_path}/ours [b]_{space}_ekf.yaml'" in said


def test_what_is_for_all_nodes_is_for_each_filter(tmp_path):
    file = tmp_path / 'theirs.yaml'
    ekf = f'{{odom0: odom, odom0_config: {config("vx")}, frequency: 20.0}}'
    file.write_text(
        f'/a/ekf: {{ros__parameters: {ekf}}}\n/b/ekf: {{ros__parameters: {ekf}}}\n'
        '/**: {ros__parameters: {use_sim_time: true, frequency: 10.0}}\n'
        '/b/**: {ros__parameters: {two_d_mode: true}}\n'
        'navigator: {ros__parameters: {tree: $(find-pkg-share trees)/go.xml}}\n'
    )
    space, plane, _ = translated(their_nodes(file))
    assert space.values['use_sim_time'] and plane.values['use_sim_time']
    assert (space.values['model'], plane.values['model']) == ('robot_3d', 'robot_2d')
    assert space.values['publish_rate'] == 10.0  # the last in the file


def test_nodes_of_ros_1_have_their_navsat_transform(tmp_path):
    file = tmp_path / 'theirs.yaml'
    file.write_text(
        f'ekf:\n  odom0: odometry/gps\n  odom0_config: {config("x", "y")}\n  two_d_mode: true\n'
        'navsat_transform:\n  yaw_offset: 0.0\n  datum: [49.9, 8.7, 0.0, map, base_link]\n'
        '  wait_for_datum: true\n'
    )
    found, _ = translated(their_nodes(file))
    assert found.values['odom0_fix.fields'] == ['east', 'north']
    assert found.values['datum'] == [49.9, 8.7, 0.0]
    file.write_text(file.read_text().replace('8.7, 0.0,', ''))
    found, navigation = translated(their_nodes(file))
    assert 'datum' not in found.values
    (row,) = [row for row in navigation.rows if row.name == 'datum']
    assert (row.line, row.what) == (7, 'left out: expected 2 or 3 finite numbers')


def test_an_unscented_filter_remains_one(tmp_path):
    values, rows = one(
        tmp_path, 'odom0: odom', f'odom0_config: {config("vx")}', 'alpha: 0.001', 'kappa: 0',
    )  # fmt: skip
    assert values['filter'] == 'ukf' and 'alpha' not in values
    assert rows['alpha'].carried and rows['kappa'].carried
    settings(values).estimator()


def test_a_filter_and_the_converter_of_fixes_under_one_wildcard(tmp_path):
    """Parameters that stand under /** are those of either node that knows them."""
    lines = ['odom0: odometry/gps', f'odom0_config: {config("x", "y")}', 'yaw_offset: 0.5']
    lines += ['imu0: imu', f'imu0_config: {config("yaw")}', 'zero_altitude: true']
    file = tmp_path / 'theirs.yaml'
    file.write_text('\n'.join(['/**:', '  ros__parameters:', *(f'    {line}' for line in lines)]))
    alone, converter = translated(their_nodes(file))
    assert alone.values['odom0_fix.topic'] == 'gps/fix'
    assert alone.values['imu0_orientation.mount.heading'] == 0.5
    assert {row.name for row in converter.rows} == {'yaw_offset', 'zero_altitude'}
    assert all(row.carried for row in converter.rows)
    # beside a converter that has a name, which has them alone
    file.write_text(f'{file.read_text()}\nnavsat:\n  ros__parameters: {{delay: 1.0}}\n')
    found = translated(their_nodes(file))
    assert [each.name for each in found if not each.values] == ['navsat']
    assert not any(row.what.startswith('unknown') for each in found for row in each.rows)


def test_a_converter_whose_output_no_filter_reads(tmp_path):
    lines = f'{{odom0: gps/position, odom0_config: {config("x", "y")}}}'
    file = tmp_path / 'theirs.yaml'
    file.write_text(
        f'ekf:\n  ros__parameters: {lines}\nnavsat:\n  ros__parameters: {{yaw_offset: 1.5}}\n'
    )
    _, converter = translated(their_nodes(file))
    (row,) = converter.rows
    wanted = 'not used: no filter in this file reads odometry/gps; where a remap leads to it, '
    assert not row.carried and row.what.startswith(wanted)


def test_a_wildcard_has_the_name_of_the_file(tmp_path, capsys):
    file = tmp_path / 'theirs.yaml'
    ekf = f'{{ros__parameters: {{odom0: odom, odom0_config: {config("vx")}}}}}'
    file.write_text(f'/**: {ekf}\n')
    main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    assert 'theirs: carried over' in capsys.readouterr().out


def test_a_sensor_under_a_wildcard_is_one_of_every_filter(tmp_path):
    """As ROS has it, whether the filters name sensors besides or not."""
    gnss = f'odom1: odometry/gps, odom1_config: {config("x", "y")}'
    file = tmp_path / 'theirs.yaml'
    file.write_text(
        f'/**:\n  ros__parameters: {{two_d_mode: true, frequency: 20.0, odom0: wheels, '
        f'odom0_config: {config("vx")}, datum: [49.9, 8.7, 0.0], wait_for_datum: true}}\n'
        'local:\n  ros__parameters: {world_frame: odom}\n'
        f'everywhere:\n  ros__parameters: {{world_frame: map, {gnss}}}\n'
    )
    local, everywhere, converter = translated(their_nodes(file))
    assert [each.name for each in (local, everywhere)] == ['local', 'everywhere']
    for each in (local, everywhere):
        assert each.values['model'] == 'robot_2d' and each.values['publish_rate'] == 20.0
        assert 'odom0_velocity' in each.values['sensors']
    assert everywhere.values['datum'] == [49.9, 8.7, 0.0]
    assert {row.name for row in converter.rows} == {'datum', 'wait_for_datum'}


def test_a_converter_in_any_namespace_is_that_of_the_filters(tmp_path):
    sensors = f'odom0: odometry/gps, odom0_config: {config("x", "y")}'
    file = tmp_path / 'theirs.yaml'
    file.write_text(
        '/**/navsat:\n  ros__parameters: {datum: [49.9, 8.7, 0.0], wait_for_datum: true}\n'
        + ''.join(f'/{ns}/ekf:\n  ros__parameters: {{{sensors}}}\n' for ns in ('r1', 'r2'))
    )
    filters = [each for each in translated(their_nodes(file)) if each.values]
    assert [each.title for each in filters] == ['r1/ekf', 'r2/ekf']
    assert all(each.values['datum'] == [49.9, 8.7, 0.0] for each in filters)
    assert all(each.values['odom0_fix.topic'] == 'gps/fix' for each in filters)


def test_a_world_that_is_neither_map_nor_odom_has_no_transform(tmp_path):
    lines = ('odom0: odom', f'odom0_config: {config("vx")}')
    (found,) = translated(their_nodes(theirs(tmp_path, *lines, 'world_frame: earth')))
    assert found.values['publish_tf'] is False and 'odom_frame' not in found.values
    (row,) = (row for row in found.rows if row.name == 'publish_tf')
    assert row.what == 'false: world_frame is neither map_frame nor odom_frame'
    more = ('world_frame: /odom', 'odom_frame: odom')
    (found,) = translated(their_nodes(theirs(tmp_path, *lines, *more)))
    assert found.values['publish_tf'] is True and 'odom_frame' not in found.values


def test_their_own_file_is_not_overwritten(tmp_path, capsys):
    file = tmp_path / 'theirs.yaml'
    text = f'odom0: odom\nodom0_config: {config("vx")}\n'
    file.write_text(text)
    with pytest.raises(SystemExit):
        main([str(file), '--out', f'{tmp_path}/../{tmp_path.name}/theirs.yaml'])
    assert '--out: expected another file' in capsys.readouterr().err
    assert file.read_text() == text


def test_a_file_that_is_not_there_is_refused_in_one_line(capsys):
    with pytest.raises(SystemExit):
        main([str(Path('/nowhere/ekf.yaml'))])
    assert capsys.readouterr().err == (
        'from_robot_localization: /nowhere/ekf.yaml: No such file or directory\n'
    )


@pytest.mark.parametrize('word', ['differential', 'relative'])
def test_fixes_are_positions_whatever_the_odometry_was(tmp_path, word):
    file = tmp_path / 'theirs.yaml'
    file.write_text(
        f'ekf:\n  ros__parameters:\n    odom0: odom\n    odom0_config: {config("vx")}\n'
        f'    odom1: odometry/gps\n    odom1_config: {config("x", "y", "yaw", "vx")}\n'
        f'    odom1_{word}: true\n'
        'navsat_transform:\n  ros__parameters: {yaw_offset: 0.0}\n'
    )
    found, _ = translated(their_nodes(file))
    assert found.values['sensors'] == ['odom0_velocity', 'odom1_fix']
    assert found.values['odom1_fix.fields'] == ['east', 'north']
    rows = {row.name: row for row in found.rows}
    assert rows[f'odom1_{word}'].what == 'fixes are read as positions'
    assert rows['odom1_config'].what.startswith('odom1_fix; not in a fix: ')
    assert not rows[f'odom1_{word}'].carried and not rows['odom1_config'].carried


def test_a_filter_in_a_map_places_the_frame_of_the_odometry(tmp_path):
    """Theirs finds the body in that frame on /tf, whoever publishes it."""
    lines = ('odom0: odom', f'odom0_config: {config("vx")}', 'world_frame: map')
    for frame in ('odom', 'wheels'):
        file = theirs(tmp_path, *lines, f'odom_frame: /{frame}')
        main([str(file), '--out', str(tmp_path / 'ours.yaml')])
        text = (tmp_path / 'ours.yaml').read_text()
        assert f"    odom_frame: '{frame}'" in text
    off = theirs(tmp_path, *lines, 'publish_tf: false')
    main([str(off), '--out', str(tmp_path / 'ours.yaml')])
    assert '    odom_frame' not in (tmp_path / 'ours.yaml').read_text()


@pytest.mark.parametrize(
    ('worlds', 'remaps'),
    [
        (
            ['map', 'odom'],
            [
                {'a/estimate/odometry': 'odometry/global'},
                {'b/estimate/odometry': 'odometry/local'},
            ],
        ),
        (['odom', 'odom'], [{}, {}]),
        (['map', 'map'], [{}, {}]),
        (['odom'], [{'estimate/odometry': 'odometry/filtered'}]),
        (['map'], [{'estimate/odometry': 'odometry/filtered'}]),
    ],
)
def test_two_filters_are_remapped_as_in_the_example_of_robot_localization(
    tmp_path, worlds, remaps
):
    lines = [
        f'{name}:\n  ros__parameters: {{odom0: odom, odom0_config: {config("vx")}, '
        f'world_frame: {world}}}'
        for name, world in zip('ab', worlds)
    ]
    file = tmp_path / 'theirs.yaml'
    file.write_text('\n'.join(lines) + '\n')
    assert [each.remaps for each in translated(their_nodes(file))] == remaps
    main([str(file), '--out', str(tmp_path / 'ours.yaml')])
    for name, expected in zip('ab', remaps):
        suffix = f'_{name}' if len(worlds) > 1 else ''
        text = (tmp_path / f'ours{suffix}.yaml').read_text()
        arguments = ''.join(f' -r {ours}:={other}' for ours, other in expected.items())
        assert (f'--ros-args{arguments}\n' in text) == bool(expected)


@pytest.mark.parametrize(
    ('text', 'planar'),
    [
        ('ekf: {two_d_mode: false, S}\n/**: {two_d_mode: true}\n', True),
        ('/**: {two_d_mode: true}\nekf: {two_d_mode: false, S}\n', False),
        ('/robot1/*: {two_d_mode: true}\n/robot10/ekf: {S}\n', False),
        ('/robot1/*: {two_d_mode: true}\n/robot1/ekf: {S}\n', True),
    ],
)
def test_of_a_value_that_stands_twice_the_last_counts_as_in_ros(tmp_path, text, planar):
    file = tmp_path / 'theirs.yaml'
    sensor = f'odom0: odom, odom0_config: {config("vx")}'
    file.write_text(
        text.replace('S}', f'{sensor}}}').replace('{', '{ros__parameters: {').replace('}', '}}')
    )
    (found,) = [each for each in translated(their_nodes(file)) if each.values]
    assert found.values['model'] == ('robot_2d' if planar else 'robot_3d')


def test_what_is_written_has_names_that_ros_takes(tmp_path):
    file = tmp_path / 'theirs.yaml'
    long = 250 * 'x'
    file.write_text(
        f'"ekf-odom 1":\n  odom0: odom\n  odom0_config: {config("vx")}\n'
        f'  odom1: {long}\n  odom1_config: {config("vx")}\n'
        f'  odom\u0663: odom\n  odom\u0663_config: {config("vx")}\n'
        f'9ekf:\n  imu0: imu\n  imu0_config: {config("wz")}\n'
    )
    first, second = translated(their_nodes(file))
    assert (first.name, second.name) == ('ekf_odom_1', '_9ekf')
    assert first.values['sensors'] == ['odom0_velocity']
    for values in (first.values, second.values):
        settings(values)
        validate_topic_name(values['state.topic'])
