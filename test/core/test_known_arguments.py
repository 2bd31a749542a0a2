# SPDX-License-Identifier: Apache-2.0
"""A call that does not fit says what would."""

import inspect

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core.known_arguments import knows_arguments

A, B, C = [[0, 1], [0, 0]], [[0], [1]], [[1, 0]]


@knows_arguments('c belongs to another', Ts='dt')
def function(a, b=None, *, dt=0.0):
    """Return the sum."""
    return a + dt


@pytest.mark.parametrize(
    ('call', 'words'),
    [
        (lambda: function(1, Ts=2), "function has no argument 'Ts'; here it is dt"),
        (lambda: function(1, dtt=2), "function has no argument 'dtt'; did you mean 'dt'?"),
        (lambda: function(1, zzz=2), "function has no argument 'zzz'; it has a, b, dt"),
        (lambda: function(1, 2, 3), 'function: c belongs to another'),
        (lambda: function(), r"missing 1 required positional argument: 'a'"),
        (lambda: function('x'), 'can only concatenate str'),  # its own error stays
        (lambda: kr.lqe(A, np.eye(2), C, QN=np.eye(2), RN=1), "lqe has no argument 'QN'.* is W"),
        (lambda: kr.continuous_model(A, B, C, 0), r'belong to a sensor: kr.sensor\(C, R\)'),
        (lambda: kr.Gaussian([0], cov=[[1]]), "Gaussian has no argument 'cov'; .* is covariance"),
        (lambda: kr.discrete_model(A, B, Q=np.eye(2), dt=0.1), 'here it is period'),
        (lambda: kr.simulate('cart_pole', T=3.0), 'here it is seconds'),
        (lambda: kr.filter(None, x0=[0]), 'here it is initial, with P0'),
    ],
)
def test_a_wrong_argument_is_answered(call, words):
    with pytest.raises(TypeError, match=words):
        call()


def test_an_error_within_the_function_is_its_own():
    with pytest.raises(TypeError) as caught:
        function('x')
    assert caught.traceback[-1].name == 'function'


def test_what_fits_is_called_as_it_was():
    assert function(1, dt=2) == 3
    assert str(inspect.signature(function)) == '(a, b=None, *, dt=0.0)'
    assert function.__doc__ == 'Return the sum.'
