# SPDX-License-Identifier: Apache-2.0
"""The ascent to a maximum: on functions whose maxima are known."""

import numpy as np
import pytest

from kalman_ros.analysis.tuning import ascent
from kalman_ros.analysis.tuning.ascent import INTERRUPTED, climb, maximum
from kalman_ros.analysis.tuning.free_parameter import FreeParameter
from kalman_ros.analysis.tuning.likelihood import Expansion, Likelihood
from kalman_ros.analysis.tuning.observations import Observations, Readings

TOP = np.array([0.5, -0.25])
INFORMATION = np.array([[9.0, 2.0], [2.0, 4.0]])
FREE = [FreeParameter('a', 0.0), FreeParameter('b', 0.0)]


class Parabola:
    """A log-likelihood with one maximum, whose information may be wrong by a factor."""

    until = None

    def __init__(self, factor=1.0, parameters=FREE, top=TOP, readings=3):
        self.factor, self.parameters, self.top = factor, parameters, top
        self.start = np.zeros(2)
        self.passes = []
        stamp = np.arange(readings, dtype=np.int64)
        given = {'s': Readings(stamp, np.zeros((readings, 1)))}
        self.observations = Observations(given, np.zeros(0, dtype=np.int64), np.zeros((0, 0)))

    def first(self, count):
        return self

    def value(self, z):
        return -0.5 * float((z - self.top) @ INFORMATION @ (z - self.top))

    def values(self, points):
        return np.array([self.value(z) for z in points])

    def expand(self, z):
        gradient = -INFORMATION @ (z - self.top)
        return Expansion(z, self.value(z), self.value(z), gradient, self.factor * INFORMATION)

    def expand_all(self, points, report=None):
        self.passes.append(len(points))
        return [self.expand(np.asarray(z)) for z in points]


@pytest.mark.parametrize('factor', [1.0, 5.0, 0.3])
def test_the_top_is_reached_whatever_the_information(factor):
    """If it is too large by a factor, steps are short; if too small, they are shortened."""
    likelihood = Parabola(factor)
    (end,) = climb(likelihood, [likelihood.expand(np.zeros(2))], negligible=1e-9)
    np.testing.assert_allclose(end.top.z, TOP, atol=1e-4)
    assert not end.stopped and end.steps <= 12
    if factor == 1.0:
        assert end.steps <= 3


def test_an_ascent_ends_where_little_is_to_gain():
    likelihood = Parabola()
    near = TOP + np.array([0.01, 0.0])
    gain = -likelihood.value(near)
    for negligible, steps in ((1.01 * gain, 0), (0.99 * gain, 1)):
        (end,) = climb(likelihood, [likelihood.expand(near)], negligible=negligible)
        assert end.steps == steps


def test_an_ascent_near_a_known_top_ends_there():
    likelihood = Parabola()
    starts = [likelihood.expand(z) for z in (TOP, np.zeros(2))]
    first, second = climb(likelihood, starts, negligible=1e-9)
    assert first.top is starts[0] and second.top is first.top


@pytest.mark.parametrize(('distance', 'near'), [(4.9, True), (5.1, False)])
def test_five_deviations_are_near(distance, near):
    likelihood = Parabola()
    direction = np.array([1.0, 1.0]) / np.sqrt(np.array([1.0, 1.0]) @ INFORMATION @ [1.0, 1.0])
    there, top = likelihood.expand(TOP + distance * direction), likelihood.expand(TOP)
    assert ascent._is_near(there, top) is near
    assert not ascent._is_near(top, likelihood.expand(TOP + 0.01))  # which is lower


def limited(**options):
    return Parabola(parameters=[FreeParameter('a', 0.0, **options), FREE[1]])


def test_a_step_ends_at_a_limit_and_does_not_leave_it():
    likelihood = limited(high=0.2)
    (end,) = climb(likelihood, [likelihood.expand(np.zeros(2))], negligible=1e-12)
    high = FreeParameter('a', 0.0, high=0.2).limits[1]
    assert end.top.z[0] == pytest.approx(high, abs=1e-12)
    # the other one is at the best value beside it
    assert end.top.gradient[1] == pytest.approx(0.0, abs=1e-5)
    likelihood = limited(low=0.0, high=0.2)
    start = likelihood.expand(np.array([0.3, 0.0]))
    step, _ = ascent.scoring_step(likelihood, start, INFORMATION, 1e-6)
    assert step[0] == pytest.approx(high - 0.3)


@pytest.mark.parametrize(('positive', 'longest'), [(True, 2.0), (False, 20.0)])
def test_a_step_is_no_longer_than_its_scale_allows(positive, longest):
    free = [FreeParameter('a', 1.0, positive=positive), FREE[1]]
    far = Parabola(parameters=free, top=np.array([100.0, -0.25]))
    step, gain = ascent.scoring_step(far, far.expand(np.zeros(2)), INFORMATION, 1e-6)
    assert step[0] == pytest.approx(longest)
    assert gain == pytest.approx(0.5 * far.expand(np.zeros(2)).gradient @ step)
    near = Parabola(parameters=free)
    step, gain = ascent.scoring_step(near, near.expand(np.zeros(2)), INFORMATION, 1e-6)
    np.testing.assert_allclose(step, TOP, rtol=1e-4)
    assert gain == pytest.approx(-near.value(np.zeros(2)), rel=1e-4)


@pytest.mark.parametrize(('information', 'moves'), [(1.1e-6, True), (0.9e-6, False)])
def test_what_the_data_do_not_show_is_not_moved(information, moves):
    likelihood = Parabola()
    J = np.diag([information, 4.0])
    step, _ = ascent.scoring_step(likelihood, likelihood.expand(np.array([0.0, 1.0])), J, 1e-6)
    assert bool(step[0]) is moves and step[1] != 0.0
    blind, gain = ascent.scoring_step(likelihood, likelihood.expand(np.zeros(2)), 0.0 * J, 1e-6)
    assert not blind.any() and gain == 0.0


def test_the_information_is_corrected_to_the_curvature_along_the_path():
    likelihood = Parabola(3.0)
    path = [likelihood.expand(np.array(z)) for z in ([0.0, 0.0], [0.3, 0.1], [0.2, -0.4])]
    J = ascent._corrected_information(path)
    s = path[2].z - path[1].z
    np.testing.assert_allclose(J @ s, INFORMATION @ s)
    np.testing.assert_allclose(J, J.T, atol=1e-12)
    assert np.linalg.eigvalsh(J)[0] > 0.0
    np.testing.assert_array_equal(ascent._corrected_information(path[:1]), 3.0 * INFORMATION)
    # against the curvature, a change of the gradient corrects nothing
    path[2].gradient[:] = path[1].gradient + INFORMATION @ s
    first = ascent._corrected_information(path[:2])
    path[2].information[:] = path[1].information
    np.testing.assert_allclose(ascent._corrected_information(path), first)


def test_the_highest_start_and_others_are_followed():
    likelihood = Parabola()
    end = maximum(likelihood)
    np.testing.assert_allclose(end.top.z, TOP, atol=1e-5)
    assert end.before == likelihood.value(np.zeros(2))
    assert likelihood.passes[0] == 2
    points = ascent._starts(likelihood, likelihood.start, 0)
    assert len(points) == 49 and not points[0].any()
    assert np.std(points[1:]) == pytest.approx(1.0, rel=0.25)
    wide = Parabola(parameters=[FreeParameter(n, 1.0, positive=True) for n in 'ab'])
    np.testing.assert_allclose(ascent._starts(wide, wide.start, 0)[1:], 1.5 * np.array(points[1:]))
    narrow = limited(low=-0.1, high=0.1)
    narrow = ascent._starts(narrow, narrow.start, 0)
    assert np.abs(np.array(narrow)[:, 0]).max() <= 0.1


def test_the_first_part_is_as_long_as_is_worth_while():
    def part(readings, until=None):
        stamp = np.arange(readings, dtype=np.int64)[::-1].copy()
        given = {'s': Readings(stamp, np.zeros((readings, 1)))}
        observed = Observations(given, np.zeros(0, dtype=np.int64), np.zeros((0, 0)))
        likelihood = Likelihood([], None, observed, None, until)
        first = likelihood.first(ascent.SHORT)
        return first is likelihood, first.until

    assert part(1000) == (True, None)
    assert part(1001) == (False, 500)
    assert part(5000, until=999) == (True, 999)
    assert part(5000, until=1000) == (False, 500)


def test_no_start_with_a_likelihood_is_an_error():
    likelihood = Parabola()
    likelihood.values = lambda points: np.full(len(points), -np.inf)
    with pytest.raises(ValueError, match='no likelihood at the start, nor at any other'):
        maximum(likelihood)
    likelihood = Parabola()
    likelihood.expand_all = lambda points, report=None: [None for _ in points]
    with pytest.raises(ValueError, match='no likelihood near any start'):
        maximum(likelihood)


def test_an_interrupt_gives_what_is_known():
    likelihood = Parabola()
    start = likelihood.expand(np.zeros(2))

    def interrupted(points, report=None):
        raise KeyboardInterrupt

    likelihood.expand_all = interrupted
    (end,) = climb(likelihood, [start])
    assert (end.stopped, end.top, end.steps) == (INTERRUPTED, start, 0)


def test_a_step_without_derivatives_ends_an_ascent():
    likelihood = Parabola(0.3)
    start = likelihood.expand(np.zeros(2))
    likelihood.expand_all = lambda points, report=None: [None for _ in points]
    (end,) = climb(likelihood, [start])
    assert (end.stopped, end.top) == ('the best step has no derivatives', start)
    likelihood.values = lambda points: np.full(len(points), -1e9)
    (end,) = climb(likelihood, [start])
    assert (end.stopped, end.top) == ('no step is better', start)


@pytest.mark.parametrize(('deviations', 'stopped'), [(0.19, ''), (0.21, 'no step is better')])
def test_what_no_step_improves_is_a_maximum_within_a_fifth_of_a_deviation(deviations, stopped):
    likelihood = Parabola()
    away = np.array([deviations, 0.0]) / np.sqrt(INFORMATION[0, 0])
    start = likelihood.expand(TOP + away)
    likelihood.values = lambda points: np.full(len(points), -1e9)
    likelihood.expand_all = lambda points, report=None: [None for _ in points]
    (end,) = climb(likelihood, [start])
    assert (end.stopped, end.top) == (stopped, start)


def test_there_is_an_end_to_steps(monkeypatch):
    monkeypatch.setattr(ascent, '_MOST_STEPS', 2)
    likelihood = Parabola(50.0)
    (end,) = climb(likelihood, [likelihood.expand(np.zeros(2))], negligible=0.0)
    assert (end.steps, end.stopped) == (2, '2 steps from a start are not enough')


class Plateau:
    """A likelihood of two scales that is level where the first is small, and higher beyond."""

    parameters = tuple(FreeParameter(name, 1.0, positive=True) for name in 'ab')
    start = np.zeros(2)

    def height(self, a, b):
        return -0.5 * b**2 - (4.0 if a < -5.0 else 0.5 * (a + 1.0) ** 2)

    def values(self, points):
        return np.array([self.height(*z) for z in points])

    def expand(self, z):
        level = z[0] < -5.0
        gradient = np.array([0.0 if level else -(z[0] + 1.0), -z[1]])
        value = self.height(*z)
        return Expansion(z, value, value, gradient, np.diag([0.0 if level else 1.0, 1.0]))

    def expand_all(self, points, report=None):
        return [self.expand(z) for z in points]


def test_an_ascent_leaves_a_plateau_below_other_values():
    plateau = Plateau()
    start = plateau.expand(np.array([-8.0, 0.5]))
    (alone,) = climb(plateau, [start], negligible=1e-9)
    assert not alone.stopped and alone.top.value == pytest.approx(-4.0)
    end = ascent._climbed(plateau, start, lambda *said: None, 1e-9)
    np.testing.assert_allclose(end.top.z, [-1.0, 0.0], atol=1e-3)
    assert end.steps >= alone.steps and not end.stopped


def test_a_plateau_that_is_as_high_as_all_values_is_the_end(monkeypatch):
    monkeypatch.setattr(Plateau, 'height', lambda self, a, b: -0.5 * b**2 - max(a + 5.0, 0.0))
    plateau = Plateau()
    end = ascent._climbed(plateau, plateau.expand(np.array([-8.0, 0.5])), lambda *said: None, 1e-9)
    assert end.top.z[0] == -8.0 and end.top.value == pytest.approx(0.0)
