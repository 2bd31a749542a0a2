# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.core import is_finite, matrix, semidefinite, variances, vector


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: vector('x', [1.0, 2.0], 3), 'x: expected 3 numbers, got 2'),
        (lambda: vector('x', [1.0, float('nan')]), 'x: expected finite numbers'),
        (lambda: vector('x', 'abc'), 'x: expected numbers'),
        (lambda: vector('x', [1.0, 2j]), 'x: expected real numbers, got complex ones'),
        (lambda: vector('x', np.array([0, 1], 'M8[s]')), 'x: expected real numbers, got dates'),
        (lambda: vector('x', np.array([0, 1], 'm8[s]')), 'expected real numbers, got durations'),
        (lambda: matrix('A', [1.0] * 5, (2, 2)), 'A: expected 2 x 2 = 4 numbers, got 5 numbers'),
        (lambda: semidefinite('Q', [1.0] * 3, 2), 'Q: expected 2 numbers .* got 3'),
        (lambda: semidefinite('Q', [1.0, -1.0], 2), 'smallest eigenvalue is -1'),
        (lambda: semidefinite('Q', [1.0, 0.0], 2, definite=True), 'positive definite'),
        (lambda: semidefinite('Q', [1.0, 2.0, 0.0, 1.0], 2), 'symmetric'),
        (lambda: variances('noise', [0.1, 0.0], 2), 'noise: expected positive standard'),
    ],
)
def test_bad_arrays_are_named(call, says):
    with pytest.raises(ValueError, match=says):
        call()


def test_a_diagonal_or_a_whole_matrix():
    np.testing.assert_array_equal(semidefinite('Q', [1, 2], 2), np.diag([1.0, 2.0]))
    np.testing.assert_array_equal(
        semidefinite('Q', [2, 1, 1, 2], 2), np.array([[2.0, 1.0], [1.0, 2.0]])
    )


def test_negative_off_diagonals_are_fine():
    semidefinite('Q', [[1.0, -0.9], [-0.9, 1.0]], 2, definite=True)


def test_the_input_is_copied():
    given = np.ones(2)
    vector('x', given)[0] = 5.0
    assert given[0] == 1.0


def test_variances_are_the_squares_of_standard_deviations():
    np.testing.assert_array_equal(variances('noise', [0.5, 3.0], 2), np.diag([0.25, 9.0]))


@pytest.mark.parametrize('size', [1, 2, 16, 17, 100])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e200, -1e155])
def test_a_number_of_a_vector_that_is_not_finite_or_too_large_is_found(size, bad):
    values = np.full(size, 1e150)
    assert is_finite(values) and is_finite(values[:0])
    for at in {0, size // 2, size - 1}:
        others = values.copy()
        others[at] = bad
        with np.errstate(over='ignore'):
            assert not is_finite(others)


@pytest.mark.parametrize('size', [1, 8191, 8192, 20_000])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e200])
def test_a_number_that_is_not_finite_is_found_anywhere(size, bad):
    values = np.random.default_rng(0).normal(size=(size, 2))
    assert is_finite(values) and is_finite(values.T)
    values[size // 2, 1] = bad
    with np.errstate(over='ignore'):
        assert not is_finite(values) and not is_finite(values.T)
