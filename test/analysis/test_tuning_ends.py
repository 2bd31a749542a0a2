# SPDX-License-Identifier: Apache-2.0
"""Ends of intervals by the profile of a likelihood with a known shape."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from tuned_cases import COVERED, likelihood, recorded

import kalman_ros as kr
from kalman_ros.analysis.tuning.ends import ends
from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.free_parameter import FreeParameter
from kalman_ros.analysis.tuning.likelihood import Expansion


@dataclass
class Surface:
    """A likelihood -1/2 (z - A)' J (z - A) within the limits, level below ``flat``."""

    J: np.ndarray
    flat: float = -np.inf
    high: float = np.inf
    positive: bool = False

    @property
    def parameters(self):
        one = FreeParameter('a', 1.0, high=self.high, positive=self.positive)
        return [one, *(FreeParameter(f'b{i}', 0.0) for i in range(1, len(self.J)))]

    def expand_all(self, points):
        return [self.expand(z) for z in points]

    def expand(self, z):
        at = np.array([max(z[0], self.flat), *z[1:]])
        g = -self.J @ at
        value = float(0.5 * at @ g)
        return Expansion(z, value, value, g, self.J)


@pytest.mark.parametrize('width', [0.7, 3.0, 40.0])
def test_of_a_parabola_they_are_those_of_the_normal_distribution(width):
    found = ends(Surface(np.eye(1)), Surface(np.eye(1)).expand(np.zeros(1)), 0, width)
    assert found == pytest.approx((-1.96, 1.96))


def test_the_other_parameters_follow():
    J = np.linalg.inv([[4.0, 1.8], [1.8, 1.0]])
    found = ends(Surface(J), Surface(J).expand(np.zeros(2)), 0, 10.0)
    assert found == pytest.approx((-2.0 * 1.96, 2.0 * 1.96), rel=1e-3)


def test_one_side_alone_has_an_end():
    level = Surface(np.eye(1), flat=-0.5)
    assert ends(level, level.expand(np.zeros(1)), 0, 3.0) == (-np.inf, pytest.approx(1.96))
    bounded = Surface(np.eye(1), high=1.5)
    assert ends(bounded, bounded.expand(np.zeros(1)), 0, 3.0) == (pytest.approx(-1.96), np.inf)


def test_no_logarithm_moves_farther_than_a_factor_of_ten_thousand():
    asked = []

    class Watched(Surface):
        def expand(self, z):
            asked.append(z[0])
            return super().expand(z)

    watched = Watched(1e-9 * np.eye(1), positive=True)
    found = ends(watched, watched.expand(np.zeros(1)), 0, np.log(10.0))
    assert found == (-np.inf, np.inf)
    assert np.exp(max(asked)) == pytest.approx(1e4, rel=0.02)


def test_what_cannot_be_expanded_is_an_end():
    class Failing(Surface):
        def expand(self, z):
            return super().expand(z) if z[0] < 1.0 else None

    failing = Failing(np.eye(1))
    below, above = ends(failing, failing.expand(np.zeros(1)), 0, 1.0)
    assert below == pytest.approx(-1.96) and 0.0 < above <= 1.0


@pytest.fixture(scope='module')
def uncertain():
    """Return the likelihood of a delay with an error of 0.3 s and a wide interval."""
    case = replace(
        COVERED[2], fitted=['position.delay'], errors={'position.delay': 0.3}, starts={},
        seconds=20.0, values={**COVERED[2].values, 'position.noise': [0.5, 0.5]},
    )  # fmt: skip
    return likelihood(case, recorded(case, 3))


@pytest.mark.slow
def test_a_delay_known_to_a_tenth_of_a_second_has_an_interval(uncertain):
    """A tenth of the range from -1 to 1 s that a delay can have: it was called not determined."""
    (found,) = fit(uncertain).parameters
    assert found.determined
    assert 0.1 < found.high - found.low < 0.9
    assert found.low < 0.3 < found.high
    assert found.interval == f'{found.low:.4g} to {found.high:.4g}'


@pytest.mark.slow
def test_an_interrupt_while_an_interval_is_computed_keeps_the_value(uncertain, monkeypatch):
    asked = []

    def interrupted(*_):
        asked.append(1)
        raise KeyboardInterrupt

    monkeypatch.setattr('kalman_ros.analysis.tuning.fit.ends', interrupted)
    monkeypatch.setattr('kalman_ros.analysis.tuning.fit.reach', lambda *_: (np.inf, np.inf))
    found = fit(uncertain)
    assert asked and found.interrupted
    assert 0.0 < found.values['position.delay'] < 0.6


def level(q=1000.0, r=10_000.0):
    return kr.discrete_model([[1.0]], Q=[[q]]), ([[1.0]], [[r]])


@pytest.mark.slow
def test_a_noise_too_small_to_show_has_an_end_above():
    readings = 100.0 + 30.0 * np.random.default_rng(1).normal(size=100)
    found = kr.tune(level, readings=readings, initial='diffuse')
    q = found.parameters['q']
    assert found.undetermined == {'q': 'it is too small for these data to show it'}
    assert q.low <= 0.0 and q.value < q.high
    assert 'below' in str(found)

    def log_likelihood(q):
        values = []
        for r in np.geomspace(500.0, 900.0, 25).tolist():
            model, sensor = level(q, r)
            filtered = kr.filter(model, sensor, readings=readings, initial='diffuse')
            values.append(filtered.log_likelihood)
        return max(values)

    # the profile falls by 1.92 there, as far as points on it are interpolated
    assert 1.0 < log_likelihood(1e-6) - log_likelihood(q.high) < 3.0


def test_what_is_limited_on_one_side_is_said_to_be():
    readings = np.cumsum(30.0 * np.random.default_rng(2).normal(size=100))
    found = kr.tune(level, readings=readings, initial='diffuse')
    assert found.undetermined == {'r': 'these data limit it on one side only'}
    assert np.isfinite(found.parameters['r'].high) and found.parameters['r'].low <= 0.0
