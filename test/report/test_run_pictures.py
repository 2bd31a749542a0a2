# SPDX-License-Identifier: Apache-2.0
"""What the pictures of a run claim."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.report.ellipse import outline
from kalman_ros.report.maps import route
from kalman_ros.report.run_pictures import errors, overview, states
from kalman_ros.report.style import TRUTH, caption, envelope
from kalman_ros.simulation import closed_loop

matplotlib.use('agg')


@pytest.fixture(scope='module')
def tracked():
    """A run long enough for its filter to be better than the bound on this path."""
    built = scenario.build({'model': 'bearing_tracker', 'rate': 1.0})
    return built, closed_loop.run(built, None, 400.0, 0)


def drawn_at_best(built, run, tmp_path):
    """Return the upper edge (N, n) of the band at best, in standard deviations."""
    axes = errors(built, run, tmp_path / 'errors.png')
    edges = [axis.collections[0].get_paths()[0].vertices for axis in axes[:, 0]]
    steps = len(run.time)
    return np.array([np.abs(edge[1 : steps + 1, 1]) for edge in edges]).T / 3.0


@pytest.mark.slow
def test_no_band_at_best_is_outside_of_that_of_a_filter_that_is_as_good_as_it_says(
    tracked, tmp_path
):
    built, run = tracked
    bound = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    bound, std = (np.sqrt(P.diagonal(axis1=1, axis2=2)) for P in (bound, run.covariance))
    assert np.any(bound > 1.05 * std)
    np.testing.assert_allclose(drawn_at_best(built, run, tmp_path), np.minimum(bound, std))


@pytest.mark.thorough
@pytest.mark.slow
def test_a_filter_that_claims_too_much_does_not_move_the_band_at_best(tracked, tmp_path):
    built, run = tracked
    bound = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    boast = replace(run, covariance=run.covariance / 100.0)
    np.testing.assert_allclose(
        drawn_at_best(built, boast, tmp_path), np.sqrt(bound.diagonal(axis1=1, axis2=2))
    )


@pytest.mark.slow
def test_the_axes_hold_truth_and_estimate(tracked, tmp_path):
    """An estimate 2 km off, with a band of its size, is inside its panel."""
    built, run = tracked
    wrong = replace(run, estimate=run.estimate + 2000.0)
    axes = overview(built, wrong, tmp_path / 'overview.png')
    for index, axis in enumerate(axes.flat):
        low, high = axis.get_ylim()
        inside = (low < wrong.estimate[:, index]) & (wrong.estimate[:, index] < high)
        assert np.mean(inside) > 0.95
        assert low < run.truth[:, index].min() < run.truth[:, index].max() < high


@pytest.mark.thorough
@pytest.mark.slow
def test_a_heading_beyond_half_a_turn_is_one_line_with_its_readings(tmp_path):
    built = scenario.build({'model': 'gnss_imu'})
    run = closed_loop.run(built, None, 2.0, 0)
    index = built.model.state.names.index(built.model.state.angles[0])
    turning = np.linspace(0.0, 20.0, len(run.time))
    truth = run.truth.copy()
    truth[:, index] = (turning + np.pi) % (2.0 * np.pi) - np.pi
    estimate = truth.copy()
    estimate[:, index] = (turning + 0.1 + np.pi) % (2.0 * np.pi) - np.pi
    turned = replace(run, truth=truth, estimate=estimate)
    axes = overview(built, turned, tmp_path / 'overview.png')
    lines = {line.get_label(): line.get_ydata() for line in axes.flat[index].lines}
    np.testing.assert_allclose(lines['truth'], turning, atol=1e-9)
    np.testing.assert_allclose(lines['estimate'], turning + 0.1, atol=1e-9)


@pytest.mark.slow
def test_the_close_up_shows_some_readings_from_the_start(tracked, tmp_path):
    built, run = tracked
    axes = states(built, run, tmp_path / 'states.png')
    assert axes[0, 1].get_xlim() == (0.0, 80.0)  # eight of one every 10 s
    assert axes[0, 1].lines[-1].get_xdata()[-1] == 80.0


def track(axis, colour):
    """Return the points of a track that is drawn in pieces, each with the first of the next."""
    lines = [line for line in axis.lines if line.get_color() == colour and line.get_alpha()]
    pieces = [line.get_xydata() for line in lines]
    return np.vstack([*(piece[:-1] for piece in pieces[:-1]), pieces[-1]])


@pytest.mark.slow
def test_a_map_has_the_track_ellipses_and_bearings(tracked, tmp_path):
    built, run = tracked
    axis = route(built, run, tmp_path / 'map.png')
    lines = {line.get_label(): line for line in axis.lines}
    np.testing.assert_array_equal(track(axis, TRUTH)[:, 0], run.truth[:, 0])
    # the past is paler
    pieces = [line.get_alpha() for line in axis.lines if line.get_linewidth() == 2.0]
    assert pieces == sorted(pieces) and len(set(pieces)) == len(pieces) > 3
    assert pieces[-1] == 1.0
    assert 'bearing' in lines
    assert len(axis.patches) == 12
    first = axis.patches[0].get_xy()[:-1]
    expected = outline(run.estimate[0, :2], run.covariance[0, :2, :2], 3.0)
    np.testing.assert_allclose(first, expected)


def test_an_outline_is_at_its_distance():
    P = np.array([[4.0, 1.0], [1.0, 2.0]])
    d = outline(np.array([1.0, -1.0]), P, 2.0) - [1.0, -1.0]
    np.testing.assert_allclose(np.einsum('ki,ij,kj->k', d, np.linalg.inv(P), d), 4.0)


def test_there_is_no_map_of_a_level(tmp_path):
    built = scenario.build({'model': 'level'})
    run = closed_loop.run(built, None, 1.0, 0)
    with pytest.raises(ValueError, match='state: expected x and y, or x and z, got level'):
        route(built, run, tmp_path / 'map.png')


@pytest.mark.slow
def test_a_caption_is_on_every_picture_drawn_meanwhile(tracked, tmp_path):
    built, run = tracked
    with caption('bearing_tracker, seed 0'):
        named = route(built, run, tmp_path / 'map.png')
    title, shows = named.figure.get_suptitle().splitlines()
    assert title == 'bearing_tracker, seed 0'
    assert route(built, run, tmp_path / 'map.png').figure.get_suptitle() == shows


def test_a_sawtooth_is_drawn_by_its_envelope():
    time = np.arange(6000) * 0.01
    saw = 1.0 + 0.1 * (np.arange(6000) % 5)
    at, top = envelope(time, saw, 300)
    assert len(at) == len(top) == 300
    np.testing.assert_allclose(top, 1.4)
    assert at[0] == 0.0 and np.allclose(np.diff(at), 0.2)
    # what is short is drawn as it is
    np.testing.assert_array_equal(envelope(time[:500], saw[:500], 300)[1], saw[:500])
