# SPDX-License-Identifier: Apache-2.0
"""Where findings of a diagnosis begin: each limit of a detector, from both sides."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from examined import START, case, kinds, record, responding
from tools.strangers.injected.recordings import Injection, recorded, values_of

from kalman_ros.analysis import records
from kalman_ros.analysis.diagnosis import (
    contradicted_parameters,
    first_belief,
    frozen,
    gates,
    lateness,
    message_covariances,
    outliers,
    quantisation,
    rate,
    saturation,
    stamps,
    unobserved_states,
)
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.analysis.diagnosis.units import AFFINE, UNITS
from kalman_ros.estimators.outcome import Outcome

FACTORS = {
    'gauss': 1e-4,
    'microtesla': 1e-6,
    'degrees': np.pi / 180.0,
    'radians, where degrees are expected': 57.295779513082323,
    'km/h': 1000.0 / 3600.0,
    'm/s, where km/h are expected': 3600.0 / 1000.0,
    'thousandths (mm, mm/s)': 0.001,
    'thousands (km, kPa)': 1000.0,
    'hundredths (cm, cm/s)': 0.01,
    'metres, where centimetres are expected': 100.0,
    'hPa (millibars)': 100.0,
    'bar': 100_000.0,
    'pounds a square inch': 0.45359237 * 9.80665 / 0.0254**2,
    'dbar': 10_000.0,
    'mm of mercury': 101325.0 / 760.0,
    'inches of mercury': 25.4 * 101325.0 / 760.0,
    'nautical miles': 1852.0,
    'miles': 5280.0 * 12.0 * 0.0254,
    'feet': 12.0 * 0.0254,
    'feet a second': 12.0 * 0.0254,
    'metres, where feet are expected': 1.0 / (12.0 * 0.0254),
    'inches': 0.3048 / 12.0,
    'metres, where inches are expected': 12.0 / 0.3048,
    'miles an hour': 5280.0 * 12.0 * 0.0254 / 3600.0,
    'knots': 1852.0 / 3600.0,
    'g': 9.80665,
    'm/s^2, where g are expected': 1.0 / 9.80665,
    'revolutions a minute': 2.0 * np.pi / 60.0,
    'turns': 2.0 * np.pi,
}


def test_units_have_the_factors_of_their_definitions():
    assert {name: factor for factor, name, _ in UNITS} == pytest.approx(FACTORS, rel=3e-6)


@pytest.mark.parametrize(
    ('name', 'readings', 'meant'),
    [
        ('degrees Fahrenheit', [32.0, 212.0], [0.0, 100.0]),
        ('kelvin, where degrees Celsius are expected', [0.0, 273.15], [-273.15, 0.0]),
        ('degrees Celsius, where kelvin are expected', [-273.15, 0.0], [0.0, 273.15]),
    ],
)
def test_temperatures_have_the_scale_and_zero_of_their_definitions(name, readings, meant):
    scale, zero = AFFINE[name]
    np.testing.assert_allclose(scale * np.array(readings) + zero, meant, atol=1e-9)


@pytest.mark.parametrize(
    ('inside', 'low', 'high', 'ends'),
    [
        (np.linspace(-1, 1, 100), 5, 1, [-2.0]),
        (np.linspace(-1, 1, 100), 4, 1, []),
        (np.linspace(-1, 1, 100), 1, 5, [2.0]),
        (np.linspace(-1, 1, 100), 5, 7, [-2.0, 2.0]),
        # others that are read twice are repeated, too, wherever they are
        ([-1.0, *np.linspace(-1, 1, 100)], 5, 1, []),
        ([1.0, *np.linspace(-1, 1, 100)], 5, 1, []),
        ([1.0, *np.linspace(-1, 1, 100)], 6, 1, [-2.0]),
        # at least three of a thousand
        (np.linspace(-1, 1, 1993), 6, 1, [-2.0]),
        (np.linspace(-1, 1, 1994), 5, 1, []),
        ([0.0], 5, 1, [-2.0]),
        ([], 50, 50, []),
        (np.repeat(np.linspace(-1, 1, 100), 2), 50, 50, []),
        # a value far from all others is one in place of a reading
        (np.linspace(0.5, 1, 100), 6, 1, []),
    ],
)
def test_a_sensor_is_saturated_where_an_end_is_read_more_often_than_the_rest(
    inside, low, high, ends
):
    assert saturation.ends_of(np.array([*inside, *[-2.0] * low, *[2.0] * high])) == ends


@pytest.mark.parametrize(
    ('zeros', 'square', 'more', 'found'),
    [
        (5, 1.6, [], True),
        (5, 1.4, [], False),
        (4, 1.6, [], False),
        (5, 1.6, [1.0], False),  # of the others, one is read twice
        (6, 1.6, [1.0], True),
    ],
)
def test_a_dead_zone_is_zeros_that_contradict_the_filter(zeros, square, more, found):
    value = np.array([*[0.0] * zeros, *more, *np.linspace(1.0, 2.0, 20), -1.0])
    squares = np.where(value == 0.0, square, 0.0)
    findings = saturation.find(case(record(0.1 * np.arange(len(value)), value=value), squares))
    assert kinds(findings) == (['dead zone'] if found else [])
    for finding in findings:
        words = f'{zeros} of {len(value)} readings of position.x are exactly 0, and no other is'
        assert finding.sentence.startswith(f'{words} below 1: ')
        mended = finding.mended().sensors['position'].value[:, 0]
        np.testing.assert_array_equal(np.isnan(mended), value == 0.0)


@pytest.mark.parametrize(
    ('size', 'std', 'found'),
    [
        (1.51, 0.1, True),
        (1.49, 0.1, False),
        (-1.51, 0.1, True),
        (2.0, 2.0 / 34.1**0.5, True),
        (2.0, 2.0 / 33.9**0.5, False),
    ],
)
def test_a_first_belief_is_too_narrow_from_a_half_more_than_its_deviation(size, std, found):
    """With a gain of two a state more than chance."""
    labels = [('first', 'x'), ('first', 'v')]
    findings = first_belief.find(responding(labels, [size, 0.0], [std, std]))
    assert kinds(findings) == (['initial belief too narrow'] if found else [])


def test_a_first_belief_is_widened_where_its_error_is_significant():
    labels = [('first', 'x'), ('first', 'v')]
    for second, widened in ((2.9, 1.0), (3.1, 0.31 * 1.2 * 10.0)):
        found = responding(labels, [6.0, second], [0.5, 1.0], initial_std=[0.1, 1.0])
        (finding,) = first_belief.find(found)
        expected = [0.1 * 1.2 * 6.0, widened]
        np.testing.assert_allclose(finding.change['initial_std'], expected, rtol=1e-9)
        np.testing.assert_allclose(finding.mended().scenario.initial_belief.std, expected)
        assert finding.gain == pytest.approx(144.0 + second**2)
        assert finding.z == pytest.approx(finding.gain**0.5)
    # together far from zero, and neither of them known to be
    both = responding(labels, [1.6, 1.6], [9.0, 9.0], correlation=-0.9999)
    assert first_belief.find(both) == []


@pytest.mark.parametrize(
    ('latencies', 'kind'),
    [
        ([0.0201], 'delay'),
        ([0.0199], None),
        ([0.0], None),
        ([0.1, 0.166], 'delay'),
        ([0.1, 0.168], 'jitter'),
        ([0.001, 0.0209], None),
        ([0.001, 0.0211], 'jitter'),
        ([0.001, 0.021, 0.0, 0.0], None),  # a receipt at the stamp is not known
    ],
)
def test_readings_are_late_by_more_than_a_time_that_is_harmless(latencies, kind):
    stamp = 0.1 * np.arange(40.0)
    received = stamp + np.resize(latencies, 40)
    findings = lateness.find(case(record(stamp, received)))
    assert kinds(findings) == ([kind] if kind else [])
    assert all(finding.note for finding in findings)  # the window is longer


def test_fixes_without_a_position_are_not_blamed_on_a_division():
    value = np.arange(8.0)
    value[:5] = np.nan
    given = record(0.05 * np.arange(8), value=value)
    given.outcome[:3] = Outcome.NO_FIX.name
    found = {each.kind: each for each in rate.find(case(given)) if 'are dropped' in each.sentence}
    assert found['no position fix'].sentence.startswith(
        '3 of 8 readings of position (37.5 %) have'
    )
    assert found['not a number'].sentence.startswith('2 of 8 readings of position (25 %)')


@pytest.mark.parametrize('count', [2, 3])
def test_delays_are_found_from_three_readings_on(count):
    stamp = np.arange(float(count))
    assert len(lateness.find(case(record(stamp, stamp + 0.5)))) == (count > 2)


@pytest.mark.parametrize(
    ('delay', 'window', 'change'),
    [(0.79, 1.0, {}), (0.8, 1.0, {'window': 1.01}), (0.8, 1.01, {}), (2.0, 1.0, {'window': 2.45})],
)
def test_a_window_is_longer_than_the_longest_delay(delay, window, change):
    stamp = np.arange(10.0)
    late = record(stamp, stamp + delay)
    late.outcome[[2, 3]] = Outcome.TOO_OLD.name
    (finding,) = lateness.find(case(late, window=window))
    assert finding.change == change
    assert not finding.note
    assert f'2 were dropped as older than the window of {window:g} s' in finding.sentence
    # nothing is lost so far
    late.outcome[:] = Outcome.FUSED.name
    (finding,) = lateness.find(case(late, window=window))
    assert finding.note and finding.change == change
    assert ('is just long enough' in finding.sentence) == bool(change)


@pytest.mark.parametrize(
    ('tau', 'gain', 'seconds', 'kind'),
    [
        (0.0021, 100.0, 6, 'stamps early'),
        (-0.0021, 100.0, 6, 'stamps late'),
        (0.0019, 100.0, 6, None),
        (0.99, 100.0, 6, 'stamps early'),
        (-1.01, 100.0, 6, None),
        (1.99, 100.0, 20, 'stamps early'),
        (2.01, 100.0, 20, None),
        (0.1, 30.1, 6, 'stamps early'),
        (0.1, 29.9, 6, None),
    ],
)
def test_hidden_delays_of_stamps_have_limits(tau, gain, seconds, kind, monkeypatch):
    monkeypatch.setattr(lateness, '_by_passes', lambda case: [])
    readings = record(np.arange(seconds + 1.0))
    found = responding([('stamp', 'position')], tau, abs(tau) / gain**0.5, readings)
    findings = lateness.hidden(found)
    assert kinds(findings) == ([kind] if kind else [])
    for finding in findings:
        assert finding.change == {'position.stamp_offset': round(tau, 4)}
        assert finding.gain == pytest.approx(finding.z**2) == pytest.approx(gain)
        moved = finding.mended().sensors['position'].stamp
        np.testing.assert_allclose(moved, readings.stamp + tau)


def test_what_has_no_stamp_is_late_since_its_receipt_and_has_no_option():
    readings = record(np.arange(7.0))
    found = responding([('stamp', 'position')], -0.3, 0.01, readings)
    (stamped,) = lateness.hidden(found)
    found.evidence = replace(found.evidence, headerless=frozenset({'position'}))
    (received,) = lateness.hidden(found)
    assert 'before their stamps: they are stamped on receipt' in stamped.sentence
    assert received.kind == 'stamps late' and received.change == {}
    assert 'before their receipt. Publish a type with a header' in received.sentence


@pytest.mark.parametrize(('drift', 'found'), [(0.9e-3, True), (1.1e-3, False)])
def test_stamps_of_a_clock_that_drifts_are_not_late(monkeypatch, drift, found):
    monkeypatch.setattr(lateness, 'walks', lambda *_: False)
    stamp = np.arange(100.0)
    readings = record(stamp, stamp * (1.0 + drift))
    assert bool(lateness.hidden(responding([('stamp', 'position')], 0.1, 1e-3, readings))) is found


@pytest.mark.parametrize(('more', 'found'), [(0.0029, False), (0.0031, True)])
def test_a_delay_of_stamps_is_corrected_until_a_part_of_a_deviation_is_left(more, found):
    labels, option = [('stamp', 'position')], 'position.stamp_offset'
    (finding,) = lateness.hidden(responding(labels, 0.1, 0.01, **{option: 0.03}))
    assert finding.change == {option: 0.13}
    again = finding.again(responding(labels, more, 0.01))
    assert (again is not None) is found
    if found:
        assert again.change == {option: round(0.13 + more, 4)}


@pytest.mark.parametrize(
    ('each', 'run', 'every', 'found'),
    [
        (1, 10, 0.1, True),
        (1, 9, 0.1, False),
        (1, 10, 0.056, True),
        (1, 10, 0.055, False),
        (2, 20, 0.1, True),
        (2, 19, 0.1, False),
    ],
)
def test_a_value_is_frozen_from_ten_repetitions_and_half_a_second_on(each, run, every, found):
    after = np.repeat(np.arange(30.0, 230.0), each)  # a recording of ten seconds or more
    value = np.array([*np.repeat(np.arange(1.0, 21.0), each), *[0.5] * run, *after])
    readings = record(every * np.arange(len(value)), value=value)
    rows = frozen.repeats(readings)
    assert (rows is not None) is found
    findings = frozen.find(case(readings))
    assert kinds(findings) == (['frozen'] if found else [])
    if found:
        assert rows.tolist() == [*range(20 * each, 20 * each + run)]
        kept = findings[0].mended().sensors['position'].value[:, 0]
        assert kept.tolist() == [*value[: 20 * each + 1], *after]
        assert f'for {every * (run - 1):.3g} s from t = {every * 20 * each:.3g} s' in (
            findings[0].sentence
        )


@pytest.mark.parametrize(('run', 'found'), [(16, False), (17, True)])
def test_in_a_short_recording_a_value_is_frozen_for_a_twentieth_of_it(run, found):
    value = np.array([*np.arange(1.0, 201.0), *[0.5] * run, *np.arange(201.0, 321.0 - run)])
    assert len(value) == 320
    rows = frozen.repeats(record(0.01 * np.arange(320), value=value))
    assert (rows is not None) is found


@pytest.mark.slow
@pytest.mark.parametrize('frozen_from', [None, 60])
def test_a_rounded_value_may_rest_where_the_model_expects_it(frozen_from):
    """A sensor of few bits repeats one value for 0.75 s; its driver does for 6 s, in motion."""

    def rounded(values):
        values = 0.2 * np.round(values / 0.2)
        if frozen_from is not None:
            values[frozen_from : frozen_from + 120] = values[frozen_from]
        return values

    edits = {'position': values_of(rounded)}
    given = recorded('mass_spring_damper', Injection(edits=edits), 20.0, 4)
    assert len(frozen.repeats(given.sensors['position'])) > 15
    found = frozen.find(Examination(given, strict=False))
    assert kinds(found) == ([] if frozen_from is None else ['frozen'])


@pytest.mark.parametrize(('count', 'found'), [(10, False), (11, True)])
def test_a_recording_of_one_value_is_frozen(count, found):
    readings = record(0.1 * np.arange(count), value=np.full(count, 0.5))
    assert (frozen.repeats(readings) is not None) is found
    assert kinds(frozen.find(case(readings))) == (['frozen'] if found else [])


@pytest.mark.parametrize(
    ('value', 'square', 'found'), [(0.0, 1.9, False), (0.0, 2.1, True), (0.5, 1.9, True)]
)
def test_zeros_with_which_the_filter_agrees_are_those_of_a_body_at_rest(value, square, found):
    values = np.array([*np.arange(1.0, 21.0), *[value] * 10])
    readings = record(0.1 * np.arange(30), value=values)
    squares = np.where(values == value, square, 9.0)
    assert bool(frozen.find(case(readings, squares))) is found


@pytest.mark.parametrize(
    ('levels', 'count', 'found'),
    [(2, 20, False), (2, 21, True), (3, 100, True), (60, 100, True), (61, 100, False)],
)
def test_values_are_quantised_if_few_are_different(levels, count, found):
    values = 0.3 * np.resize(np.arange(levels), count)
    step = quantisation.grid(values)
    assert (step == pytest.approx(0.3)) if found else (step is None)


@pytest.mark.parametrize(('off', 'found'), [(0.009, True), (0.011, False)])
def test_quantised_values_are_multiples_to_a_hundredth_of_a_step(off, found):
    values = 0.3 * np.resize([0.0, 1.0, 2.0, 4.0 + off], 40)
    assert (quantisation.grid(values) is not None) is found


@pytest.mark.parametrize(('step', 'found'), [(0.51, True), (0.49, False)])
def test_steps_of_half_a_deviation_add_to_the_noise(step, found):
    readings = record(0.1 * np.arange(40), value=0.05 * step * np.resize([0, 1, 2, 5], 40))
    findings = quantisation.find(case(readings))
    assert kinds(findings) == (['quantised'] if found else [])
    for finding in findings:
        noise = 0.05 * np.hypot(1.0, step / 12.0**0.5)
        assert finding.change == {'position.noise': [pytest.approx(noise, rel=1e-2)]}
        R = finding.mended().sensors['position'].covariance
        np.testing.assert_allclose(np.sqrt(R), noise, rtol=1e-2)


@pytest.mark.parametrize(('step', 'absurd'), [(99.0, False), (101.0, True)])
def test_steps_of_a_hundred_deviations_may_be_those_of_another_unit(step, absurd):
    readings = record(0.1 * np.arange(40), value=0.05 * step * np.resize([0, 1, 2, 5], 40))
    (found,) = quantisation.find(case(readings))
    assert found.note is ('unit' in found.sentence) is absurd
    assert (found.mended is None) is (not found.change) is absurd


def test_a_state_that_each_reading_shows_is_observed():
    """Before each reading it is less certain than at the start, as a state that walks far is."""
    case_ = case(record(np.arange(150.0)), initial_std=[0.5, 0.5])
    for event in case_.passage.events:
        event.P, event.K = np.diag([0.30, 0.30]), np.array([[0.25], [0.0]])
    case_.passage.events[0].S = np.eye(1)
    assert [finding.subject for finding in unobserved_states.find(case_)] == ['v']


@pytest.mark.parametrize(
    ('name', 'tau', 'change'),
    [
        ('gnss', -9.9, {'gnss.stamp_offset': -9.9}),
        ('gnss', -10.1, {}),
        ('input', 0.4, {'input.stamp_offset': 0.1}),
        ('plain', 0.4, {}),
    ],
)
def test_an_offset_is_proposed_where_it_is_possible(name, tau, change):
    evidence = SimpleNamespace(parameters={'input.stamp_offset': -0.3}, headerless={'plain'})
    assert lateness.offset_by(evidence, name, tau) == change


@pytest.mark.parametrize(
    ('kind', 'subject', 'concerned'),
    [
        ('scale', 'odom.vx', ('odom',)),
        ('unit', 'left.speed and right.speed', ('left', 'right')),
        ('parameter', 'imu.gravity', ('imu.gravity',)),
    ],
)
def test_a_finding_concerns_sensors_or_a_parameter(kind, subject, concerned):
    assert Finding(kind, subject, '', 1.0).concerned == concerned


@pytest.mark.parametrize(
    ('times', 'found'), [(1.09, False), (1.11, True), (0.91, False), (0.89, True)]
)
def test_a_rate_differs_from_the_declared_one_by_a_tenth(times, found):
    readings = record(0.05 * times * np.arange(40))
    findings = [each for each in rate.find(case(readings)) if each.subject == 'position']
    assert kinds(findings) == (['rate'] if found else [])
    for finding in findings:
        assert finding.change['position.rate'] == pytest.approx(20.0 / times, rel=5e-3)
        assert not finding.note


@pytest.mark.parametrize('steps', [2.4, 2.5, 2.6])
def test_the_rate_of_a_source_that_runs_in_steps_is_that_of_their_mean(steps):
    """A sensor of about 20 Hz on a plant of 50 Hz is read each second or third step."""
    stamp = 0.02 * np.ceil(steps * np.arange(60))
    found = rate.find(case(record(stamp)))
    assert [each.kind for each in found if each.subject == 'position'] == []


def test_times_that_go_back_are_none_between_readings():
    swapped = np.array([0.1, 0.2, -0.1, 0.2, *[0.1] * 20])
    assert records.period(swapped) == pytest.approx(0.1)


@pytest.mark.parametrize(('count', 'found'), [(100, True), (101, False)])
def test_one_reading_in_a_hundred_may_be_lost(count, found):
    stamp = 0.05 * np.delete(np.arange(count), 50)
    findings = [each for each in rate.find(case(record(stamp))) if each.subject == 'position']
    assert kinds(findings) == (['losses'] if found else [])


def test_stamps_that_jitter_lose_nothing():
    rng = np.random.default_rng(4)
    stamp = np.sort(0.05 * np.arange(2000) + 0.012 * rng.normal(size=2000))
    assert not [each for each in rate.find(case(record(stamp))) if 'losses' in each.kind]
    steady = 0.05 * np.arange(2000) + 0.003 * rng.normal(size=2000)
    lost = np.delete(steady, rng.choice(2000, 100, replace=False))
    (found,) = [each for each in rate.find(case(record(lost))) if 'losses' in each.kind]
    assert float(found.sentence.split()[0]) == pytest.approx(5.0, abs=0.7)


@pytest.mark.parametrize(('share', 'note'), [(0.45, False), (0.55, True)])
def test_what_is_read_now_and_then_is_a_note(share, note):
    gone = int(400 * share)
    stamp = 0.02 * np.delete(np.arange(400), np.arange(100, 100 + gone))
    readings = record(stamp)
    found = [each for each in rate.find(case(readings)) if each.subject == 'position']
    (losses,) = [each for each in found if each.kind == 'losses in bursts']
    assert losses.note is note
    assert ('now and then' in losses.sentence) is note
    assert ('rate' in kinds(found)) is not note  # 50 Hz, where 20 are declared


@pytest.mark.parametrize(('count', 'found'), [(5, False), (6, True)])
def test_a_rate_is_known_from_six_readings_on(count, found):
    findings = rate.find(case(record(np.arange(count))))
    assert ('rate' in kinds(findings)) is found


@pytest.mark.parametrize('count', [1, 6])
def test_readings_that_are_not_finite_are_counted(count):
    value = np.arange(6.0)
    value[:count] = np.nan
    (finding,) = (
        each
        for each in rate.find(case(record(0.05 * np.arange(6), value=value)))
        if each.kind == 'not a number'
    )
    assert finding.sentence.startswith(f'{count} of 6 readings of position')
    assert finding.silent is (count == 6)


@pytest.mark.parametrize(
    ('total', 'rejected', 'square', 'harm', 'found'),
    [
        (1000, 34, 1.0, 0.0, True),
        (1000, 33, 1.0, 0.0, False),
        # of twenty, five by chance are too many to be good luck
        (20, 4, 1.0, 0.0, False),
        (20, 5, 1.0, 0.0, True),
        (1000, 34, 3.9, 29.0, True),
        (1000, 34, 3.9, 31.0, False),  # the others fit worse
        (1000, 34, 4.1, -29.0, False),
        (1000, 34, 14.9, -31.0, True),  # the others fit better
        (1000, 34, 15.1, -31.0, False),
        (1000, 34, np.nan, 0.0, False),
    ],
)
def test_a_gate_rejects_good_readings_beyond_chance(
    monkeypatch, total, rejected, square, harm, found
):
    monkeypatch.setattr(gates, '_harm', lambda case, name, rows: harm)
    readings = record(0.05 * np.arange(total))
    readings.outcome[:rejected] = Outcome.REJECTED.name
    readings.outcome[0] = Outcome.OUTVOTED.name
    squares = np.where(np.arange(total) < rejected, square, 1.0)
    findings = gates.find(case(readings, squares, **{'position.gate': 0.99}))
    assert kinds(findings) == (['gate'] if found else [])
    for finding in findings:
        assert finding.change == {'position.gate': 1.0}
        assert finding.sentence.startswith(
            f'the gate of position rejected {rejected} of {total} readings, where '
            f'{0.01 * total:.2g} are expected'
        )


@pytest.mark.parametrize(
    ('std', 'kind'),
    [
        (0.99e3, None),
        (1.01e3, 'covariance absurd'),
        (1.0 / 0.99e3, None),
        (1.0 / 1.01e3, 'covariance absurd'),
    ],
)
def test_a_covariance_is_absurd_beyond_a_factor_of_a_thousand(std, kind):
    readings = record(np.arange(3), covariance=[0.0025, (0.05 * std) ** 2, 0.0025])
    findings = message_covariances.find(case(readings))
    assert kinds(findings) == ([kind] if kind else [])
    for finding in findings:
        assert ' in 1 of 3 messages ' in finding.sentence and not finding.note
        R = finding.mended().sensors['position'].covariance
        np.testing.assert_allclose(R, np.full((3, 1, 1), 0.0025))


@pytest.mark.parametrize('variance', [-1e-9, np.inf, np.nan])
def test_a_variance_is_positive_and_finite(variance):
    readings = record(np.arange(3), covariance=[0.0025, variance, 0.0025])
    assert kinds(message_covariances.find(case(readings))) == ['covariance negative']


def test_a_covariance_of_zero_is_a_note():
    completed = np.array([True, False, True])
    readings = record(np.arange(3), covariance=[1e9, 0.0025, 1e9], completed=completed)
    (finding,) = message_covariances.find(case(readings))
    assert (finding.kind, finding.note) == ('covariance zero', True)
    assert not finding.mended().sensors['position'].completed.any()


@pytest.mark.parametrize(
    ('size', 'gain', 'found'),
    [
        (0.061, 100.0, True),
        (0.002, 100.0, True),
        (-0.061, 100.0, True),
        (0.2, 30.1, True),
        (0.2, 29.9, False),
        (-2.5, 100.0, True),
    ],
)
def test_a_parameter_is_contradicted_beyond_chance_however_little_it_changes(size, gain, found):
    given = {'model_parameters.mass': 2.0}
    labels = [('parameter', 'mass')]
    case = responding(labels, size, abs(size) / gain**0.5, **given)
    findings = contradicted_parameters.find(case)
    assert kinds(findings) == (['parameter'] if found else [])
    for finding in findings:
        mass = finding.change['model_parameters.mass']
        # no mass is negative: there a step is one of the logarithm
        fitted = 2.0 + size if size > -2.0 else 2.0 * np.exp(size / 2.0)
        assert mass == pytest.approx(fitted, rel=3e-3)
        assert finding.gain == pytest.approx(gain)
        assert finding.z == pytest.approx(gain**0.5)
        for more, again in ((0.0029, False), (0.0031, True)):
            after = responding(labels, more, 0.01, **finding.change)
            assert (finding.again(after) is not None) is again


@pytest.mark.parametrize(('known', 'found'), [(45, False), (44, True)])
def test_a_state_is_not_observed_if_it_is_less_certain_for_a_tenth_of_the_time(known, found):
    """Its deviation is compared with the first one, at about fifty events."""
    readings = record(np.arange(150.0))
    case_ = case(readings, initial_std=[0.5, 0.5])
    for k, event in enumerate(case_.passage.events):
        event.P = np.diag([0.25 if k <= 3 * known else 0.26, 0.25])
        event.K = np.zeros((2, 1))
    findings = unobserved_states.find(case_)
    assert [finding.subject for finding in findings] == (['x'] if found else [])
    for finding in findings:
        assert f'from t = {3 * known:.3g} s on' in finding.sentence
        assert len(finding.figure.curves[0].x) == 50


@pytest.mark.parametrize(
    ('offset', 'improves', 'kind'),
    [
        (0.0051, False, 'clock offset'),
        (0.0049, False, None),
        (-0.0201, True, 'clock offset'),
        (-0.0201, False, None),
        (-0.0199, True, None),
    ],
)
def test_a_clock_is_ahead_or_behind(monkeypatch, offset, improves, kind):
    monkeypatch.setattr(stamps, '_improves_fit', lambda *_: improves)
    time = 0.05 * np.arange(40)
    findings = [*stamps.find(case(record(time + offset, time)))]
    assert kinds(findings) == ([kind] if kind else [])
    for finding in findings:
        assert f'{"ahead of" if offset > 0.0 else "behind"} the recorder' in finding.sentence
        np.testing.assert_allclose(finding.mended().sensors['position'].stamp, START + time)


@pytest.mark.parametrize(('drift', 'found'), [(0.0051, True), (-0.0051, True), (0.0049, False)])
def test_a_clock_drifts_by_more_than_five_milliseconds(drift, found):
    time = 0.05 * np.arange(201)  # ten seconds
    readings = record(time * (1.0 - 0.1 * drift), time)
    findings = [*stamps.find(case(readings))]
    assert kinds(findings) == (['clock drift'] if found else [])
    for finding in findings:
        moved = finding.mended().sensors['position'].stamp
        np.testing.assert_allclose(moved, START + time, rtol=0.0, atol=1e-6)


def test_stamps_that_are_zero_are_those_of_the_receipt_less_the_usual_delay():
    time = 0.05 * np.arange(40)
    readings = record(time, time + 0.01)
    zero = np.arange(40) % 7 == 3
    stamp = np.where(zero, readings.received, readings.stamp)
    readings = replace(readings, stamp=stamp, stamped=~zero)
    (finding,) = (each for each in stamps.find(case(readings)) if each.kind == 'stamps zero')
    assert finding.sentence.startswith(f'{zero.sum()} of 40 stamps')
    mended = finding.mended().sensors['position']
    assert mended.stamped.all()
    np.testing.assert_allclose(mended.stamp, START + time, atol=1e-6)


def test_stamps_of_another_reading_are_duplicates():
    time = 0.05 * np.arange(40)
    time[[8, 20]] = time[[7, 19]]
    found = [*stamps.find(case(record(time, 0.05 * np.arange(40))))]
    finding = next(each for each in found if each.kind == 'stamps duplicated')
    assert finding.sentence.startswith('2 of 40 readings')
    kept = finding.mended().sensors['position'].value[:, 0]
    assert kept.tolist() == np.delete(np.arange(40.0), [8, 20]).tolist()


@pytest.mark.parametrize('jitter', [0.0, 0.2])
def test_stamps_run_backward_unless_the_receipt_jitters(monkeypatch, jitter):
    monkeypatch.setattr(stamps, '_improves_fit', lambda *_: False)
    time = 0.05 * np.arange(40)
    time[[10, 11]] = time[[11, 10]]
    received = 0.05 * np.arange(40) + np.resize([0.0, jitter], 40)
    found = [*stamps.find(case(record(time, received)))]
    assert ('stamps backward' in kinds(found)) is (jitter == 0.0)
    for finding in found:
        if finding.kind == 'stamps backward':
            assert finding.sentence.startswith('1 of 40 readings')
            assert (np.diff(finding.mended().sensors['position'].stamp) > 0.0).all()


def rounded(grid, every, count=41, noise=0.0, off=0.0):
    """Return readings whose stamps are rounded, and whose receipt scatters by ``noise``."""
    time = every * np.arange(count)
    stamp = np.round(time / grid) * grid + off
    return record(stamp, np.cumsum(every + noise * np.resize([1.0, -1.0], count)))


def roundings(readings):
    findings = stamps._find_rounded(case(readings).evidence, 'position', readings)
    return [finding.sentence.partition(',')[0] for finding in findings]


@pytest.mark.parametrize('grid', [1.0, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001])
def test_stamps_are_multiples_of_the_time_to_which_they_are_rounded(grid):
    expected = f'stamps of position differ by multiples of {grid:g} s'
    assert roundings(rounded(grid, 3.33 * grid)) == [expected]
    assert roundings(rounded(grid, 3.33 * grid, off=3.2e-6 * (np.arange(41) == 7))) == []
    # a reading that is lost is no irregularity of the receipt
    one_lost = rounded(grid, 3.33 * grid).select(np.arange(41) != 20)
    assert roundings(one_lost) == [expected]


@pytest.mark.parametrize(
    ('grid', 'every', 'jitter', 'found'),
    [
        (0.2, 0.04, 0.0, True),
        (0.2, 0.099, 0.0, True),
        (0.2, 0.12, 0.0, False),  # most stamps are of one reading
        (0.2, 0.04, 0.013, True),
        (0.2, 0.04, 0.019, False),  # they come in pairs
        (0.5, 0.04, 0.0, False),  # too few stamps
    ],
)
@pytest.mark.parametrize('half', [0.0, 0.5])
def test_readings_that_come_one_by_one_and_share_stamps_are_rounded(
    grid, every, jitter, found, half
):
    """Downwards, or to the nearest."""
    time = 0.011 + every * np.arange(120.0)
    received = time + 0.002 + jitter * np.resize([1.0, -1.0], 120)
    stamp = np.floor(time / grid + half) * grid
    evidence = case(record(stamp, received)).evidence
    findings = [*stamps._find_shared(evidence, 'position', evidence.sensors['position'])]
    assert bool(findings) is found
    if found:
        assert findings[0].plain  # the errors of stamps by receipt follow from it
        mended = findings[0].mended().sensors['position'].stamp
        taken = evidence.sensors['position'].received - received + time
        np.testing.assert_allclose(mended, taken, atol=every + jitter + 0.02)


@pytest.mark.parametrize(('apart', 'found'), [(0.001, True), (0.009, True), (0.012, False)])
def test_readings_that_are_stamped_in_batches_and_received_one_by_one(apart, found):
    """Five at a time, every 50 ms each, as a driver stamps what it finds in a buffer."""
    time = 0.05 * np.arange(200.0)
    place = np.arange(200) % 5
    stamp = time[np.arange(200) - place] + apart * place
    evidence = case(record(stamp, time + 0.3)).evidence
    findings = [*stamps._find_shared(evidence, 'position', evidence.sensors['position'])]
    assert bool(findings) is found
    if found:
        assert f'5 readings of position in a row are stamped within {4 * apart:.2g} s' in (
            findings[0].sentence
        )
        mended = findings[0].mended().sensors['position'].stamp
        np.testing.assert_allclose(np.diff(mended), 0.05, atol=1e-9)


def test_a_reading_sent_twice_is_not_rounded():
    stamp = np.repeat(0.1 * np.arange(40.0), 2)
    received = stamp + np.resize([0.002, 0.003], 80)
    evidence = case(record(stamp, received)).evidence
    assert [*stamps._find_shared(evidence, 'position', evidence.sensors['position'])] == []


@pytest.mark.parametrize(
    ('every', 'count', 'found'),
    [(0.193, 41, True), (0.207, 41, False), (0.0333, 21, True), (0.0333, 20, False)],
)
def test_a_rounding_matters_from_a_twentieth_of_the_distance_on(every, count, found):
    assert bool(roundings(rounded(0.01, every, count))) is found


@pytest.mark.parametrize(('times', 'found'), [(2.1, True), (1.9, False)])
def test_stamps_are_rounded_if_the_receipt_is_twice_as_regular(times, found):
    plain = rounded(0.01, 0.0333)
    spread = float(np.std(np.diff(plain.stamp)))
    assert bool(roundings(rounded(0.01, 0.0333, noise=spread / times))) is found


@pytest.mark.parametrize(('outcome', 'note'), [(Outcome.FUSED, True), (Outcome.TOO_OLD, False)])
def test_a_jitter_by_which_no_reading_is_lost_is_a_note(outcome, note):
    stamp = np.arange(20.0)
    late = record(stamp, stamp + np.resize([0.1, 0.9], 20))
    late.outcome[:] = outcome.name
    (finding,) = lateness.find(case(late, window=1.0))
    assert (finding.kind, finding.note) == ('jitter', note)


@pytest.mark.parametrize(('left', 'found'), [(0.0, False), (4e-8, False), (6e-8, True)])
def test_what_arithmetic_leaves_of_zero_is_rest(left, found):
    """A driver of wheels that stand computes 1e-15 m/s, again and again."""
    value = np.r_[np.arange(20.0), np.full(30, left)]
    readings = record(0.05 * np.arange(50), value=value)
    findings = frozen.find(case(readings))
    assert kinds(findings) == (['frozen'] if found else [])


def test_an_outlier_is_rejected_by_the_gate_that_there_is():
    sentences = []
    for gate in (1.0, 0.99):
        readings = record(0.05 * np.arange(100))
        squares = np.ones(100)
        squares[50] = 4000.0
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(outliers, 'rejected', lambda *_: np.array([50]))
            (finding,) = outliers.find(case(readings, squares, **{'position.gate': gate}))
        sentences.append(finding.sentence)
        assert bool(finding.change) is (gate == 1.0)
    assert sentences[0].endswith('A gate rejects them.')
    assert sentences[1].endswith('Its gate is there to reject them.')


@pytest.mark.parametrize(
    ('times', 'found'),
    [([10], True), ([9, 10], True), ([2], True), ([1], False), ([1, 10], False), ([2, 9], False)],
)
def test_values_that_are_published_several_times_have_a_note(times, found):
    lengths = np.resize(times, 30)
    value = np.repeat(np.sin(np.arange(30.0)), lengths)
    findings = rate.find(case(record(0.05 * np.arange(len(value)), value=value)))
    notes = [each for each in findings if each.kind == 'repeated']
    assert bool(notes) is found and all(each.note for each in notes)
    for each in notes:
        assert f'about {np.median(lengths[1:-1]):g} times: ' in each.sentence
