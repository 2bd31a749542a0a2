# SPDX-License-Identifier: Apache-2.0
"""Pictures of gains, innovations, inputs and maps show the numbers of the run."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.control.limiter import Limits, limits_of
from kalman_ros.report.gain_pictures import gains
from kalman_ros.report.innovation_pictures import correlations, innovations
from kalman_ros.report.maps import observer, route, sights
from kalman_ros.report.run_pictures import errors, force, overview, states
from kalman_ros.report.style import caption
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.trajectory import Series

matplotlib.use('agg')


@pytest.fixture(scope='module')
def loop():
    built = scenario.build({'model': 'mass_spring_damper'})
    return built, closed_loop.run(built, feedback(built).gain, 4.0, 0)


@pytest.fixture(scope='module')
def ship():
    built = scenario.build({'model': 'bearing_tracker', 'rate': 1.0})
    command = lambda time: np.array([0.01, -0.02])  # noqa: E731
    return built, closed_loop.run(built, None, 100.0, 0, command=command)


def lines(axis):
    return {line.get_label(): np.array(line.get_data()) for line in axis.lines}


def grown(built, P):
    step = built.model.transition(*built.model.equilibrium, 1.0 / built.rate)
    return step.F @ P @ step.F.T + step.Q


@pytest.mark.thorough
@pytest.mark.slow
def test_the_start_shows_the_prediction_and_the_update_of_each_step(loop, tmp_path):
    built, run = loop
    axes = gains(built, run, tmp_path / 'gains.png')
    time, std = lines(axes[0, 1])['x']
    predicted = np.sqrt(grown(built, run.covariance[4])[0, 0])
    np.testing.assert_allclose(time[9:11], run.time[5])
    np.testing.assert_allclose(std[9:11], [predicted, np.sqrt(run.covariance[5, 0, 0])])
    assert std[9] > std[10]


@pytest.mark.slow
def test_the_gain_is_that_of_the_filter(loop, tmp_path):
    """K S = P- C', for the only sensor that has a reading at its time."""
    built, run = loop
    axes = gains(built, run, tmp_path / 'gains.png')
    time, K = lines(axes[list(built.enabled).index('velocity') + 2, 1])['v by v']
    k = 3  # no position is read then
    step = np.searchsorted(run.time, time[k] - 1e-9)
    assert not np.isclose(run.innovations['position'].time, time[k]).any()
    P = grown(built, run.covariance[step - 1])
    R = built.sensors['velocity'].sensor.covariance
    np.testing.assert_allclose(K[k], P[1, 1] / (P[1, 1] + R[0, 0]))


@pytest.mark.thorough
@pytest.mark.slow
def test_a_gain_uses_the_covariance_in_the_message(loop, tmp_path):
    built = scenario.build({'model': 'mass_spring_damper', 'velocity.covariance_from': 'message'})
    run = loop[1]
    series = run.readings['velocity']
    R = built.sensors['velocity'].sensor.covariance
    carried = Series(series.time, series.values, np.tile(4.0 * R, (len(series.time), 1, 1)))
    wide = replace(run, readings={**run.readings, 'velocity': carried})
    row = list(built.enabled).index('velocity') + 2
    K, quarter = (
        lines(gains(built, each, tmp_path / 'gains.png')[row, 0])['v by v'][1]
        for each in (run, wide)
    )
    np.testing.assert_allclose(quarter, K / 4.0)


@pytest.mark.thorough
@pytest.mark.slow
def test_a_filter_without_such_a_gain_has_none_drawn(ship, tmp_path):
    built, run = ship
    bank = replace(built, filter='gaussian_sum')
    assert len(gains(bank, run, tmp_path / 'gains.png')) == 2  # metres, and metres per second
    assert len(gains(replace(built, filter='ekf'), run, tmp_path / 'gains.png')) == 3


@pytest.mark.slow
def test_innovations_have_a_histogram_and_correlations(loop, tmp_path):
    built, run = loop
    axes = innovations(built, run, tmp_path / 'innovations.png')
    assert axes.shape == (2, 3)
    of = run.innovations['position']
    steps = axes[0, 1].patches[0].get_data()
    assert np.sum(steps.values * np.diff(steps.edges)) == pytest.approx(1.0)
    drawn = [segment[1, 1] for segment in axes[0, 2].collections[-1].get_segments()]
    normalized = of.values[:, 0] / of.std[:, 0]
    np.testing.assert_allclose(drawn, correlations(normalized))


def test_correlations_are_those_of_the_definition():
    v = np.random.default_rng(1).normal(size=2000)
    v[1:] += 0.8 * v[:-1]
    expected = [np.sum(v[:-k] * v[k:]) / np.sum(v**2) for k in (1, 2)]
    np.testing.assert_allclose(correlations(v)[:2], expected)
    assert correlations(v)[0] > 0.4
    np.testing.assert_array_equal(correlations(np.zeros(8)), [0.0, 0.0])
    assert correlations(v[:3]).size == 0


@pytest.mark.slow
def test_innovations_outside_of_the_panel_are_counted(loop, tmp_path):
    built, run = loop
    of = run.innovations['velocity']
    values = of.values.copy()
    values[7] = 1e4
    wild = {**run.innovations, 'velocity': replace(of, values=values)}
    axes = innovations(built, replace(run, innovations=wild), tmp_path / 'innovations.png')
    assert axes[1, 0].get_title('right') == '1 outside of the panel'
    assert axes[1, 0].get_ylim()[1] < 100.0


@pytest.mark.slow
def test_limits_are_drawn_in_the_picture_of_the_input(loop, tmp_path):
    built, run = loop
    bounds = limits_of(1, {'input_limit': 20.0})
    axis = force(built, run, tmp_path / 'force.png', bounds)[0, 0]
    assert [line.get_ydata()[0] for line in axis.lines[1:]] == [-20.0, 20.0]
    assert axis.get_title('right') == 'limits -20 and 20 N'
    assert len(force(built, run, tmp_path / 'force.png', Limits.none(1))[0, 0].lines) == 1


@pytest.mark.slow
def test_an_error_that_outgrows_its_band_stays_in_the_panel(loop, tmp_path):
    built, run = loop
    wrong = replace(run, estimate=run.estimate + np.array([7.0, 0.0]))
    low, high = errors(built, wrong, tmp_path / 'errors.png')[0, 0].get_ylim()
    assert low < -7.0 < 7.0 < high


@pytest.mark.thorough
@pytest.mark.slow
def test_the_unit_of_time_is_that_of_the_caption(loop, tmp_path):
    built, run = loop
    with caption('a river', 'years'):
        axes = states(built, run, tmp_path / 'states.png')
    assert axes[-1, 0].get_xlabel() == 'time [years]'
    assert 'years' in axes[0, 1].get_title('left')
    assert states(built, run, tmp_path / 'states.png')[-1, 0].get_xlabel() == 'time [s]'


@pytest.mark.slow
def test_the_map_of_a_relative_state_has_the_track_of_its_observer(ship, tmp_path):
    """With a constant acceleration a it is a t^2 / 2, and the target keeps its velocity."""
    built, run = ship
    own = observer(built, run)
    np.testing.assert_allclose(own, 0.5 * run.time[:, np.newaxis] ** 2 * [0.01, -0.02], atol=1e-9)
    axis = route(built, run, tmp_path / 'map.png')
    np.testing.assert_allclose(lines(axis)['observer'].T, own)
    # drawn in pieces, each with the first point of the next
    pieces = [line.get_xydata() for line in axis.lines if line.get_linewidth() == 2.0]
    truth = np.vstack([*(piece[:-1] for piece in pieces[:-1]), pieces[-1]])
    np.testing.assert_allclose(truth, run.truth[:, :2] + own)
    assert np.linalg.norm(np.diff(truth, 2, axis=0), axis=1).max() < 0.1
    (sight,) = sights(built, run)
    np.testing.assert_allclose(sight.place[-1], own[np.searchsorted(run.time, sight.time[-1])])


def test_a_state_that_is_not_relative_has_no_observer(loop):
    assert observer(*loop) is None
    plain = scenario.build({'model': 'mass_spring_damper_2d'})
    assert observer(plain, loop[1]) is None


@pytest.mark.thorough
@pytest.mark.slow
def test_the_last_of_an_odd_number_of_states_has_its_row_alone(tmp_path):
    built = scenario.build({'model': 'diff_drive'})
    run = closed_loop.run(built, None, 0.2, 0)
    axes = overview(built, run, tmp_path / 'overview.png')
    assert axes[2, 0] is axes[2, 1]
    assert axes[2, 0].get_ylabel() == built.model.state.label('omega')
    assert axes[2, 0].get_position().width > 1.9 * axes[1, 0].get_position().width
    assert len(axes[0, 0].figure.axes) == 5
