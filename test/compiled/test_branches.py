# SPDX-License-Identifier: Apache-2.0
"""Functions that decide by the state are recorded in each of their ways."""

import numpy as np
import pytest

pytest.importorskip('casadi')

import casadi

from kalman_ros.compiled.branches import MOST_WAYS
from kalman_ros.compiled.symbols import by_ways, symbols
from kalman_ros.compiled.tracing import trace
from kalman_ros.compiled.untraceable import UntraceableError


def dead_zone(x):
    if x[0] > 0.5:
        return [x[0] - 0.5, x[1]]
    if x[0] < -0.5:
        return [x[0] + 0.5, x[1]]
    return [0.0, x[1]]


def largest(x):
    return [max(x), min(x[0], x[1], 0.25)]


def nested(x):
    sign = 1.0 if (x[0] > 0.0 and x[1] > 0.0) or x[0] < -1.0 else -1.0
    return [sign * x[0], sign if not x[1] > 0.0 else 2.0]


def guarded(x):
    return [np.sin(x[0]) / x[0] if x[0] != 0.0 else 1.0, np.sqrt(x[1]) if x[1] >= 0.0 else 0.0]


def rounded(x):
    return [round(x[0]), +x[1]]


POINTS = [np.array(each) for each in (
    (0.7, 0.2), (-0.7, 0.2), (0.1, -0.2), (0.0, -1.0), (-1.5, 0.3), (0.5, 0.5), (2.5, 0.0),
)]  # fmt: skip


@pytest.mark.parametrize('function', [dead_zone, largest, nested, guarded, rounded])
def test_each_way_is_what_the_function_returns(function):
    formulas = trace(function, (POINTS[0],)).function('f')
    for x in POINTS:
        np.testing.assert_allclose(np.array(formulas(x))[:, 0], function(x), rtol=1e-15)


def test_the_derivative_is_that_of_the_way():
    slope = trace(dead_zone, (POINTS[0],)).slope(0, np.array([0.2, 0.0])).function('f')
    assert np.array(slope()['o0']).tolist() == [[0.0, 0.0], [0.0, 1.0]]
    slope = trace(dead_zone, (POINTS[0],)).slope(0, np.array([0.9, 0.0])).function('f')
    assert np.array(slope()['o0']).tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_the_same_question_is_asked_once():
    runs = []

    def asks(x):
        runs.append(x)
        return [sum(1.0 for _ in range(20) if x[0] > 0.0)]

    trace(asks, (POINTS[0],))
    assert len(runs) == 2 + 1  # with symbols both ways, and with numbers


def test_what_one_way_changes_in_its_arguments_is_not_seen_by_the_next():
    def changing(x):
        if x[0] > 0.0:
            x[1] = 3.0
        return [x[1], x[0]]

    formulas = trace(lambda x: changing(x.copy()), (POINTS[0],)).function('f')
    variables, x = symbols(2)
    ways = by_ways(changing, x)
    direct = casadi.Function('f', [variables], [casadi.vertcat(*(way.formula for way in ways))])
    for point in POINTS:
        np.testing.assert_allclose(np.array(direct(point)), np.array(formulas(point)))


def test_a_loop_without_an_end_is_refused():
    def halved(x):
        y = x[0]
        while y > 1.0:
            y = 0.5 * y
        return [y]

    with pytest.raises(UntraceableError, match=f'more than {MOST_WAYS} ways'):
        trace(halved, (POINTS[0],))


def test_more_ways_than_are_recorded_are_refused():
    def many(x):
        return [sum(x[0] if x[0] > 0.1 * k else x[1] for k in range(MOST_WAYS))]

    with pytest.raises(UntraceableError, match=f'more than {MOST_WAYS} ways'):
        trace(many, (POINTS[0],))


def test_a_size_that_depends_on_the_state_is_refused():
    with pytest.raises(UntraceableError, match='the size of its result'):
        trace(lambda x: [x[0]] if x[0] > 0.0 else [x[0], x[1]], (POINTS[0],))


@pytest.mark.parametrize('function', [bool, lambda x: [float(x[0] > 0.0)]])
def test_what_is_no_decision_is_refused(function):
    with pytest.raises(UntraceableError):
        trace(function, (POINTS[0],))


def test_nothing_is_decided_where_nothing_is_recorded():
    from kalman_ros.compiled.symbols import symbols

    _, x = symbols(1)
    with pytest.raises(UntraceableError):
        bool(x[0] > 0.0)
    assert bool((0.0 * x[0]) == 0.0)
