# SPDX-License-Identifier: Apache-2.0
"""What a live page is drawn from."""

import pytest

from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.controls import controls
from kalman_ros.live.scene import scene
from kalman_ros.scenario import shipped


@pytest.mark.parametrize(
    ('name', 'time', 'rate'), [('nile', 'years', 'per year'), ('level', 's', 'Hz')]
)
def test_a_scenario_whose_second_stands_for_a_year_has_years_everywhere(name, time, rate):
    found = Adjustments(shipped.file(name), {})
    shown = scene(found, controls(found))
    units = {control['unit'] for control in shown['controls']}
    assert shown['time'] == time
    assert {time, rate} <= units
    assert ('s' in units) == ('Hz' in units) == (time == 's')


@pytest.mark.parametrize(
    ('model', 'about'),
    [
        ('cart_pole', 'A pole balanced on a cart that is pushed by a force.'),
        ('kalman_ros.models.level:level', 'A random-walk level:'),
    ],
)
def test_a_scene_says_what_its_model_is_by_the_first_line_of_its_module(model, about):
    name = model.rpartition(':')[2]
    found = Adjustments(shipped.file(name), {'model': model})
    assert scene(found, controls(found))['about'].startswith(about)
