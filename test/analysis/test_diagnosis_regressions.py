# SPDX-License-Identifier: Apache-2.0
"""Findings that follow from regressions: inputs, units, places and axes of sensors, noise."""

from types import SimpleNamespace

import numpy as np
import pytest
from examined import case, kinds, record, responding
from scipy.linalg import block_diag
from scipy.stats import chi2

from kalman_ros.analysis.diagnosis import (
    bias,
    gross,
    input_gains,
    inputs,
    lever_arms,
    mounting,
    noise_levels,
    outliers,
    units,
    unrelated,
)
from kalman_ros.analysis.diagnosis.evidence import Evidence
from kalman_ros.analysis.diagnosis.finding import Finding, NoiseLevel
from kalman_ros.analysis.diagnosis.passage import Passage
from kalman_ros.analysis.diagnosis.responses import Responses
from kalman_ros.core import Space, rotations
from kalman_ros.scenario import build

#: Steps as long as the inputs are apart.
SLOW = {'rate': 20.0, 'velocity.rate': 20.0}
INPUTS = np.array([-2.0, -1.0, -0.2, 0.0, 0.1, 1.0, 2.0, 3.0])


def pushed(labels, size, std, **parameters):
    return responding(labels, size, std, inputs=INPUTS, **parameters)


def mended(finding):
    return finding.mended().inputs.value[:, 0]


@pytest.mark.parametrize(
    ('size', 'gain', 'kind'),
    [
        (0.051, 100.0, 'input gain'),
        (0.049, 100.0, None),
        (-0.051, 100.0, 'input gain'),
        (-1.29, 100.0, 'input gain'),
        (-1.31, 100.0, 'input sign'),
        (0.5, 30.1, 'input gain'),
        (0.5, 29.9, None),
    ],
)
def test_an_input_acts_as_commanded_within_five_percent(size, gain, kind):
    findings = input_gains.find(pushed([('gain', 'f')], size, abs(size) / gain**0.5))
    assert kinds(findings) == ([kind] if kind else [])
    for finding in findings:
        np.testing.assert_allclose(mended(finding), (1.0 + size) * INPUTS)
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        assert finding.subject == 'f'


@pytest.mark.parametrize(
    ('half', 'gain', 'found'),
    [(0.051, 100.0, True), (0.049, 100.0, False), (0.5, 30.1, True), (0.5, 29.9, False)],
)
def test_an_input_acts_alike_in_both_directions(half, gain, found):
    labels = [('gain', 'f'), ('half', 'f')]
    findings = inputs._find_asymmetries(pushed(labels, [0.0, half], [1.0, half / gain**0.5]))
    assert kinds(findings) == (['asymmetric gain'] if found else [])
    for finding in findings:
        expected = np.where(INPUTS > 0.0, (1.0 + half) * INPUTS, INPUTS)
        np.testing.assert_allclose(mended(finding), expected)
        assert (finding.gain, finding.parameters) == (pytest.approx(gain), 2)
        assert finding.z == pytest.approx(gain**0.5)


@pytest.mark.parametrize(
    ('weight', 'gain', 'found'),
    [(0.4, 30.1, True), (0.4, 29.9, False), (-0.4, 100.0, False), (1.5, 100.0, True)],
)
def test_the_delay_of_an_input_is_the_lag_that_explains_most(weight, gain, found):
    labels = [('lag', 'f', '1'), ('lag', 'f', '2')]
    size, std = [0.1, weight], [0.1, abs(weight) / gain**0.5]
    findings = inputs._find_delays(pushed(labels, size, std, **SLOW))
    assert kinds(findings) == (['input delay'] if found else [])
    for finding in findings:
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        assert f'acts {weight * 2 * 0.05:.3g} s after its command' in finding.sentence
        earlier = np.r_[[INPUTS[0]] * 2, INPUTS[:-2]]
        share = min(weight, 1.0)
        np.testing.assert_allclose(mended(finding), INPUTS + share * (earlier - INPUTS))


@pytest.mark.parametrize(
    ('share', 'gain', 'found'),
    [
        (0.31, 100.0, True),
        (0.29, 100.0, False),
        (1.49, 100.0, True),
        (1.51, 100.0, False),
        (1.0, 30.1, True),
        (1.0, 29.9, False),
    ],
)
def test_the_dead_zone_of_an_input_is_near_one_that_was_tried(share, gain, found):
    labels = [('dead', 'f', '0.1'), ('dead', 'f', '0.5')]
    findings = inputs._find_dead_zones(pushed(labels, [0.1, share], [0.1, share / gain**0.5]))
    assert kinds(findings) == (['dead zone'] if found else [])
    for finding in findings:
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        zone = 0.5 * share
        outside = np.sign(INPUTS) * np.maximum(np.abs(INPUTS) - zone, 0.0)
        np.testing.assert_allclose(mended(finding), outside, atol=1e-12)
        assert f'the first {zone:.3g} of f' in finding.sentence


@pytest.mark.parametrize(('gain', 'found'), [(50.1, True), (49.9, False)])
def test_a_tone_explains_twenty_more_than_chance(gain, found):
    """For its frequency is the best of many."""
    labels = [('tone', 'f', '2.0')] * 2
    size = np.array([0.3, 0.4])
    case_ = pushed(labels, size, np.full(2, 0.5 / gain**0.5), **SLOW)
    findings = inputs._find_tones(case_)
    assert kinds(findings) == (['disturbance'] if found else [])
    for finding in findings:
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        assert 'a sine adds 0.5 at 2 Hz to f' in finding.sentence
        phase = 4.0 * np.pi * (case_.evidence.inputs.stamp + 0.025)
        added = 0.3 * np.sin(phase) + 0.4 * np.cos(phase)
        np.testing.assert_allclose(mended(finding), INPUTS + added, atol=1e-9)


BOTH = [('mix', 'position', '0', '0'), ('read', 'position', '0', '0')]


def scaled(size, gain, square=1.0, readings=None):
    """Return an examination in which the readings are too large by a share."""
    readings = record(np.arange(7.0)) if readings is None else readings
    found = case(readings, np.full(len(readings), square))
    information = gain / size**2 * np.eye(2)
    found.responses = Responses(BOTH, information @ np.full(2, size), information)
    return found


@pytest.mark.parametrize(
    ('size', 'gain', 'square', 'found'),
    [
        (0.0031, 100.0, 1.0, True),
        (0.0029, 100.0, 1.0, False),
        (-0.0031, 100.0, 1.0, True),
        (0.1, 30.1, 1.0, True),
        (0.1, 29.9, 1.0, False),
        # where innovations are larger than expected, chance is, too
        (0.1, 60.1, 2.0, True),
        (0.1, 59.9, 2.0, False),
        (0.1, 30.1, 0.1, True),
    ],
)
def test_a_scale_differs_by_more_than_three_in_a_thousand(size, gain, square, found):
    findings = units.find(scaled(size, gain, square))
    assert kinds(findings) == (['scale'] if found else [])
    for finding in findings:
        value = np.arange(7.0)[:, np.newaxis]
        corrected = finding.mended().sensors['position'].value
        np.testing.assert_allclose(corrected, (1.0 - size) * value)
        assert finding.change['position.C'][0] == pytest.approx(1.0 / (1.0 - size), rel=1e-5)
        assert finding.dues == pytest.approx(-14.0 * np.log(1.0 - size))
        std = abs(size) / gain**0.5
        for more, again in ((0.29 * std, False), (0.31 * std, True)):
            after = finding.again(scaled(more, (more / std) ** 2))
            assert (after is not None) is again
        corrected = after.mended().sensors['position'].value
        np.testing.assert_allclose(corrected, (1.0 - size) * (1.0 - more) * value)


def test_a_factor_that_is_next_to_nothing_is_positive():
    findings = units.find(scaled(1.0, 1e4, readings=record(np.arange(7.0))))
    assert kinds(findings) == ['unit']
    assert 'multiplied by 0.0254: ' in findings[0].sentence  # of the units, the likeliest


@pytest.mark.parametrize(
    ('factor', 'std', 'kind', 'exact'),
    [
        (0.3048 * np.exp(0.049), 0.0, 'unit', True),
        (0.3048 * np.exp(0.051), 0.0, 'scale', False),
        (0.3048 * np.exp(-0.049), 0.0, 'unit', True),
        (0.3, 0.3 * 0.02, 'unit', True),
        (0.3048 * np.exp(0.2), 0.1, 'unit', True),
        (0.3048 * np.exp(0.26), 0.3, 'scale', False),
        (-1.34, 0.0, 'sign', True),
        (-0.66, 0.0, 'sign', True),
        (-1.36, 0.0, 'sign', False),
        (-1.39, 0.1, 'sign', True),
        (-1.41, 0.1, 'sign', False),
    ],
)
def test_a_factor_is_that_of_a_unit_or_a_sign_nearby(factor, std, kind, exact):
    found = units.classified(factor, std, {0.3048: 'feet', 1e3: 'thousands'})
    nearest = (0.3048 if factor > 0.0 else -1.0) if exact else factor
    assert found[:2] == (kind, nearest)
    assert ('feet' in found[2]) is (kind == 'unit')


@pytest.mark.parametrize(
    ('factor', 'std', 'kind'),
    [
        (0.51, 0.02, 'scale'),  # half, as well as knots
        (0.51, 0.0005, 'unit'),
        (0.5144, 0.0, 'unit'),
        (0.515, 0.5, 'scale'),
        (0.53, 0.5, 'unit'),  # too far from a half
    ],
)
def test_a_half_is_likelier_than_knots(factor, std, kind):
    assert units.classified(factor, std, {0.514444: 'knots'})[0] == kind


@pytest.mark.parametrize(
    ('factor', 'scatter', 'found'), [(0.18, 0.1, [0.18]), (0.9, 0.1, []), (0.18, 20.0, [])]
)
def test_a_factor_is_that_to_what_the_others_predict(monkeypatch, factor, scatter, found):
    predicted = np.linspace(1.0, 3.0, 30)[:, np.newaxis]
    noise = scatter * np.random.default_rng(1).normal(size=(30, 1))
    others = SimpleNamespace(record=record(np.arange(30.0), value=predicted / factor + noise),
                             predicted=predicted)  # fmt: skip
    monkeypatch.setattr(gross, 'left_out', lambda *given: others)
    monkeypatch.setattr(gross, 'scaled', lambda case, names, group, factor, *_: factor)
    known = case(record(np.arange(30.0)))
    assert list(gross._by_others(known, 'position')) == pytest.approx(found, rel=0.02)
    monkeypatch.setattr(gross, 'left_out', lambda *given: None)
    assert list(gross._by_others(known, 'position')) == []


def test_the_first_seconds_have_some_readings_of_the_slowest_sensor():
    times = {'fast': np.arange(0.0, 100.0, 0.1), 'slow': np.arange(1.0, 100.0, 5.0)}
    every = np.sort(np.concatenate([*times.values()]))
    passage = SimpleNamespace(series=lambda field, name='': times.get(name, every))
    case_ = SimpleNamespace(passage=passage, judged=['fast', 'slow'])
    assert gross._until(case_, 8.0) == pytest.approx(36.0)  # the eighth of the slow one
    assert gross._until(case_, 2.0) == pytest.approx(6.0)
    assert gross._until(case_, 2.0, 30.0) == pytest.approx(36.0)
    case_.judged = ['fast']
    assert gross._until(case_, 8.0) == pytest.approx(8.0)
    assert gross._until(case_, 8.0, 200.0) == pytest.approx(208.0)  # behind the last one


@pytest.mark.parametrize(
    ('times', 'found'),
    [
        (0.3048 * np.exp(0.29), [0.3048]),
        (0.3048 * np.exp(-0.29), [0.3048]),
        (0.3048 * np.exp(0.31), []),
        (0.3048 * np.exp(-0.31), []),
        (1.2, []),  # which is near enough to what is expected
        (-0.3048, []),
        (1e3, [1e3]),
    ],
)
def test_a_unit_is_suspected_by_the_size_of_the_readings(times, found):
    value = np.array([1.0, np.nan, 1.0, 50.0, 1.0]) * 2.0 / times
    case_ = case(record(np.arange(5.0), value=value), initial_estimate=[2.0, 0.0])
    assert gross._by_size(case_, 'position', (0,), [0.3048, 1e3, 1.2]) == found


@pytest.mark.parametrize(
    ('model', 'square', 'lost'),
    [('cart_pole', 2.01, True), ('cart_pole', 1.99, False), ('mass_spring_damper', 9.0, False)],
)
def test_a_filter_is_lost_if_no_linearisation_holds(model, square, lost):
    found = SimpleNamespace(
        passage=Passage([], [np.sqrt([0.5 * square, 1.5 * square])]),
        evidence=SimpleNamespace(scenario=build({'model': model})),
    )
    assert gross.lost(found) is lost


@pytest.mark.parametrize(
    ('upper', 'gain', 'share', 'found'),
    [
        (0.031, 100.0, 1.0, True),
        (0.029, 100.0, 1.0, False),
        (-0.031, 100.0, 1.0, True),
        (0.3, 30.1, 1.0, True),
        (0.3, 29.9, 1.0, False),
        (1.01, 100.0, 1.0, False),  # no scale is negative
        (0.1, 100.0, 0.34, True),  # of the squares, a tenth is below zero
        (0.1, 100.0, 0.33, False),
    ],
)
def test_scales_above_and_below_zero_differ_by_three_percent(upper, gain, share, found):
    labels = [('mix', 'position', '0', '0'), ('upper', 'position', '0')]
    value = np.resize([1.0, -share], 20)
    case_ = responding(
        labels, [0.0, upper], [1.0, abs(upper) / gain**0.5],
        record(np.arange(20.0), value=value),
    )  # fmt: skip
    findings = units._asymmetries(case_, 'position')
    assert kinds(findings) == (['asymmetric scale'] if found else [])
    for finding in findings:
        corrected = finding.mended().sensors['position'].value[:, 0]
        np.testing.assert_allclose(corrected, np.where(value > 0.0, 1.0 - upper, 1.0) * value)
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)


@pytest.mark.parametrize(
    ('size', 'gain', 'found'),
    [(0.021, 100.0, True), (0.019, 100.0, False), (-0.2, 30.1, True), (0.2, 29.9, False)],
)
def test_a_lever_arm_is_two_centimetres_or_more(monkeypatch, size, gain, found):
    monkeypatch.setattr(Evidence, 'adopting', lambda self, change: self)
    labels, std = [('arm', 'position')] * 3, abs(size) / gain**0.5
    before = {'position.mount.translation': [0.1, 0.0, 0.3]}
    case_ = responding(labels, [0.0, size, 0.0], [std] * 3)
    found_ = SimpleNamespace(**vars(case_))
    found_.evidence = Evidence(
        {**case_.evidence.parameters, **before}, *(vars(case_.evidence)[name] for name in
        ('scenario', 'sensors', 'inputs', 'beliefs', 'rerun')),
    )  # fmt: skip
    findings = lever_arms.find(found_)
    assert kinds(findings) == (['lever arm'] if found else [])
    for finding in findings:
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        (arm,) = finding.change.values()
        assert arm == pytest.approx([0.1, size, 0.3], rel=1e-2)
        assert finding.parameters == 3
        for more, again in ((0.29, False), (0.31, True)):
            after = responding(labels, [0.0, 0.0, more * std], [std] * 3)
            assert (finding.again(after) is not None) is again


def test_a_lever_arm_is_from_the_centre_where_none_is_declared(monkeypatch):
    monkeypatch.setattr(Evidence, 'adopting', lambda self, change: self)
    labels, arm = [('arm', 'position')] * 3, [0.1, 0.2, 0.3]
    (finding,) = lever_arms.find(responding(labels, arm, [0.01] * 3))
    assert finding.change == {'position.mount.translation': arm}


def test_no_lever_arm_is_found_where_none_is_allowed(monkeypatch):
    def refuse(self, change):
        raise ValueError('mount.translation')

    monkeypatch.setattr(Evidence, 'adopting', refuse)
    assert lever_arms.find(responding([('arm', 'position')], [1.0], [0.01])) == []


def vector(M, weight, k):
    """Return an examination of a vector whose readings fit as M y."""
    space = Space(tuple('xyzrst'[:k]), ('m',) * k)
    labels = [(kind, 's', str(i), str(j)) for kind in ('read', 'mix')
              for i in range(k) for j in range(k)]  # fmt: skip
    size = (np.eye(k) - M).ravel()
    information = block_diag(weight * np.eye(k * k), weight * np.eye(k * k))
    sensor = SimpleNamespace(output=space)
    source = SimpleNamespace(sensor=sensor, signal=SimpleNamespace(fields=tuple('abc'[:k])))
    return SimpleNamespace(
        responses=Responses(labels, information @ np.r_[size, size], information),
        evidence=SimpleNamespace(
            scenario=SimpleNamespace(sensors={'s': source}), sensors={'s': record(np.arange(3.0))},
            parameters={},
        ),
        passage=SimpleNamespace(of=lambda name: np.arange(3), misfit=500.0), judged=['s'],
    )  # fmt: skip


def plane(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_the_best_rotation_is_that_of_the_readings():
    for angle in (0.5, -2.0, 3.1):
        turn = mounting.best_rotation(vector(plane(angle), 100.0, 2), 's', (0, 1))
        assert mounting.rotation_angle(turn) == pytest.approx(angle, abs=np.pi / 720)
    turn = np.array([0.3, -0.5, 0.2])
    found = mounting.best_rotation(vector(rotations.exp(turn), 100.0, 3), 's', (0, 1, 2))
    np.testing.assert_allclose(rotations.log(found), turn, atol=1e-4)
    assert mounting.rotation_angle(found) == pytest.approx(np.linalg.norm(turn), abs=1e-4)


@pytest.mark.parametrize(
    ('angle', 'weight', 'found'),
    [(0.01745, 1e6, True), (0.008, 1e6, False), (0.4, 120.0, True), (0.4, 80.0, False)],
)
def test_a_rotation_is_large_and_beyond_chance(monkeypatch, angle, weight, found):
    monkeypatch.setattr(mounting, 'turned', lambda *given: given)
    findings = mounting._find_rotation(vector(plane(angle), weight, 2), 's', (0, 1))
    # half a gain is the distance of the matrices, squared
    gain = weight * np.sum((np.eye(2) - plane(angle)) ** 2)
    assert bool(findings) is found is bool(gain > 30.0 and angle > 0.01)
    for *_, explained, sentence in findings:
        assert explained == pytest.approx(gain, rel=1e-2)
        assert sentence == f'Misfit 500 becomes {500.0 - explained:.4g}.'


@pytest.mark.parametrize(('weight', 'found'), [(7.6, True), (7.4, False)])
def test_axes_are_swapped_if_that_explains_more_than_chance(monkeypatch, weight, found):
    monkeypatch.setattr(mounting, 'axes_exchanged', lambda case, name, order, gain: (order, gain))
    swap = np.eye(3)[[0, 2, 1]]
    findings = mounting._find_swap(vector(swap, weight, 3), 's', 3)
    assert findings == ([((0, 2, 1), pytest.approx(4.0 * weight))] if found else [])


@pytest.mark.parametrize('order', [(0, 3, 2, 1, 4, 5), (1, 0, 2, 3, 5, 4), (0, 1, 3, 4, 2, 5)])
def test_many_axes_are_exchanged_two_by_two(monkeypatch, order):
    """Nine coordinates, of three landmarks, have 362,880 orders."""
    monkeypatch.setattr(mounting, 'axes_exchanged', lambda case, name, order, gain: order)
    computed = []
    monkeypatch.setattr(
        mounting, 'replaced', lambda *given: computed.append(1) or units.replaced(*given)
    )
    size = len(order)
    case = vector(np.eye(size)[list(order)], 50.0, size)
    assert mounting._find_swap(case, 's', size) == [order]
    assert len(computed) < 100


def test_the_nearest_rotation_has_no_scale_and_no_mirror():
    R = rotations.exp(np.array([0.3, -0.5, 0.2]))
    np.testing.assert_allclose(mounting.nearest_rotation(3.0 * R), R, atol=1e-12)
    found = mounting.nearest_rotation(np.diag([1.0, 1.0, -0.1]))
    np.testing.assert_allclose(found, np.eye(3), atol=1e-12)
    skew = R @ np.diag([1.0, 1.1, 1.2]) @ rotations.exp(np.array([0.0, 0.1, 0.0]))
    found = mounting.nearest_rotation(skew)
    for axis in np.eye(3):
        for small in (1e-3, -1e-3):
            other = rotations.exp(small * axis) @ found
            assert np.linalg.norm(found - skew) < np.linalg.norm(other - skew)


def test_vectors_have_two_or_three_axes_of_one_unit():
    space = Space(('a', 'b', 'c', 'd', 'e'), ('m', 'm/s', 'm', 'm/s', 'm/s'))
    assert mounting.vectors(space) == [(0, 2), (1, 3, 4)]
    assert mounting.vectors(Space(tuple('abcd'), ('m',) * 4)) == []
    assert units.groups(space)[:5] == [(0,), (1,), (2,), (3,), (4,)]
    turn = Space(('r', 'p', 'y'), ('rad',) * 3, rotations=(('r', 'p', 'y'),))
    assert mounting.vectors(turn) == []


def noisy(best, weight, labels=(('position', '0'),), score=100.0):
    """Return an examination whose likelihood is a parabola of the logarithms of variances."""
    p = len(labels)
    found = case(record(0.1 * np.arange(9)))
    found.scores = SimpleNamespace(
        labels=list(labels), gradient=np.full(p, score), information=np.eye(p)
    )
    found.densities = {}

    def misfits(passage, labels, candidates, densities):
        return 700.0 + weight * np.sum((candidates - best) ** 2 - best**2, axis=1)

    return found, misfits


@pytest.mark.parametrize(
    ('best', 'weight', 'score', 'found'),
    [
        (2.5, 100.0, 5.1, True),
        (-2.5, 100.0, -5.1, True),
        (-2.5, 100.0, 5.1, False),  # the likelihood grows the other way
        (2.5, 100.0, 4.9, False),
        (0.5, 121.0, 100.0, True),
        (0.5, 119.0, 100.0, False),
        (-4.0, 100.0, -100.0, True),
        # by less than a fifth
        (0.35, 1e4, 100.0, False),
    ],
)
def test_noise_is_wrong_by_a_fifth_and_beyond_chance(monkeypatch, best, weight, score, found):
    case_, misfits = noisy(best, weight, score=score)
    monkeypatch.setattr(noise_levels, 'misfits', misfits)
    findings = noise_levels.find(case_)
    way = 'small' if best > 0.0 else 'large'
    assert kinds(findings) == ([f'noise too {way}'] if found else [])
    for finding in findings:
        std = 0.05 * np.exp(0.5 * best)
        assert finding.change == {'position.noise': [pytest.approx(std, rel=1e-2)]}
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(weight * best**2)
        R = finding.mended().sensors['position'].covariance
        np.testing.assert_allclose(R, np.full((9, 1, 1), std**2))
        size, spread = np.exp(0.5 * abs(best)), 1.0 / weight**0.5
        low, high = size * np.exp(-spread), size * np.exp(spread)
        assert f'factor of {size:.3g} ({low:.3g} to {high:.3g}, 95 %)' in finding.sentence
        _, upper, lower = finding.figure.curves
        np.testing.assert_array_equal(upper.y, 2.0 * np.ones(9))
        np.testing.assert_array_equal(lower.y, -upper.y)


def test_variances_are_tried_alone_and_all_of_a_sensor_together():
    labels = [('a', '0'), ('a', '1'), ('b', '0'), ('force_noise',)]
    assert noise_levels._groups(labels) == [(0,), (1,), (2,), (3,), (0, 1)]


@pytest.mark.parametrize('coarse', [-6.0, -4.0, -2.5, -1.2, -0.5, 0.5, 1.2, 2.5, 4.0, 6.0, 9.0])
def test_the_factor_of_a_variance_is_found_in_coarse_and_in_fine_steps(monkeypatch, coarse):
    fine = [-0.3, 0.0, 0.3, *{-4.0: [-0.6], 9.0: [0.6]}.get(coarse, [])]
    for best in coarse + np.array(fine):
        case_, misfits = noisy(best, 100.0)
        monkeypatch.setattr(noise_levels, 'misfits', misfits)
        way = noise_levels._FACTORS[noise_levels._FACTORS * coarse > 0.0]
        ((group, log, gain, spread),) = noise_levels._search_factors(case_, {(0,): way})
        assert group == (0,)
        assert log == pytest.approx(best)
        assert gain == pytest.approx(100.0 * best**2)
        assert spread == (np.inf if best == 9.6 else pytest.approx(0.1))


@pytest.mark.parametrize(('best', 'bound'), [(-9.0, -6.6), (20.0, 9.6)])
def test_a_noise_beyond_all_trials_is_wrong_by_at_least_the_last_one(monkeypatch, best, bound):
    case_, misfits = noisy(best, 100.0, score=np.copysign(100.0, best))
    monkeypatch.setattr(noise_levels, 'misfits', misfits)
    (finding,) = noise_levels.find(case_)
    assert f'by a factor of at least {np.exp(0.5 * abs(bound)):.3g}: ' in finding.sentence
    assert '95 %' not in finding.sentence


def test_no_less_noise_is_advised_for_errors_that_are_alike_in_time():
    large = Finding('noise too large', 'gnss.x', 'too large.', 9.0, {'gnss.noise': [0.1]})
    others = [
        Finding('noise too large', 'wheels', 'too large.', 9.0, {'wheels.noise': [0.1]}),
        Finding('noise too small', 'gnss.y', 'too small.', 9.0, {'gnss.noise': [0.1]}),
        Finding('outliers', 'gnss', 'outliers.', 9.0),
    ]
    assert noise_levels.withheld(None, [large, *others], []) == [large, *others]
    for kind in ('coloured noise', 'random walk', 'unexplained'):
        alike = Finding(kind, 'gnss', 'alike.', 9.0)
        for findings, notes in (([large, *others, alike], []), ([large, *others], [alike])):
            first, *rest = noise_levels.withheld(None, findings, notes)
            assert not first.change and first.sentence.endswith('Keep the declared one.')
            assert rest[:3] == others


@pytest.mark.parametrize(('std', 'kept'), [(0.28, True), (0.30, False)])
def test_no_less_noise_is_advised_than_rounding_has(std, kept):
    values = np.round(5.0 * np.sin(0.1 * np.arange(400.0)))  # steps of 1, of which one has 0.289
    evidence = case(record(np.arange(400.0), value=values)).evidence
    level = NoiseLevel('position', [0], np.array([0.5]), np.array([std]), 0.1)
    large = Finding('noise too large', 'position', '', 9.0, {'position.noise': [std]}, level=level)
    (found,) = noise_levels.withheld(evidence, [large], [])
    assert (found.change == {}) is kept
    assert ('rounding alone has 0.289' in found.sentence) is kept


def test_four_variances_are_tried_in_a_round(monkeypatch):
    labels = [('position', str(i)) for i in range(6)]
    case_, _ = noisy(0.0, 1.0, labels)
    case_.scores.gradient = np.array([9.0, 50.0, -30.0, 8.0, 7.0, 40.0])
    case_.scores.information = np.diag(np.full(6, 1.0))
    monkeypatch.setattr(noise_levels, '_groups', lambda labels: [(i,) for i in range(6)])
    tried = []
    monkeypatch.setattr(
        noise_levels, '_search_factors', lambda _, groups: tried.extend(groups) or []
    )
    noise_levels.find(case_)
    assert tried == [(1,), (5,), (2,), (0,)]


def pieces(values, std=1.0):
    """Return the regression on an offset that has these values in the pieces of a recording."""
    labels = [('offset', 's', '0', str(b)) for b in range(len(values))]
    information = np.eye(len(values)) / std**2
    return Responses(labels, information @ np.asarray(values), information)


@pytest.mark.parametrize('kind', ['constant', 'ramp', 'step', 'walk'])
def test_a_course_has_the_likelihood_of_its_kind(kind):
    rng, B = np.random.default_rng(4), 12
    t = np.arange(B)
    values = {
        'constant': 7.0 + 0.0 * t,
        'ramp': 3.0 * (t + 0.5),
        'step': 9.0 * (t >= 5),
        'walk': 6.0 * np.cumsum(rng.normal(size=B)),
    }[kind] + 0.1 * rng.normal(size=B)
    found = pieces(values)
    course = bias._best_course(found, range(B), kind, 10.0)
    if kind == 'walk':
        S = np.minimum.outer(t + 1.0, t + 1.0)

        def likelihood(q):
            total = np.eye(B) + q * S
            return (
                values @ values
                - values @ np.linalg.solve(total, values)
                - (np.linalg.slogdet(total)[1])
            )

        scale = B / np.trace(S)
        intensities = scale * np.geomspace(1e-4, 1e4, 33)
        best = max(intensities, key=likelihood)
        assert course.gain == pytest.approx(likelihood(best) - 10.0)
        path = best * S @ np.linalg.solve(np.eye(B) + best * S, values)
        np.testing.assert_allclose(course.values, path)
        gain = 2.0 * path @ values - path @ path
        assert course.dues == pytest.approx(gain - likelihood(best))
        return
    shape = {'constant': 1.0 + 0.0 * t, 'ramp': t + 0.5, 'step': (t >= 5) * 1.0}[kind]
    size = shape @ values / (shape @ shape)
    np.testing.assert_allclose(course.values, size * shape)
    more = 2.0 * np.log(12.0) if kind == 'step' else 0.0  # which begins at one of the pieces
    assert course.gain == pytest.approx((shape @ values) ** 2 / (shape @ shape) - 10.0 - more)
    assert (course.kind, course.began, course.dues) == (kind, 5 if kind == 'step' else 0, 0.0)


@pytest.mark.parametrize(('gain', 'found'), [(40.1, True), (39.9, False)])
def test_an_offset_explains_ten_more_than_chance(gain, found):
    responses = pieces(np.full(4, (gain / 4.0) ** 0.5))
    assert bool(bias.courses_of(responses, {0: range(4), 1: []})) is found


@pytest.mark.parametrize('is_walk', [True, False])
def test_only_an_offset_that_wanders_has_the_likelihood_of_a_walk(monkeypatch, is_walk):
    given = case(record(0.1 * np.arange(9)), np.zeros(9))
    drawn = np.linspace(0.0, 0.4, 9)[:, None]
    monkeypatch.setattr(bias.wandering, 'likeliest', lambda *_: (123.0, drawn))
    monkeypatch.setattr(bias.wandering, 'is_walk', lambda *_: is_walk)
    course = bias.Course('walk', np.linspace(0.0, 0.4, 4), 50.0, density=1.0)
    finding = bias._finding(given, 'position', {0: course}, np.linspace(0.0, 0.8, 5))
    exact = finding.exact()
    assert (exact.is_exact, exact.gain) == ((True, 123.0) if is_walk else (False, 50.0))
    off = given.evidence.sensors['position'].value - exact.mended().sensors['position'].value
    assert np.allclose(off, drawn) is is_walk  # otherwise, the course by pieces


def test_an_offset_is_described_by_its_size_its_rate_or_its_range():
    limits = np.array([2.0, 4.0, 6.0, 8.0, 10.0])
    fit = SimpleNamespace(std=np.array([0.25]))
    values, level = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.0, 0.0, 4.0, 4.0])
    for course, words in (
        (bias.Course('constant', values, 1.0, fit), 'by +4 ± 0.2'),
        (bias.Course('step', level, 1.0, fit, began=2), 'by +4 ± 0.2 from t = 4 s on'),
        (bias.Course('step', level - 1.0, 1.0, fit, began=2), 'by +4 ± 0.2 from t = 4 s on'),
        (bias.Course('ramp', values, 1.0), 'drifts by +0.5 a second'),
        (bias.Course('walk', values, 1.0), 'wanders between +1 and +4'),
    ):
        assert bias._describe(course, limits) == words


LIMIT = chi2.isf(1e-6, 1)


@pytest.mark.parametrize(
    ('events', 'far', 'times', 'usual', 'kind'),
    [
        (100, 3, 1.9, 0.3, 'outliers'),
        (20, 3, 1.9, 0.3, 'outliers'),
        (19, 3, 1.9, 0.3, None),
        (100, 3, 0.99, 0.3, None),
        (100, 25, 1.9, 0.3, 'disturbed'),
        (100, 26, 1.9, 0.3, None),
        (100, 8, 1.9, 0.3, 'disturbed'),
        (100, 7, 1.9, 0.3, 'outliers'),
        # where innovations are larger than expected, outliers are, too
        (100, 3, 1.99, 2.0 * chi2.median(1), None),
        (100, 3, 2.01, 2.0 * chi2.median(1), 'outliers'),
        # one of them alone explains less than chance
        (100, 1, 40.9 / LIMIT, 0.3, None),
        (100, 1, 41.1 / LIMIT, 0.3, 'outliers'),
    ],
)
def test_outliers_are_few_and_far(monkeypatch, events, far, times, usual, kind):
    squares = np.full(events, usual)
    rows = np.arange(2, 2 + far)
    squares[rows] = times * LIMIT
    case_ = case(record(0.1 * np.arange(events)), squares)
    limits = []

    def rejected(evidence, name, limit):
        limits.append(limit)
        return np.flatnonzero(squares > limit)

    monkeypatch.setattr(outliers, 'rejected', rejected)
    findings = outliers.find(case_)
    assert kinds(findings) == ([kind] if kind else [])
    for finding in findings:
        assert limits == [pytest.approx(LIMIT * max(1.0, usual / chi2.median(1)))]
        assert finding.change == {'position.gate': 0.9999}
        assert finding.gain == pytest.approx(far * (times * LIMIT - 11.0))
        assert finding.gain == pytest.approx(finding.z**2)
        assert f'about {(times * LIMIT) ** 0.5:.2g} standard deviations off' in finding.sentence
        assert (', in 1 stretch,' in finding.sentence) is (kind == 'disturbed')
        gone = finding.mended().sensors['position'].value[:, 0]
        assert np.flatnonzero(np.isnan(gone)).tolist() == rows.tolist()


@pytest.mark.parametrize(('fitting', 'found'), [(2, True), (4, False)])
def test_what_fits_is_not_called_an_outlier(monkeypatch, fitting, found):
    """A gate that locks out rejects more readings that fit than outliers."""
    squares = np.full(100, 0.3)
    squares[:3] = 1.9 * LIMIT
    monkeypatch.setattr(outliers, 'rejected', lambda *_: np.arange(3 + fitting))
    assert kinds(outliers.find(case(record(0.1 * np.arange(100)), squares))) == (
        ['outliers'] if found else []
    )


def test_a_gate_that_is_there_stays(monkeypatch):
    squares = np.full(50, 0.3)
    squares[[3, 4]] = 2.0 * LIMIT
    monkeypatch.setattr(outliers, 'rejected', lambda *_: np.array([3, 4]))
    case_ = case(record(0.1 * np.arange(50)), squares, **{'position.gate': 0.999})
    (finding,) = outliers.find(case_)
    assert finding.change == {}


def test_the_runs_of_a_mask_are_counted():
    for mask, runs in (([], 0), ([0, 0], 0), ([1], 1), ([1, 1, 0, 1], 2), ([0, 1, 0, 1, 0], 2)):
        assert outliers.runs_of(np.array(mask, dtype=bool)) == runs


@pytest.mark.parametrize(
    ('shift', 'largest'), [(18, True), (-18, True), (22, False), (-22, False), (0, True)]
)
def test_readings_are_compared_within_a_second(shift, largest):
    noise = np.random.default_rng(0).normal(size=600)
    readings = record(0.05 * np.arange(400))
    signals = np.column_stack((noise[100 + shift : 500 + shift], noise[:400]))
    found = unrelated._largest_correlation(readings, -noise[100:500, None], signals)
    assert (found > 0.9) is largest
    assert unrelated._largest_correlation(readings, np.ones((400, 1)), signals) == 0.0


@pytest.mark.parametrize('slope', [0.5, -0.5, 1.0])
def test_the_slope_of_readings_is_as_far_below_one_as_its_deviation_says(slope):
    rng, N = np.random.default_rng(1), 4000
    expected = rng.normal(size=N)
    y = 3.0 + slope * expected + 0.2 * rng.normal(size=N)
    found = unrelated._slope_deviation(y, expected)
    assert found == pytest.approx((1.0 - abs(slope)) / (0.2 / N**0.5), rel=0.03, abs=3.0)
    assert unrelated._slope_deviation(y, np.ones(N)) == 0.0


def test_the_deviation_of_a_slope_counts_that_residuals_persist():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(150):
        walk, noise = np.zeros((2, 400))
        steps = rng.normal(size=(2, 400))
        for k in range(1, 400):
            walk[k], noise[k] = 0.95 * walk[k - 1] + steps[0, k], 0.9 * noise[k - 1] + steps[1, k]
        found.append(unrelated._slope_deviation(walk + noise, walk))
    assert 0.85 < np.std(found) < 1.2  # five without


@pytest.mark.parametrize(
    ('square', 'largest', 'z', 'found'),
    [
        (4.1, 0.54, 4.1, True),
        (3.9, 0.54, 4.1, False),
        (4.1, 0.56, 4.1, False),
        (4.1, 0.54, 3.9, False),
    ],
)
def test_a_sensor_is_unrelated_that_surprises_and_follows_nothing(
    monkeypatch, square, largest, z, found
):
    readings = record(0.1 * np.arange(9))
    case_ = case(readings, np.full(9, square * chi2.median(1)))
    for event in case_.passage.events:
        event.log = 0.0
    others = SimpleNamespace(without=None, evidence=case_.evidence)
    curve = np.zeros((9, 1))
    comparison = unrelated._Comparison(readings.stamp, curve, curve, largest, z)
    monkeypatch.setattr(unrelated, 'left_out', lambda case, name: others)
    monkeypatch.setattr(unrelated, '_compare', lambda *_: comparison)
    monkeypatch.setattr(unrelated, 'explained', lambda *_: 70.0)
    case_.judged = ['position', 'position']
    findings = unrelated.find(case_)
    assert kinds(findings) == (['unrelated'] * 2 if found else [])
    for finding in findings:
        assert finding.change == {'position.enabled': False}
        assert finding.gain == pytest.approx(70.0 - finding.dues)
        assert finding.z == z
    case_.judged = ['position']  # nothing predicts the only sensor
    assert unrelated.find(case_) == []


def test_readings_without_a_model_follow_the_ones_before():
    rng = np.random.default_rng(3)
    y = np.zeros((500, 2))
    for k in range(1, 500):
        y[k] = [0.9, -0.5] * y[k - 1] + [1.0, 2.0] + [0.3, 0.1] * rng.normal(size=2)
    expected = 500 * sum(np.log(2.0 * np.pi * s**2) + 1.0 for s in (0.3, 0.1))
    assert unrelated._misfit_without_model(y) == pytest.approx(expected, rel=0.05)
    assert np.isfinite(unrelated._misfit_without_model(np.ones((9, 1))))


def test_angles_are_compared_by_their_sines():
    space = Space(('x', 'yaw'), ('m', 'rad'), angles=('yaw',))
    found = unrelated._linear_values(space, np.array([[2.0, 0.5 * np.pi], [7.0, np.pi]]))
    np.testing.assert_allclose(found, [[2.0, 1.0], [7.0, 0.0]], atol=1e-12)
