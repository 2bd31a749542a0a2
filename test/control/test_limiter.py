# SPDX-License-Identifier: Apache-2.0
"""Inputs within limits: magnitude, change per second, and the way to the idle input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalman_ros.control.limiter import LIMITS, Limiter, limits_of

IDLE, INF = np.array([1.0, -2.0]), np.inf


def limiter(magnitude=(np.inf, np.inf), rate=(np.inf, np.inf), idle=IDLE):
    return Limiter(limits_of(2, {'input_limit': magnitude, 'input_rate_limit': rate}), idle)


@pytest.mark.parametrize('seconds', [0.0, 0.01])
def test_one_input_may_be_limited_and_another_not(seconds):
    held = limiter(rate=(10.0, np.inf), idle=np.zeros(2))
    found = held.toward(np.array([3.0, 3.0]), seconds)
    np.testing.assert_allclose(found, [10.0 * seconds, 3.0])
    np.testing.assert_allclose(held.toward_idle(seconds), [0.0, 0.0])


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(0.0, 1.0)), max_size=20))
def test_no_input_is_beyond_its_limits_whatever_is_wanted(asked):
    held = limiter((5.0, np.inf), (10.0, 3.0))
    for wanted, seconds in asked:
        before = held.value
        after = held.toward(np.full(2, wanted), seconds)
        assert abs(after[0]) <= 5.0
        assert np.all(np.abs(after - before) <= np.array([10.0, 3.0]) * seconds + 1e-9)


def test_it_starts_idle_and_comes_back_to_exactly_that():
    held = limiter(rate=(3.0, 0.7))
    assert held.at_idle
    held.toward(np.array([5.0, 5.0]), 0.3)
    assert not held.at_idle
    for _ in range(40):
        held.toward_idle(0.01)
    np.testing.assert_array_equal(held.value, IDLE)
    held.toward(np.array([5.0, 5.0]), 0.3)
    np.testing.assert_array_equal(held.jump_to_idle(), IDLE)


def test_a_smaller_magnitude_is_reached_no_faster_than_the_rate_allows():
    held = limiter(rate=(10.0, 10.0), idle=np.zeros(2))
    held.toward(np.full(2, 9.0), 1.0)
    held.adopt(limits_of(2, {'input_limit': 2.0, 'input_rate_limit': 10.0}), np.zeros(2))
    np.testing.assert_allclose(held.toward(np.full(2, 9.0), 0.1), 8.0)


def test_an_idle_input_beyond_the_limit_is_refused():
    with pytest.raises(
        ValueError, match=r'input_limit: expected limits that contain the idle input'
    ):
        limiter(magnitude=(1.0, 1.0))


def test_an_input_may_have_another_limit_below_than_above():
    limits = limits_of(3, {'input_limit': [20.0, 5.0, 3.0], 'input_lower_limit': [0, -INF, 1.0]})
    np.testing.assert_array_equal(limits.lower, [0.0, -5.0, 1.0])
    held = Limiter(limits, np.array([10.0, 0.0, 2.0]))
    np.testing.assert_array_equal(held.toward(np.full(3, -9.0), 0.1), [0.0, -5.0, 1.0])
    np.testing.assert_array_equal(held.toward(np.full(3, 99.0), 0.1), [20.0, 5.0, 3.0])
    assert held.limited == 2
    with pytest.raises(ValueError, match=r'^input_lower_limit: .* the idle input \[0.0, 0.0, 0'):
        held.adopt(limits, np.zeros(3))
    with pytest.raises(ValueError, match=r'^input_limit: .* the input at rest \[10.0, -6.0, 2.0'):
        limits.check('the input at rest', np.array([10.0, -6.0, 2.0]))


def test_a_lower_limit_above_the_upper_is_refused():
    with pytest.raises(ValueError, match=r'input_lower_limit: expected at most the input_limit'):
        limits_of(1, {'input_limit': 5.0, 'input_lower_limit': 5.1})
    assert limits_of(1, {'input_limit': 5.0, 'input_lower_limit': 5.0}).upper == 5.0


@pytest.mark.parametrize('name', LIMITS)
@pytest.mark.parametrize('wrong', [np.nan, 'abc', {'a': 1}, None, [[1.0], [2.0, 3.0]]])
def test_a_limit_that_is_no_number_is_named(name, wrong):
    with pytest.raises(ValueError, match=f'^{name}: expected numbers'):
        limits_of(1, {name: wrong})
