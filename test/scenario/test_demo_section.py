# SPDX-License-Identifier: Apache-2.0
"""The section of a demo: its duration, the unit of time of its pictures, and parameters."""

import pytest

from kalman_ros.scenario import shipped
from kalman_ros.scenario.demo_section import demo_section


def test_a_year_of_the_nile_is_a_second(tmp_path):
    found = demo_section(shipped.file('nile'))
    assert (found.duration, found.time_unit) == (100.0, 'years')


def test_other_names_are_parameters_of_every_node(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('demo:\n  ros__parameters: {rate: 10.0}\nplant:\n  ros__parameters: {}\n')
    assert demo_section(path) == (None, 's', {'rate': 10.0}, None)


@pytest.mark.parametrize('value', ['long', 'true', '[1.0]'])
def test_a_duration_is_a_number(tmp_path, value):
    path = tmp_path / 'robot.yaml'
    path.write_text(
        f'plant:\n  ros__parameters: {{}}\ndemo:\n  ros__parameters: {{duration: {value}}}\n'
    )
    with pytest.raises(ValueError, match='demo: duration: expected a number, got'):
        demo_section(path)


def test_a_unit_of_time_is_a_word(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('plant:\n  ros__parameters: {}\ndemo:\n  ros__parameters: {time_unit: 3}\n')
    with pytest.raises(ValueError, match="demo: time_unit: expected a word, got '3'"):
        demo_section(path)


def of_path(folder, value):
    path = folder / 'robot.yaml'
    path.write_text(
        f'plant:\n  ros__parameters: {{}}\ndemo:\n  ros__parameters: {{path: {value}}}\n'
    )
    return demo_section(path)


def test_a_path_is_a_list_of_positions(tmp_path):
    demo = of_path(tmp_path, '[0.0, 0, 1, 2.5]')
    assert demo.parameters == {}
    assert demo.path.tolist() == [[0.0, 0.0], [1.0, 2.5]]


@pytest.mark.parametrize('value', ['[0.0, 1]', '[0.0, 1.0, 2.0]', '[.nan, 0, 1, 1]', 'home', '3'])
def test_a_wrong_path_is_named(tmp_path, value):
    with pytest.raises(ValueError, match='demo: path: expected x, y of two positions or more'):
        of_path(tmp_path, value)
