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
