# SPDX-License-Identifier: Apache-2.0
"""The page of diagnostics has every key that the nodes report."""

import re
from pathlib import Path

import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from kalman_ros.estimators.outcome import Outcome
from kalman_ros.harness import Run

PAGE = (Path(__file__).parents[2] / 'docs' / 'reference' / 'diagnostics.md').read_text()
KEYS = {*re.findall(r'`([^`]+)`', PAGE)}


def pattern(key, scenario):
    """Return a key with the names of this scenario as the page writes them."""
    key = re.sub(r'^(subscribers|publishers): .*', r'\1: TOPIC', key)
    key = re.sub(r'^RMSE of .*', 'RMSE of STATE', key)
    for name in scenario.sensors:
        key = re.sub(rf'^{name} .*: error raw', 'SENSOR COORDINATE: error raw', key)
        key = re.sub(rf'^{name}: ', 'SENSOR: ', key)
        key = re.sub(rf'^NIS of {name} /', 'NIS of SENSOR /', key)
    return re.sub(rf'^{scenario.input.topic}: ', 'INPUT: ', key)


@pytest.mark.parametrize(
    'name', mostly_thorough(['mass_spring_damper_2d', 'diff_drive'], 'mass_spring_damper_2d')
)
def test_every_key_is_on_the_page(name):
    with Run(name) as run:
        run.advance(1.0)
        run.refresh('plant', 'estimator')
        found = {
            pattern(value.key, run.scenario)
            for status in run.diagnostics.values()
            for value in status.values
        }
    assert len(found) > 20
    assert found - KEYS == set()


def test_every_outcome_of_a_reading_is_on_the_page():
    assert {f'SENSOR: {outcome.value}' for outcome in Outcome} <= KEYS
