# SPDX-License-Identifier: Apache-2.0
"""Which estimates the controller acts upon, and the reason that it gives for the others."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Space
from kalman_ros.nodes.controller.guard import EstimateGuard, is_covariance

SECOND = 1_000_000_000
SPACE = Space(('x', 'v'), ('m', 'm/s'))


def trust(timeout=0.5, ahead=1.0, most=(1.0, 2.0), prior=(np.inf, np.inf)):
    return EstimateGuard(SPACE, timeout, ahead, np.array(most), np.array(prior))


def estimate(time=10 * SECOND, x=(0.0, 0.0), P=((0.5, -0.3), (-0.3, 0.5))):
    return Sample(time, np.array(x), np.array(P))


def test_a_good_estimate_is_trusted_with_negative_correlations_too():
    assert trust().reason(estimate(), 10 * SECOND + SECOND // 10) == ''


@pytest.mark.parametrize(
    ('doubtful', 'reason'),
    [
        (estimate(x=(np.nan, 0.0)), 'not finite'),
        (estimate(x=(0.0, np.inf)), 'not finite'),
        (estimate(time=9 * SECOND), '1 s old'),
        (estimate(time=12 * SECOND), '2 s ahead of the clock'),
        (estimate(P=((4.0, 0.0), (0.0, 1.0))), 'estimate of x is uncertain by 2, more than 1'),
        (estimate(P=((0.5, 0.0), (0.0, 4.1))), 'estimate of v'),
        (estimate(P=((-1.0, 0.0), (0.0, 1.0))), 'covariance'),
        (estimate(P=((np.nan, 0.0), (0.0, 1.0))), 'covariance'),
    ],
)
def test_the_reason_is_given(doubtful, reason):
    assert reason in trust().reason(doubtful, 10 * SECOND)


@pytest.mark.parametrize(
    ('age', 'reason'),
    [
        (SECOND // 2, ''),
        (SECOND // 2 + 1, '0.5 s old'),
        (-SECOND, ''),
        (-SECOND - 1, '1 s ahead of the clock'),
    ],
)
def test_a_stamp_may_be_old_and_ahead_of_the_clock_up_to_the_limits(age, reason):
    found = trust(timeout=0.5, ahead=1.0).reason(estimate(time=10 * SECOND - age), 10 * SECOND)
    assert found == (f'the estimate is {reason}' if reason else '')


@pytest.mark.parametrize(('variance', 'trusted'), [(3.99, True), (4.01, False)])
def test_the_limit_is_a_standard_deviation(variance, trusted):
    found = estimate(P=((0.5, 0.0), (0.0, variance)))
    assert (trust().reason(found, 10 * SECOND) == '') is trusted


def test_an_older_estimate_is_ignored_as_long_as_newer_ones_come():
    watch = trust()
    assert watch.reason(estimate(), None) == ''
    for count in range(100):
        at = 0.1 * count
        assert watch.is_old(9 * SECOND, at)
        assert not watch.is_old(10 * SECOND + count, at + 0.05)
        assert watch.reason(estimate(time=10 * SECOND + count), None) == ''


def test_time_that_starts_again_is_reported_once_and_soon():
    watch = trust()
    assert watch.reason(estimate(), None) == ''
    at = 100.0
    while watch.is_old(5 * SECOND, at):
        at += 0.01
    assert 100.2 < at < 100.3
    assert 'went back by 5 s' in watch.reason(estimate(time=5 * SECOND), None)
    assert not watch.is_old(5 * SECOND + 1, at)
    assert watch.reason(estimate(time=5 * SECOND + 1), None) == ''


def test_where_a_stamp_alone_tells_of_a_new_time_it_is_followed_at_once():
    watch = trust()
    assert watch.reason(estimate(), None) == ''
    assert not watch.is_old(5 * SECOND, None)
    assert 'went back by 5 s' in watch.reason(estimate(time=5 * SECOND), None)


def test_what_is_refused_makes_no_later_one_old():
    watch = trust()
    assert 'ahead' in watch.reason(estimate(time=99 * SECOND), 10 * SECOND)
    assert not watch.is_old(10 * SECOND, 0.0)
    assert watch.reason(estimate(), 10 * SECOND) == ''


def test_without_limits_every_finite_state_with_a_covariance_is_trusted():
    free = trust(timeout=0.0, most=(np.inf, np.inf))
    assert free.reason(estimate(), 10**12) == ''
    assert 'covariance' in free.reason(estimate(P=((-1.0, 0.0), (0.0, 1.0))), 10**12)


@pytest.mark.parametrize('scale', [1e-12, 1.0, 1e12])
def test_what_is_a_covariance(scale):
    units = np.array([1.0, scale])
    units = units * units[:, np.newaxis]
    good = [((1.0, 0.9), (0.9, 1.0)), ((1.0, 1.0), (1.0, 1.0)), ((0.0, 0.0), (0.0, 1.0))]
    rounded = np.array([[1.0, 1.0 + 1e-8], [1.0 + 1e-8, 1.0]])
    for P in (*good, np.zeros((2, 2)), rounded):
        assert is_covariance(np.array(P) * units), P
    bad = [((1.0, 1.1), (1.1, 1.0)), ((-1.0, 0.0), (0.0, 1.0)), ((0.0, 0.5), (0.5, 1.0))]
    for P in (*bad, ((1.0, np.nan), (np.nan, 1.0)), ((np.inf, 0.0), (0.0, 1.0))):
        assert not is_covariance(np.array(P) * units), P


def test_a_restarted_estimator_is_reported_once():
    watch = trust(most=(np.inf, np.inf))
    sure, unsure = ((1e-3, -1e-3), (-1e-3, 2.0)), ((1.0, 0.0), (0.0, 2.0))
    for P in (unsure, sure, sure):
        assert watch.reason(estimate(P=P), None) == ''
    assert 'was reset: x is as uncertain as at first' in watch.reason(estimate(P=unsure), None)
    assert watch.reason(estimate(P=unsure), None) == ''


def test_a_restart_is_recognised_by_the_initial_belief_too():
    """An estimator that was certain before the controller subscribed may restart."""
    watch = trust(most=(np.inf, np.inf), prior=(1.0, 2.0))
    assert watch.reason(estimate(P=1e-4 * np.eye(2)), None) == ''
    assert 'reset: v is' in watch.reason(estimate(P=np.diag([1e-4, 2.0])), None)


def test_other_limits_leave_what_is_known_of_the_estimator():
    watch = trust()
    assert watch.reason(estimate(P=np.eye(2)), None) == ''
    assert watch.reason(estimate(P=1e-3 * np.eye(2)), None) == ''
    watch.adopt(1.0, 1.0, np.array([3.0, 3.0]), np.array([np.inf, np.inf]))
    assert watch.reason(estimate(P=2.0 * np.eye(2)), None) != ''


def test_what_grows_slowly_or_from_little_is_no_new_start():
    watch = trust(most=(np.inf, np.inf))
    for variance in (1e-9, 1.0, 1e-3, 0.1, 1.0, 2.0):
        P = variance * np.eye(2)
        found = watch.reason(estimate(P=P), None)
        assert found == ''
    watch = trust(most=(np.inf, np.inf))
    for variance in (1.0, 1e-3, 0.02, 0.4, 1.0):
        assert watch.reason(estimate(P=variance * np.eye(2)), None) == ''


def test_time_that_went_back_explains_a_new_start_too():
    watch = trust(most=(np.inf, np.inf))
    watch.reason(estimate(P=np.eye(2)), None)
    watch.reason(estimate(P=1e-3 * np.eye(2)), None)
    assert not watch.is_old(SECOND, None)
    assert 'went back' in watch.reason(estimate(time=SECOND, P=np.eye(2)), None)
    assert watch.reason(estimate(time=SECOND + 1, P=np.eye(2)), None) == ''
