# SPDX-License-Identifier: Apache-2.0
"""Causes that recordings of strangers had and the diagnosis lacked, each alone."""

from dataclasses import replace
from re import findall
from types import SimpleNamespace

import numpy as np
import pytest
from thorough import thorough
from tools.strangers.injected.recordings import Injection, recorded

from kalman_ros.analysis.diagnosis import common_noise, leftover, saturation, stretch
from kalman_ros.analysis.diagnosis.bias import without_declared
from kalman_ros.analysis.diagnosis.diagnose import _rank, diagnose, divided
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.analysis.diagnosis.outliers import runs_of
from kalman_ros.analysis.diagnosis.parameters import parameter, parameters
from kalman_ros.analysis.diagnosis.passage import Passage
from kalman_ros.analysis.diagnosis.trials import calibrated, certainty, completeness
from kalman_ros.analysis.diagnosis.units import conversions
from kalman_ros.core import Space


def edited(evidence, name, change):
    """Return evidence with other values of a sensor: ``change`` takes seconds (N,) and values."""
    record = evidence.sensors[name]
    value = change(record.stamp - record.stamp[0], record.value.copy())
    return evidence.with_values(name, value)


def first(evidence):
    finding = diagnose(evidence).findings[0]
    return finding.kind, finding.subject


@pytest.fixture(scope='module')
def spring():
    return recorded('mass_spring_damper', None, 12.0, 5)


@pytest.fixture(scope='module')
def cart():
    return recorded('cart_pole', None, 12.0, 5)


def shifted(t, y):
    y[(t > 4.0) & (t < 7.0)] += 0.8
    return y


def uneven(t, y):
    y[:, 0] *= np.where(y[:, 0] > 0.0, 1.3, 1.0)
    return y


def dead(t, y):
    y[np.abs(y[:, 0]) < 0.05, 0] = 0.0
    return y


def clipped(t, y):
    y[:, 0] = np.minimum(y[:, 0], np.quantile(y[:, 0], 0.95))
    return y


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'change', 'kind'), [('position', shifted, 'disturbed')])
def test_it_is_found_on_a_spring(spring, name, change, kind):
    assert first(edited(spring, name, change)) == (kind, name)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize(
    ('change', 'kind'),
    [(uneven, 'asymmetric scale'), thorough(clipped, 'saturated'), thorough(dead, 'dead zone')],
)
def test_it_is_found_on_a_cart(cart, change, kind):
    assert first(edited(cart, 'joint_states', change)) == (kind, 'joint_states.x')


@pytest.mark.thorough
@pytest.mark.slow
def test_a_disturbance_has_its_time_and_size(spring):
    finding = diagnose(edited(spring, 'position', shifted)).findings[0]
    since, until = findall(r'from t = ([0-9.]+) to ([0-9.]+) s', finding.sentence)[0]
    assert 3.9 < float(since) < 4.1 and 6.9 < float(until) < 7.1
    size = float(finding.sentence.partition(' by ')[2].split()[0])
    assert size == pytest.approx(0.8, abs=0.1)
    assert 0.7 < finding.certainty < 0.99  # a walk has many shapes


@pytest.mark.thorough
@pytest.mark.slow
def test_an_input_that_is_weaker_one_way_is_found(cart):
    u = cart.inputs.value
    stronger = replace(cart.inputs, value=np.where(u > 0.0, u / 0.5, u))
    finding = diagnose(replace(cart, inputs=stronger)).findings[0]
    assert finding.kind == 'asymmetric gain'
    assert 'at 0.5' in finding.sentence


@pytest.mark.slow
def test_noise_in_common_is_found_where_nothing_else_is_wrong(spring):
    one, other = (spring.sensors[name] for name in ('position', 'velocity'))
    rng = np.random.default_rng(3)
    noise, alone = rng.standard_normal((len(one), 1)), rng.standard_normal((len(other), 1))
    std = [np.sqrt(record.covariance[:, 0]) for record in (one, other)]
    at = np.minimum(np.searchsorted(one.stamp, other.stamp - 1e-6), len(one) - 1)
    together = np.abs(one.stamp[at] - other.stamp)[:, None] < 1e-3
    both = spring.with_sensor('position', replace(one, value=one.value + 2.0 * std[0] * noise))
    value = other.value + 2.0 * std[1] * np.where(together, noise[at], alone)
    both = both.with_sensor('velocity', replace(other, value=value))
    wider = {
        name: replace(record, covariance=5.0 * record.covariance)
        for name, record in both.sensors.items()
    }
    findings = common_noise.find(Examination(replace(both, sensors=wider)))
    assert [finding.kind for finding in findings] == ['correlated noise']
    assert common_noise.find(Examination(spring)) == []


def test_readings_of_two_sensors_are_paired_with_the_nearest_ones():
    times = {'a': [0.0, 1.0, 2.0, 3.0, 4.0], 'b': [0.45, 1.1, 2.9, 3.2, 9.0]}

    def pairs(**given):
        read = SimpleNamespace(series=lambda field, name: np.array(given[name]))
        return common_noise._together(read, *given).tolist()

    # 0.45 is nearest to 0, 3.2 has a nearer one before it, and 9 is too far
    assert pairs(**times) == [[0, 0], [1, 1], [3, 2]]
    assert pairs(**dict(reversed(times.items()))) == [[0, 0], [1, 1], [2, 3]]
    assert pairs(a=[0.0, 1.0, 1.4, 9.0], b=[1.45, 9.0]) == [[2, 0], [3, 1]]  # 1.0 is no pair
    assert pairs(a=[1.0], b=[1.0, 2.0]) == []


@pytest.mark.parametrize(('alike', 'suspected'), [(0.0, True), (0.4, False)])
def test_innovations_that_are_alike_in_time_are_no_noise_in_common(alike, suspected):
    rng, N = np.random.default_rng(6), 1000
    series = rng.normal(size=(2, N))
    series[1] = 0.45 * series[0] + (1.0 - 0.45**2) ** 0.5 * series[1]
    for row in series:
        for k in range(1, N):
            row[k] = alike * row[k - 1] + (1.0 - alike**2) ** 0.5 * row[k]
    read = SimpleNamespace(
        series=lambda field, name: np.arange(float(N)),
        whitened_of=lambda name: series[['a', 'b'].index(name)][:, None],
    )
    assert (common_noise._suspected(read, 'a', 'b') is not None) is suspected


def test_coordinates_are_paired_with_those_they_are_correlated_with():
    r = np.array([[0.1, 0.9, 0.0], [0.6, 0.8, 0.2]])
    assert common_noise._correlated(r).tolist() == [[0, 1], [1, 0]]
    assert common_noise._correlated(0.7 * np.eye(2) + 0.3).tolist() == [[0, 0], [1, 1]]
    assert common_noise._correlated(np.array([[0.5, 0.2], [0.1, 0.2]])).tolist() == [[0, 0]]


@pytest.mark.thorough
@pytest.mark.slow
def test_a_lever_arm_is_found_with_its_length():
    field = recorded('gnss_imu', None, 60.0, 5)
    case, value = Examination(field), field.sensors['gnss'].value.copy()
    psi = field.scenario.model.state.names.index('psi')
    for event in (case.passage.events[i] for i in case.passage.of('gnss')):
        value[event.index] += [5.0 * np.cos(event.x[psi]), 5.0 * np.sin(event.x[psi])]
    finding = diagnose(field.with_values('gnss', value)).findings[0]
    assert (finding.kind, finding.subject) == ('lever arm', 'gnss')
    arm = finding.change['gnss.mount.translation']
    np.testing.assert_allclose(arm[:2], [5.0, 0.0], atol=1.0)


@pytest.mark.slow
def test_a_bias_that_the_estimator_follows_is_no_finding():
    def of(bias):
        followed = {'velocity.bias_std': [0.5]}
        injection = Injection({'velocity': {'bias': [bias]}}, estimator=followed)
        return recorded('mass_spring_damper', injection, 12.0, 5)

    biased = of(0.4)
    assert diagnose(biased).findings == ()
    value = without_declared(Examination(biased)).sensors['velocity'].value
    assert np.mean(biased.sensors['velocity'].value - value) == pytest.approx(0.4, abs=0.1)
    assert diagnose(of(4.0)).findings[0].kind == 'bias'


@pytest.mark.slow
def test_zeros_that_no_sensor_took_have_no_unit(spring):
    source = spring.scenario.sensors['velocity']
    zero = replace(source, signal=replace(source.signal, zero=True))
    sources = {**spring.scenario.sensors, 'velocity': zero}
    zeros = replace(spring, scenario=replace(spring.scenario, sensors=sources))
    case = Examination(edited(zeros, 'velocity', lambda t, y: 0.0 * y))
    assert case.judged == ['position']
    assert all(label[0] != 'velocity' for label in case.scores.labels)


@pytest.mark.slow
def test_what_no_cause_explains_is_told(spring):
    noise = np.random.default_rng(1).standard_normal(len(spring.sensors['position']))
    coloured = np.convolve(noise, np.ones(8) / np.sqrt(8.0), 'same')[:, None]
    std = np.sqrt(spring.sensors['position'].covariance[:, 0])
    case = Examination(edited(spring, 'position', lambda t, y: y + 2.0 * std * coloured))
    assert [note.subject for note in leftover.find(case)] == ['position']
    assert leftover.find(Examination(spring)) == []


@pytest.mark.slow
def test_the_numbers_of_a_linear_model_are_those_of_its_matrices(spring):
    values = {
        'model': 'linear', 'model_parameters.A': [0.0, 1.0, -2.0, 0.0],
        'model_parameters.noise_density': [0.0, 0.5],
    }  # fmt: skip
    evidence = replace(spring, parameters=values)
    found = {each.name: each.value for each in parameters(evidence)}
    assert {name: found[name] for name in ('A[1]', 'A[2]', 'noise_density')} == {
        'A[1]': 1.0, 'A[2]': -2.0, 'noise_density': 1.0,
    }  # fmt: skip
    assert 'A[0]' not in found
    changed = parameter(evidence, 'A[2]').change(-3.00001)
    assert changed == {'model_parameters.A': [0.0, 1.0, -3.0, 0.0]}
    exact = replace(
        spring, parameters={**values, 'model_parameters.A': [0.0, 1.23456789, -2.0, 0.0]}
    )
    changed = parameter(exact, 'A[2]').change(-3.0)  # rounds what changes, and nothing else
    assert changed == {'model_parameters.A': [0.0, 1.23456789, -3.0, 0.0]}
    doubled = parameter(evidence, 'noise_density').change(2.0)
    assert doubled == {'model_parameters.noise_density': [0.0, 1.0]}


def test_the_certainty_of_a_cause_is_its_share_among_rivals():
    assert certainty(100.0, []) == 1.0
    # what fits as well belongs to the cause
    assert certainty(100.0, [100.0]) == certainty(100.0, [85.1]) == 1.0
    assert certainty(1e4, [8.5e3]) == pytest.approx(1.0 / (1.0 + np.exp(-1500.0 / 1502.0)))
    tied = 1.0 + np.exp(-1000.0 / 1502.0)
    assert certainty(1e4, [9e3, 5e3]) == pytest.approx(tied / (tied + np.exp(-5000.0 / 1502.0)))
    assert certainty(1e4, [1e3, 10.0]) > 0.99


def test_the_certainty_of_a_first_finding_is_how_often_such_are_right():
    # 12 times the root of the odds
    assert [calibrated(share) for share in (0.0, 1.0)] == [0.0, 1.0]
    assert calibrated(0.5) == pytest.approx(12.0 / 13.0)
    assert calibrated(0.2) == pytest.approx(6.0 / 7.0)
    causes = [Finding('bias', 'gyro', '', 5.0, certainty=0.5, most=most) for most in (1.0, 0.8)]
    (first, second), _ = divided(causes)
    assert (first.certainty, second.certainty) == (pytest.approx(12.0 / 13.0), 0.5)
    assert divided(causes[1:])[0][0].certainty == 0.8


def passed(size, count=1000):
    return Passage([], [np.full(1, size**0.5)] * count)


@pytest.mark.parametrize(
    ('before', 'after', 'share'),
    [
        (4.0, 1.0, 1.0),
        (4.0, 1.03, 1.0),
        (2.0, 1.53, (0.47 / 0.97) ** 2),
        (4.0, 0.47, (3.53 / 4.03) ** 2),  # the declared noise is too large
        (0.5, 1.0, 1.0),
        (1.0, 1.0, 1.0),
        (2.0, 2.0, 0.0),
        (100.0, 1.0, 1.0),
    ],
)
def test_a_cause_is_believed_as_far_as_it_explains(before, after, share):
    assert completeness(passed(before), passed(after)) == pytest.approx(share)


def test_outliers_count_up_to_five_deviations():
    assert passed(400.0).mean_square == 25.0
    assert Passage([], []).mean_square == 1.0


def test_caution_ranks_after_what_is_wrong():
    kinds = [('noise too large', 90.0), ('drift', 1.0), ('losses', 0.0), ('bias', 9.0)]
    ranked = _rank([Finding(kind, 'imu', '', 1.0, gain=gain) for kind, gain in kinds])
    assert [finding.kind for finding in ranked] == ['bias', 'losses', 'drift', 'noise too large']
    assert [finding.share for finding in ranked] == [0.09, 0.0, 0.01, 0.9]


def test_the_heaviest_range_and_the_likeliest_stretch():
    assert stretch.heaviest(np.array([-1.0, 2.0, -0.5, 3.0, -4.0, 1.0])) == (1, 4)
    g, M = np.zeros(6), np.diag(np.full(6, 4.0))
    g[2:5] = 8.0
    everywhere = np.ones(6, dtype=bool)
    pieces = stretch.Pieces(g[:, None], M[:, None, :, None])
    assert pieces.likeliest(g[:, None], everywhere) == (2, 5)
    everywhere[3] = False
    assert pieces.likeliest(g[:, None], everywhere) in ((2, 3), (4, 5))
    assert pieces.likeliest(g[:, None], everywhere & False) is None


def test_several_stretches_are_told_from_one_that_goes_on():
    """Two coordinates, of which one is off in two stretches, and both in a third."""
    truth = np.zeros((40, 2))
    truth[5:9, 0], truth[15:18, 0], truth[30:36] = 2.0, -1.0, (1.0, 3.0)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(300, 80))
    M = root.T @ root
    g = M @ truth.reshape(-1) + root.T @ rng.normal(size=300)
    pieces = stretch.Pieces(g.reshape(40, 2), M.reshape(40, 2, 40, 2))
    found = stretch.several(pieces, 30.0)
    assert found.stretches == [(5, 9), (15, 18), (30, 36)]
    expected = np.array([[2.0, 0.0], [-1.0, 0.0], [1.0, 3.0]])
    assert (np.abs(found.size - expected) < 4.0 * found.std).all()
    assert found.gain > 1e3
    # what they leave is orthogonal to them, and one coordinate alone has sums of its own
    left = pieces.left(found)
    for begin, end in found.stretches:
        np.testing.assert_allclose(left[begin:end].sum(axis=0), 0.0, atol=1e-8 * np.abs(g).max())
    alone = pieces.of([1]).fitted([(30, 36)])
    basis = np.zeros((40, 2))
    basis[30:36, 1] = 1.0
    column = basis.reshape(-1)
    assert alone.size[0, 0] == pytest.approx(column @ g / (column @ M @ column), rel=1e-9)
    nothing = stretch.Pieces(np.zeros((40, 2)), M.reshape(40, 2, 40, 2))
    assert stretch.several(nothing, 30.0) is None


@pytest.mark.parametrize('level', [1e-3, 1.0])
def test_clusters_are_what_is_off_and_not_the_readings_between_them(level):
    """Where next to nothing tells the level, an offset of all that is right fits, too."""
    B, clusters = 40, [(8, 12), (20, 24), (33, 36)]
    M = 50.0 * (np.eye(B) - (1.0 - level) / B)
    truth = np.zeros(B)
    for begin, end in clusters:
        truth[begin:end] = 5.0
    g = M @ truth
    pieces = stretch.Pieces(g[:, None], M[:, None, :, None])
    between = [(1, 8), (12, 20), (24, 33)]
    every = pieces.fitted(sorted([*clusters, *between]))
    largest = stretch._largest(pieces, every, 30.0)
    assert largest.stretches == clusters
    np.testing.assert_allclose(largest.size[:, 0], 5.0, atol=0.1)
    both = np.zeros((B, 2, B, 2))
    both[:, 0, :, 0], both[:, 1, :, 1] = M, 50.0 * np.eye(B)
    noise = 50.0**0.5 * np.random.default_rng(8).normal(size=B)  # of another coordinate
    two = stretch.Pieces(np.column_stack((g, noise)), both)
    every = two.fitted(sorted([*clusters, *between]))
    assert stretch._largest(two, every, 30.0).stretches == clusters
    # one offset alone, and offsets that are alike, stay
    assert stretch._largest(pieces, largest, 30.0) is largest
    off = {at for part in stretch.several(pieces, 30.0).stretches for at in range(*part)}
    assert off == {at for cluster in clusters for at in range(*cluster)}


@pytest.mark.parametrize(('last', 'steps'), [(80.0, True), (79.0, True), (78.0, False)])
def test_an_offset_that_lasts_to_the_end_is_a_step(last, steps):
    limits = np.append(np.linspace(0.0, last, 40), 80.0)
    pieces = stretch.Pieces(np.ones((40, 1)), np.eye(40)[:, None, :, None])
    assert stretch._is_step(pieces.fitted([(20, 39)]), limits) is steps
    assert not stretch._is_step(pieces.fitted([(3, 6), (20, 39)]), limits)


def reflected(t, y):
    for begin in (2.0, 5.0, 9.0):
        y[(t > begin) & (t < begin + 1.5)] += 0.8
    return y


@pytest.mark.slow
def test_clusters_of_outliers_are_disturbed_stretches(spring):
    found = diagnose(edited(spring, 'position', reflected)).findings[0]
    assert (found.kind, found.subject) == ('disturbed', 'position')
    assert found.sentence.count('from t = ') == 3 and found.parameters == 9
    assert found.certainty > 0.5


@pytest.mark.parametrize(
    ('values', 'ends'),
    [
        (np.clip(np.random.default_rng(0).standard_normal(500), -9.0, 1.5), [1.5]),
        (np.random.default_rng(0).standard_normal(500), []),
        (np.round(np.random.default_rng(0).standard_normal(500), 1), []),
    ],
)
def test_the_ends_of_a_range_are_repeated(values, ends):
    assert saturation.ends_of(values) == ends


def test_outliers_in_a_row_are_runs():
    assert runs_of(np.array([True, True, False, True, False, False, True])) == 3
    assert runs_of(np.zeros(4, dtype=bool)) == 0


@pytest.mark.slow
def test_units_go_by_the_unit_of_the_model(spring):
    of_place = conversions(spring.scenario.sensors['position'].sensor.output, (0,))
    assert of_place[0.3048] == 'feet'
    assert 1e5 not in of_place


def test_without_a_unit_a_factor_has_all_its_names():
    bare, metres = Space(('h',), ('',)), Space(('h',), ('m',))
    assert conversions(bare, (0,))[100.0] == (
        'metres, where centimetres are expected or hPa (millibars)'
    )
    assert 100.0 not in conversions(metres, (0,))


def test_stretches_of_which_sums_leave_only_rounding_are_none():
    """A gain of a filter that is lost makes sums of 1e37, whose differences are no information."""
    k = 3
    pieces = stretch.Pieces(np.ones((4, k)), np.zeros((4, k, 4, k)))
    pieces._blocks += 1e37 * np.eye(k)[:, None, :]
    rounding = [[0.0, 4.7e21, -1.2e21], [0.0, 0.0, 0.0], [0.0, -1.2e21, 0.0]]  # singular
    pieces._blocks[2, :, 2] += rounding
    assert pieces.likeliest(np.ones((4, k)), np.ones(4, dtype=bool)) is not None
