# SPDX-License-Identifier: Apache-2.0
"""Models that are not linear, rest with an input, or have none, run by the real nodes."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.analysis.verdict import judge
from kalman_ros.harness import Run
from kalman_ros.simulation import closed_loop


def test_the_pole_is_balanced_by_the_filter_that_suits_it():
    with Run('cart_pole') as run:
        run.advance(5.0)
        loop = run.trajectory()
    assert loop.truth[0, 2] == 0.3
    assert np.abs(loop.truth[300:, 2]).max() < 0.15
    assert all(check.passed for check in judge(run.scenario, loop).checks)


@pytest.mark.thorough
def test_a_model_without_inputs_needs_no_controller():
    with Run('turn_rate') as run:
        run.advance(4.0)
        loop = run.trajectory()
        assert set(run.processes) == {'plant', 'estimator', 'monitor'}
        assert run.diagnostics['plant'].message == 'running'
    assert loop.input.shape == (len(loop.time), 0)
    assert len(loop.time) > 50
    error = run.scenario.model.state.subtract(loop.truth, loop.estimate)
    std = np.sqrt(loop.covariance.diagonal(axis1=1, axis2=2))
    assert np.mean(np.abs(error) < 3.0 * std) > 0.95


@pytest.mark.thorough
def test_an_observer_that_does_not_manoeuvre_says_that_it_does_not_know_the_range():
    values = {'rate': 1.0, 'bearing.rate': 0.1, 'state_cost': [1e-14, 1e-14, 0.0, 0.0]}
    with Run('bearing_tracker', values) as run:
        said = lambda: run.reported('estimator', 'observability')  # noqa: E731
        run.advance(300.0)
        unseen = 'the sensors observe none of x, y, v_x, v_y'
        run.wait(lambda: said() == unseen, 60.0, said)
        # in a hurry it steers for the target, and turns where it passes it
        run.set_parameter('state_cost', [1e-9, 1e-9, 1e-5, 1e-5], 'controller')
        for _ in range(9):
            run.advance(100.0)
            run.refresh('estimator')
            # the range; how fast the target moves away shows later
            if said().startswith('the sensors observe x, y'):
                break
        else:
            pytest.fail(f'it passed the target and still says: {said()}')
        loop = run.trajectory()
    off = np.hypot(*(loop.truth - loop.estimate)[:, :2].T)
    std = np.sqrt(np.trace(loop.covariance[:, :2, :2], axis1=1, axis2=2))
    assert std[300] > 500.0
    assert off[-1] < 3.0 * std[-1] < 100.0


@pytest.mark.thorough
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
def test_a_target_that_goes_round_and_round_is_not_lost_where_angles_wrap(filter):
    # a circle about the radar: bearing, and heading in a quaternion, pass pi again and again
    start = [10.0, 0.0, 10.0, np.pi / 2.0, 1.0]
    values = {
        'filter': filter,
        'rate': 20.0,
        'lidar.enabled': False,
        'radar.rate': 10.0,
        'model_parameters.acceleration_noise': 1e-6,
        'model_parameters.turn_noise': 1e-8,
        'initial_state': start,
        'initial_estimate': [11.0, 1.0, 9.0, 1.3, 0.8],
    }
    with Run('turn_rate', values) as run:
        run.advance(60.0)
        loop = run.trajectory()
    bearing = loop.readings['radar'].values[:, 1]
    for angle in (bearing, loop.truth[:, 3]):
        assert np.count_nonzero(np.abs(np.diff(angle)) > np.pi) >= 9
    assert all(check.passed for check in judge(run.scenario, loop).checks)
    error = run.scenario.model.state.subtract(loop.truth, loop.estimate)[100:]
    assert np.abs(error[:, 3]).max() < 0.1
    assert np.hypot(*error[:, :2].T).max() < 0.5


@pytest.mark.thorough
def test_two_bearings_over_topics_are_the_loop_in_one_process():
    with Run('two_bearings') as run:
        run.advance(10.0)
        loop, east = run.trajectory(), run.recorder['east/bearing']
    assert set(run.processes) == {'plant', 'estimator', 'monitor'}
    alone = closed_loop.run(run.scenario, None, 10.0, 0)
    np.testing.assert_allclose(loop.truth, alone.truth, atol=1e-9)
    np.testing.assert_allclose(loop.estimate, alone.estimate, atol=1e-9)
    # bearings go by quaternions, with their variance in the place of the yaw
    np.testing.assert_allclose(east.values, alone.readings['east'].values, atol=1e-12)
    np.testing.assert_allclose(east.covariance, np.full((len(east.stamp), 1, 1), 0.02**2))
