# SPDX-License-Identifier: Apache-2.0
"""What cannot become C is refused by name; nothing of a file becomes C without a check."""

from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.estimators.policy import Policy

pytest.importorskip('casadi')
from exported import needs_a_compiler, of_scenario

from kalman_ros.embedded.identifiers import comment, identifier, part
from kalman_ros.embedded.source import loop_files
from kalman_ros.embedded.writing import build, write

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    'name', ['', '2x', 'a b', 'int', 'class', 'x;', 'x*/', 'é', 'x\n', 'a' * 64, '_x', 'x-y']
)
def test_a_name_is_an_identifier_or_refused(name):
    with pytest.raises(ValueError, match='name: expected a name for C') as refused:
        identifier('name', name)
    assert '\n' not in str(refused.value)


def test_a_name_behind_another_may_have_dots():
    assert part('states', 'imu.bias.z') == 'imu_bias_z'
    assert identifier('name', 'cart_pole2') == 'cart_pole2'


@pytest.mark.parametrize('text', ['*/ int x;', 'm /* s', 'a\\\nb', '//', 'µ\x1b[1m'])
def test_a_comment_stays_one(text):
    found = comment(text)
    assert not any(each in found for each in ('*/', '/*', '//', '\\', '\n', '\x1b'))


@pytest.mark.parametrize(
    ('name', 'changes', 'expected'),
    [
        ('sound_tracker', {}, 'filter: expected kf, ekf, ukf, steady_state or luenberger for C'),
        ('cart_pole', {'filter': 'square_root'}, 'got square_root'),
        ('cart_pole', {'law': 'mpc'}, 'law: expected lqr, lqi, placement for C, got mpc'),
        ('inertial', {'filter': 'ukf'}, 'ukf is exported for states and readings without rot'),
        ('cart_pole', {'joint_states.enabled': False}, 'sensors: expected one that is enabled'),
    ],
)
def test_what_is_not_supported_is_named(name, changes, expected):
    with pytest.raises(ValueError, match=expected):
        of_scenario(name, changes)


def test_a_law_along_motions_alone_takes_one():
    with pytest.raises(ValueError, match='no input moves some of the states: expected a motion'):
        of_scenario(ROOT / 'docs' / 'examples' / 'robot_on_a_path.yaml')


def test_a_motion_of_another_model_is_refused(tmp_path):
    motion = kr.motion('dc_motor', values={'theta': [0.0, 1.0]}, times=[0.0, 2.0])
    with pytest.raises(ValueError, match='^motion: expected one of .x, v, theta, omega., got'):
        kr.export('cart_pole', tmp_path / 'a', motion=motion)
    with pytest.raises(ValueError, match='^motion: expected none without a law'):
        kr.export('dc_motor', tmp_path / 'a', motion=motion, control=False)
    assert not (tmp_path / 'a').exists()


def test_a_function_that_cannot_be_traced_is_named(tmp_path):
    def slides(x, u):
        push = u[0]
        while push > 1.0:
            push = 0.5 * push
        return np.array([x[1], push])

    model = kr.continuous_model(slides, np.eye(2), states='x v', inputs='push')
    scenario = kr.make_scenario(
        model, [kr.sensor([[1.0, 0.0]], 1.0)], rate=10.0, initial=([0.0, 0.0], np.eye(2))
    )
    with pytest.raises(ValueError, match='decides by the value of the state'):
        kr.export(scenario, tmp_path / 'c')
    assert not (tmp_path / 'c').exists()


@pytest.mark.parametrize(
    ('options', 'expected'),
    [
        ({'name': 'while'}, 'name: expected a name for C'),
        ({'precision': 'float16'}, 'precision: expected float64 or float32'),
        ({'name': 'check'}, "expected another than 'check', which is a file of C"),
        ({'name': 'math'}, "expected another than 'math', which is a file of C"),
        ({'steps': 0}, 'steps: expected 1 to 1000000'),
        ({'steps': 10**9}, 'steps: expected 1 to 1000000'),
    ],
)
def test_bad_options_are_one_line_and_write_nothing(options, expected, tmp_path):
    chosen = {'name': 'loop', 'precision': 'float64', **options}
    with pytest.raises(ValueError, match=expected):
        write(of_scenario('dc_motor'), tmp_path / 'c', **chosen)
    assert not (tmp_path / 'c').exists()


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    (tmp_path / 'mine').write_text('mine')
    with pytest.raises(ValueError, match='is there already: name another folder'):
        write(of_scenario('dc_motor'), tmp_path, 'loop')
    assert [each.name for each in tmp_path.iterdir()] == ['mine']


def test_a_text_ends_no_comment():
    loop = of_scenario('linear', {'sensors': ['position']})
    texts = loop_files(loop, 'loop', 'float64', 'x')
    assert 'loop_correct_position' in texts['loop.h']
    assert '*/ x' not in loop_files(loop, 'loop', 'float64', '*/ x')['loop.h']


@needs_a_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    'name',
    mostly_thorough(['my_name', 'NAME', 'prefix', 'measure', 'state', 'loop', 'first'], 'loop'),
)
def test_no_name_is_mixed_up_with_one_of_ours(name, tmp_path):
    three = {'type': 'std_msgs/Float64', 'fields': ['data'], 'noise': [0.1], 'measures': ['x']}
    sensors = ['gps', 'gps_of', 'NAME', 'init', 'predict']
    changes = {f'{each}.{key}': value for each in sensors for key, value in three.items()}
    loop = of_scenario('mass_spring_damper', {'sensors': sensors, **changes})
    built = build(write(loop, tmp_path / 'c', name, source='NAME.yaml', steps=20))
    assert built is not None
    header = (tmp_path / 'c' / f'{name}.h').read_text()
    assert 'from NAME.yaml' in header
    assert f'{name}_correct_NAME(' in header or name == 'NAME'
    assert f'{name.upper()}_STATES' in header


@pytest.mark.parametrize(
    ('policy', 'says'),
    [
        (Policy(max_gap=np.inf), 'max_gap: expected 0 to 1e'),
        (Policy(max_gap=1e12), 'max_gap: expected 0 to 1e'),
        (Policy(recover_after=5_000_000_000), 'gate_recover_after: expected at most 1000000000'),
        (Policy(from_reading=True), 'initialize: expected belief, got reading'),
        (Policy(rest_until_input=True), 'rest_until_input: expected false'),
    ],
)
def test_what_does_not_fit_in_c_is_refused(policy, says):
    with pytest.raises(ValueError, match=says):
        of_scenario('dc_motor', policy=policy)


@pytest.mark.parametrize(('key', 'value'), [('soft_gate', 0.9), ('adapt', True)])
def test_weights_of_readings_are_refused(key, value):
    with pytest.raises(ValueError, match=rf'^encoder\.{key}: expected none, since C has no'):
        of_scenario('dc_motor', {f'encoder.{key}': value})


@pytest.mark.parametrize(('std', 'noise'), [(1e20, 0.1), (1.0, 1e-23)])
def test_variances_beyond_single_precision_are_refused(std, noise, tmp_path):
    loop = of_scenario('dc_motor', {'initial_std': [std, 1.0, 1.0], 'encoder.noise': [noise]})
    with pytest.raises(ValueError, match='precision: float32 computes with variances from 1e-15'):
        write(loop, tmp_path / 'c', 'loop', 'float32')
    write(loop, tmp_path / 'd', 'loop', steps=5)


def test_a_name_of_a_sensor_has_no_dot():
    with pytest.raises(ValueError, match="sensors: expected names without a dot, got 'a.b'"):
        of_scenario('dc_motor', {'sensors': ['a.b']})


def test_a_notebook_has_the_options_of_the_file(tmp_path):
    mine = tmp_path / 'mine.yaml'
    mine.write_text(
        '/**:\n  ros__parameters: {model: dc_motor, filter: kf, sensors: [encoder]}\n'
        'estimator:\n  ros__parameters: {max_gap: 5.0, gate_recover_after: 7}\n'
    )
    kr.export(mine, tmp_path / 'a', compile=False)
    text = (tmp_path / 'a' / 'mine.c').read_text()
    assert 'MAX_GAP INT64_C(5000000000)' in text
    assert 'RECOVER_AFTER 7' in text
    kr.export('dc_motor', tmp_path / 'b', max_gap=3.0, recover_after=0, compile=False)
    text = (tmp_path / 'b' / 'dc_motor.c').read_text()
    assert 'MAX_GAP INT64_C(3000000000)' in text
    assert 'RECOVER_AFTER 0' in text


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize('own', [False, True])
def test_what_failed_leaves_nothing_of_ours(own, tmp_path, monkeypatch):
    folder = tmp_path / 'c'
    written = write(of_scenario('dc_motor'), folder, 'loop', steps=20)
    if own:
        (folder / 'notes.txt').write_text('mine')
    vectors = (folder / 'vectors.txt').read_text().replace('0x1.', '0x1.8')
    (folder / 'vectors.txt').write_text(vectors)
    with pytest.raises(ValueError, match='^make failed: check: FAIL'):
        build(written)
    assert [each.name for each in tmp_path.rglob('*')] == (['c', 'notes.txt'] if own else [])


def test_a_disk_that_is_full_leaves_nothing(tmp_path, monkeypatch):
    original, left = Path.write_text, iter((True, True, False))

    def write_text(self, *text):
        if not next(left):
            original(self, 'a part')
            raise OSError(28, 'No space left on device')
        return original(self, *text)

    monkeypatch.setattr(Path, 'write_text', write_text)
    with pytest.raises(ValueError, match='^out: cannot write to .*: No space left on device$'):
        write(of_scenario('dc_motor'), tmp_path / 'c', 'loop', steps=20)
    assert not (tmp_path / 'c').exists()


@pytest.mark.slow
@needs_a_compiler
def test_the_stack_does_not_depend_on_the_name(tmp_path):
    stacks = [
        build(write(of_scenario('dc_motor'), tmp_path / name, name, steps=20)).stack
        for name in ('ch', 'k')
    ]
    assert stacks[0] == stacks[1]


@pytest.mark.parametrize('name', ['Makefile', 'makefile', 'check', 'math'])
def test_a_name_is_no_file_that_is_there_or_in_c(name, tmp_path):
    with pytest.raises(ValueError, match=f"name: expected another than '{name}'"):
        write(of_scenario('dc_motor'), tmp_path / 'c', name)


def test_the_header_tells_what_a_robot_has(tmp_path):
    arm = {'position.mount.translation': [0.8, 0.3, 0.0]}
    header = loop_files(of_scenario('robot_2d', arm), 'loop', 'float64', 'a test')['loop.h']
    assert 'After more than 60 s the first belief is taken again.' in header
    assert 'at its place, (0.8, 0.3, 0) m forward, left and up of the centre' in header
    assert 'loop_control' not in header
    header = loop_files(of_scenario('cart_pole'), 'loop', 'float64', 'a test')['loop.h']
    assert 'LOOP_NOT_FINITE of loop_control are worth' in header
    assert 'in parts of at most 0.01 s, up to 6000: one\n * after a pause' in header
    assert max(map(len, header.splitlines())) < 120
