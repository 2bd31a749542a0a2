# SPDX-License-Identifier: Apache-2.0
"""What the live page says of the poles and gains of the estimator."""

import numpy as np
import pytest

from kalman_ros.estimators import build_filter
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.live_theory import theory
from kalman_ros.scenario import shipped

NAME = 'mass_spring_damper'


def shown(**parameters):
    found = Adjustments(shipped.file(NAME), parameters)
    believed = found.believed()
    return theory(believed, found.scenario('plant'), 0.0)['estimator'], believed


def test_a_placed_observer_shows_what_was_placed_beside_what_sampling_makes_of_it():
    wanted = {'observer_poles': [-3.0, -3.0], 'observer_frequencies': [2.0, -2.0]}
    found, believed = shown(filter='luenberger', **wanted)
    assert found['placed'] == [[-3.0, -2.0], [-3.0, 2.0]]
    poles = np.asarray(found['poles']) @ [1.0, 1j]
    assert np.abs(poles - [-3.0 - 2.0j, -3.0 + 2.0j]).max() < 0.5
    fixed = build_filter('luenberger', believed.plan, believed.filter_options)
    for name, gain in fixed.gains.items():
        np.testing.assert_allclose(found['gains'][name], gain.ravel(), rtol=1e-4)


@pytest.mark.parametrize('filter', ['kf', 'steady_state'])
def test_the_kalman_filter_has_no_placed_poles(filter):
    found, _ = shown(filter=filter)
    assert 'placed' not in found
    assert ('gains' in found) is (filter == 'steady_state')
    assert max(re for re, _ in found['poles']) < 0.0


@pytest.mark.parametrize(
    ('name', 'off', 'unseen'),
    [
        ('cart_pole', (), []),
        ('diff_drive', (), ['x', 'y', 'psi']),
        ('gnss_imu', (), []),
        ('gnss_imu', ('gnss',), ['x', 'y', 'psi', 'v']),
        ('submersible', (), ['x', 'u']),
    ],
)
def test_states_on_which_no_reading_depends_are_named(name, off, unseen):
    found = Adjustments(shipped.file(name), {f'{sensor}.enabled': False for sensor in off})
    shown = theory(found.believed(), found.scenario('plant'), 0.0)
    assert shown['unseen'] == unseen
