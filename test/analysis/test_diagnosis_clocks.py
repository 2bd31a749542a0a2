# SPDX-License-Identifier: Apache-2.0
"""Clocks that are ahead of the recorder, and what the owner of a file corrects on purpose."""

from dataclasses import replace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import diagnose as diagnose_module
from kalman_ros.analysis.diagnosis import stamps
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.finding import Finding

OFFSET = 'mass_spring_damper'


@pytest.fixture(scope='module')
def spring():
    return recorded(OFFSET, None, 10.0, 3)


def of_clocks(evidence):
    found = stamps.find(Examination(evidence, strict=False))
    return [each for each in found if each.kind == 'clock offset']


def moved(evidence, name, seconds):
    """Return a recording in which the stamps of a sensor are ``seconds`` later."""
    record = evidence.sensors[name]
    return evidence.with_sensor(name, replace(record, stamp=record.stamp + seconds))


@pytest.mark.slow
def test_a_corrected_stamp_may_be_ahead_of_the_recorder(spring):
    """The owner says when a reading was taken; what is ahead of the recorder is no clock then."""
    name, source = 'position', spring.scenario.sensors['position']
    signal = replace(source.signal, stamp_offset=300_000_000)
    sensors = {**spring.scenario.sensors, name: replace(source, signal=signal)}
    corrected = replace(spring, scenario=replace(spring.scenario, sensors=sensors))
    assert [each.subject for each in of_clocks(moved(spring, name, 0.3))] == [name]
    assert of_clocks(moved(corrected, name, 0.3)) == []
    assert [each.subject for each in of_clocks(moved(corrected, name, 0.6))] == [name]


def test_inputs_from_the_future_are_an_offset_of_their_clock(spring):
    assert len(spring.inputs.stamp) > 3 and of_clocks(spring) == []
    late = replace(spring, inputs=replace(spring.inputs, stamp=spring.inputs.received + 0.2))
    (found,) = of_clocks(late)
    assert found.subject == 'input'
    assert 'stamps of the input are 0.2 s ahead of the recorder (received - stamp of others: ' in (
        found.sentence
    )
    np.testing.assert_allclose(found.mended().inputs.stamp, late.inputs.received, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('seconds', [0.25, -0.6])
def test_a_clock_that_is_set_is_an_offset_from_then_on(spring, seconds):
    name, record = 'position', spring.sensors['position']
    late = np.arange(len(record)) >= 80
    set_once = spring.with_sensor(name, replace(record, stamp=record.stamp + seconds * late))
    assert [each for each in stamps.find(Examination(spring, strict=False)) if not each.note] == []
    (found,) = of_clocks(set_once)
    when = record.received[80] - spring.start
    assert f'jump by {seconds:+.3g} s against the recorder at t = {when:.3g} s' in found.sentence
    np.testing.assert_allclose(found.mended().sensors[name].stamp, record.stamp, atol=1e-3)
    # one that is right from then on was wrong before
    right_later = spring.with_sensor(name, replace(record, stamp=record.stamp + seconds * ~late))
    (found,) = of_clocks(right_later)
    assert f'jump by {-seconds:+.3g} s' in found.sentence
    np.testing.assert_allclose(found.mended().sensors[name].stamp, record.stamp, atol=1e-3)


def test_what_has_no_stamp_is_not_moved(spring):
    name, record = 'position', spring.sensors['position']
    late, stamped = np.arange(len(record)) >= 80, np.arange(len(record)) % 10 > 0
    stamp = np.where(stamped, record.stamp + 0.25 * late, record.received)
    mixed = spring.with_sensor(name, replace(record, stamp=stamp, stamped=stamped))
    (found,) = of_clocks(mixed)
    mended = found.mended().sensors[name].stamp
    np.testing.assert_array_equal(mended[~stamped], stamp[~stamped])
    np.testing.assert_allclose(mended[stamped], record.stamp[stamped], atol=1e-3)


@pytest.mark.slow
def test_a_network_that_becomes_slower_leaves_stamps_right(spring):
    name, record = 'position', spring.sensors['position']
    late = np.arange(len(record)) >= 80
    slower = replace(record, received=record.received + 0.25 * late)
    assert of_clocks(spring.with_sensor(name, slower)) == []


def test_a_jump_is_told_from_a_drift_and_from_jitter():
    rng, count = np.random.default_rng(0), 200
    step = np.where(np.arange(count) < 60, 0.0, 0.1)
    found = stamps._jump(step + 0.005 * rng.uniform(size=count))
    assert found.at == 60
    assert (found.before, found.after) == pytest.approx((0.0025, 0.1025), abs=0.001)
    for other in (
        np.linspace(0.0, 0.1, count), 0.1 * rng.uniform(size=count), np.zeros(count),
        np.where(np.arange(count) < 5, 0.0, 0.1),
    ):  # fmt: skip
        assert stamps._jump(other) is None


def test_a_proof_begins_where_the_sensor_of_the_change_moves(spring):
    name, record = 'position', spring.sensors['position']
    begin = float(record.received[0]) - spring.start
    resting, late = record.value.copy(), len(record) // 2
    resting[:late] = resting[0]
    resting[late:] += 100.0
    rests = spring.with_values(name, resting)
    change = Finding('scale', name, 'it is off', 9.0, {f'{name}.noise': [0.1]})
    seconds = diagnose_module._proof_seconds
    assert seconds(rests, change) == pytest.approx(20.0 + record.received[late] - spring.start)
    still = spring.with_values(name, np.zeros_like(resting))
    assert seconds(still, change) == pytest.approx(20.0 + begin)
    # of a parameter of the model, the first sensor that moves
    of_model = replace(change, change={'model_parameters.mass': 2.0})
    begins = {each: diagnose_module._moves(spring.sensors[each]) for each in spring.sensors}
    del begins[name]
    assert seconds(rests, of_model) == pytest.approx(20.0 + min(begins.values()) - spring.start)


def test_findings_of_the_same_words_are_different_ones():
    """Pictures have arrays, of which equality is no truth."""
    one, other = (Finding('scale', 'imu', 'it is off.', np.zeros(2)) for _ in range(2))
    assert one != other and one in [other, one] and other not in [one]


@pytest.mark.parametrize('origin', [0, 162_895_260])
def test_stamps_are_multiples_of_a_time_by_the_clock_that_counts(spring, origin):
    stamps_of = 0.1 * np.arange(40) - 1e-9 * origin
    record = replace(spring.sensors['position'].select(slice(40)), stamp=stamps_of)
    evidence = replace(spring, origin=1_700_000_000_000_000_000 + origin)
    assert stamps._grid(evidence, record) == pytest.approx(0.1)
    shifted = replace(record, stamp=record.stamp + 0.0203)
    assert stamps._grid(evidence, shifted) == 0.0
    assert stamps._grid(evidence, record.select(slice(stamps._ENOUGH))) == 0.0  # too few


def test_stamps_are_multiples_of_the_least_time_between_them(spring):
    """Not those of a sensor with a constant period, of which some readings are lost."""
    name, rng = 'position', np.random.default_rng(3)
    taken = 0.1 * np.arange(100) + rng.uniform(0.0, 0.02, 100)
    record = spring.sensors[name].select(slice(100))

    def grid(stamp):
        return stamps._grid(spring, replace(record.select(slice(len(stamp))), stamp=stamp))

    for step in (1.0 / 60.0, 0.036, 0.26, 1.0 / 3.0):  # below and above the time between readings
        rounded = np.round(0.0123 + step * np.floor(taken / step), 9)
        assert grid(rounded) == pytest.approx(step, abs=1e-6)
    regular = 0.0123 + 0.1 * np.arange(100)
    assert grid(regular) == grid(regular[rng.random(100) > 0.2]) == 0.0
    assert grid(taken) == 0.0


@pytest.mark.parametrize(('late', 'kind'), [(0.05, 'stamps rounded'), (0.15, 'clock offset')])
def test_an_age_below_the_grid_of_all_stamps_is_what_rounding_took(
    monkeypatch, spring, late, kind
):
    name = 'position'
    record = spring.sensors[name]
    stamp = 0.1 * np.arange(len(record))
    changed = replace(record, stamp=stamp, received=stamp + late)
    monkeypatch.setattr(stamps, '_improves_fit', lambda *given: True)
    case = Examination(spring.with_sensor(name, changed), strict=False)
    (finding,) = stamps._find_clock_error(case, name, changed)
    assert finding.kind == kind
    np.testing.assert_allclose(finding.mended().sensors[name].stamp, changed.received)
    assert finding.same_as == ((('clock offset', name),) if kind == 'stamps rounded' else ())
