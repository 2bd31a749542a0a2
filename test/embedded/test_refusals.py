# SPDX-License-Identifier: Apache-2.0
"""What cannot become C is refused by name; nothing of a file becomes C without a check."""

from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr

pytest.importorskip('casadi')
from exported import of_scenario

from kalman_ros.embedded.identifiers import comment, identifier, part
from kalman_ros.embedded.source import loop_files
from kalman_ros.embedded.writing import write

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


def test_a_law_along_motions_alone_is_refused():
    with pytest.raises(ValueError, match='no input moves some of the states, and motions are not'):
        of_scenario(ROOT / 'docs' / 'examples' / 'robot_on_a_path.yaml')


def test_a_function_that_cannot_be_traced_is_named(tmp_path):
    def slides(x, u):
        return np.array([x[1], -1.0 if x[1] > 0.0 else 1.0])

    model = kr.continuous_model(slides, np.eye(2), states='x v')
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


def test_names_that_are_one_in_c_are_refused():
    loop = of_scenario('linear', {'sensors': ['position']})
    texts = loop_files(loop, 'loop', 'float64', 'x')
    assert 'loop_correct_position' in texts['loop.h']
    assert '*/ x' not in loop_files(loop, 'loop', 'float64', '*/ x')['loop.h']
