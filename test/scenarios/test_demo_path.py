# SPDX-License-Identifier: Apache-2.0
"""The demo of a file with a path: the robot follows it, and the map shows both."""

import json
from pathlib import Path

import pytest

from kalman_ros.programs import demo

FILE = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'


@pytest.mark.thorough
def test_the_robot_of_the_example_follows_its_path(tmp_path, capfd):
    with pytest.raises(SystemExit) as stop:
        demo.main([str(FILE), '--out', str(tmp_path)])
    assert stop.value.code == 0
    checks = json.loads((tmp_path / 'summary.json').read_text())['checks']
    measured = {check['name']: check['measured'] for check in checks}
    assert measured['distance from the path, RMS'] < 0.02
    assert measured['distance from the path, largest'] < 0.06
    assert measured['distance from its end'] < 0.03
    said = capfd.readouterr().out
    assert 'distance from its end [m]' in said and 'ends on the path' not in said
    assert (tmp_path / 'map.png').stat().st_size > 10_000


@pytest.mark.slow
def test_a_path_that_is_refused_is_an_error_with_its_reason(tmp_path, capfd):
    command = [str(FILE), '--out', str(tmp_path), '-p', 'path_speed:=5.0']
    with pytest.raises(SystemExit) as stop:
        demo.main(command)
    assert stop.value.code == 2
    text = ' '.join(capfd.readouterr().err.split())
    assert 'demo: reference/path: ' in text
    assert 'a slower motion' in text


@pytest.mark.slow
def test_a_run_that_ends_on_the_path_says_so(tmp_path, capfd):
    with pytest.raises(SystemExit):
        demo.main([str(FILE), '--out', str(tmp_path), '--duration', '4'])
    said = ' '.join(capfd.readouterr().out.split())
    assert 'It ends on the path, at 4.00 of ' in said
