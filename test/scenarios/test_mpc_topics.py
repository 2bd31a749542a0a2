# SPDX-License-Identifier: Apache-2.0
"""``law: mpc`` over topics: as in the simulation, with its counts, and live."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

import kalman_ros as kr
from kalman_ros.harness import Run

FILE = Path(__file__).parents[2] / 'docs' / 'examples' / 'cart_on_a_track.yaml'


def test_the_example_of_the_page_stays_on_its_track_as_in_the_simulation():
    with Run(str(FILE), seed=2) as run:
        run.advance(2.0)
        run.refresh('controller')
        followed = run.trajectory()
        planned = int(run.reported('controller', 'inputs planned within limits'))
        assert run.reported('controller', 'law') == 'mpc'
        assert run.reported('controller', 'plans too late') == '0'
    assert planned > 10
    assert np.abs(followed.truth[:, 0]).max() < 1.0
    assert np.abs(followed.input).max() <= 10.0
    simulated = kr.simulate(str(FILE), seconds=2.0, seed=2)
    np.testing.assert_allclose(followed.input, simulated.input, atol=1e-6)
    np.testing.assert_allclose(followed.truth, simulated.truth, atol=1e-6)


@pytest.mark.thorough
def test_limits_are_changed_while_it_runs():
    begun = {'initial_state': [2.0, 0.0], 'initial_estimate': [2.0, 0.0]}
    controls = {'law': 'mpc', 'input_limit': [4.0]}
    with Run('mass_spring_damper', {**begun, 'law': 'mpc'}, only={'controller': controls}) as run:
        run.advance(0.2)
        assert 'is outside of' not in run.processes['controller'].output()
        run.set_parameters({'state_limit.v': [-0.5, 0.5]}, 'controller')
        run.set_parameters({'state_cost': [2.0, 2.0]}, 'controller')
        run.advance(3.0)
        followed = run.trajectory()
        log = run.processes['controller'].output()
    assert 'state_limit.v: -' in log
    assert 'is outside of -0.5 to 0.5, and goes there' in log
    assert log.count('is outside of') == 1
    assert np.abs(followed.truth[:25, 1]).max() > 0.7
    assert np.abs(followed.estimate[90:, 1]).max() < 0.7
    assert np.abs(followed.truth[-1, 0]) < 1.0


@pytest.mark.thorough
def test_the_law_changes_without_a_bump():
    with Run('cart_pole') as run:
        run.advance(1.0)
        for law in ('mpc', 'placement', 'lqi', 'lqr'):
            run.set_parameter('law', law, 'controller')
            if law == 'placement':
                poles = [-2.5, -3.8, -5.5, -7.0]
                run.set_parameter('regulator_poles', poles, 'controller')
            run.advance(1.0)
            run.refresh('controller')
            assert run.reported('controller', 'law') == law
        followed = run.trajectory()
    steps = np.abs(np.diff(followed.input[:, 0]))
    usual = steps[50:95].max()
    for second in range(1, 5):
        assert steps[100 * second - 2 : 100 * second + 3].max() < 1.5 * usual
    assert np.abs(followed.truth[:, 2]).max() < 0.5
