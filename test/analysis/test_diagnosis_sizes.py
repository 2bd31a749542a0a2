# SPDX-License-Identifier: Apache-2.0
"""Causes whose size is fitted: beside a bias that is followed, and where a filter is misled."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay
from tools.strangers.injected.recordings import Injection, recorded

from kalman_ros.analysis.diagnosis import bias, common_noise, stretch, units
from kalman_ros.analysis.diagnosis import inputs as input_faults
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.hypotheses import edges
from kalman_ros.analysis.records import InputRecord
from kalman_ros.core import Sensor, Space

DT, START, STEPS = 0.02, 1000.0, 1500
MASSES, DRAG = np.array([2.0, 4.0]), 3.0


def replayed(truth, inputs, readings, times=None, **configured):
    """Return the evidence of two carts, each pushed by a force, whose places are read.

    ``truth`` has the masses that the carts really have, ``inputs`` (N, 2) what is recorded.
    """
    stamp = START + DT * np.arange(len(inputs))
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    for i, mass in enumerate(MASSES):
        A[2 * i, 2 * i + 1], A[2 * i + 1, 2 * i + 1] = 1.0, -DRAG / mass
        B[2 * i + 1, i] = 1.0 / mass
    given = {
        'model': 'linear', 'rate': 1.0 / DT,
        'model_parameters.states': ['x', 'v', 'y', 'w'],
        'model_parameters.state_units': ['m', 'm/s', 'm', 'm/s'],
        'model_parameters.inputs': ['f', 'g'], 'model_parameters.input_units': ['N', 'N'],
        'model_parameters.A': A.ravel().tolist(), 'model_parameters.B': B.ravel().tolist(),
        'model_parameters.noise_density': [0.0, 1e-4, 0.0, 1e-4],
        'sensors': [*readings], 'initial_estimate': [0.0] * 4, 'initial_std': [0.01] * 4,
    }  # fmt: skip
    for name, (measured, std, _) in readings.items():
        given |= {
            f'{name}.measures': measured, f'{name}.noise': [std] * len(measured),
            f'{name}.rate': 1.0 / DT, f'{name}.type': 'sensor_msgs/JointState',
            f'{name}.fields': [f'position[{i}]' for i in range(len(measured))],
        }  # fmt: skip
    values = {name: value for name, (_, _, value) in readings.items()}
    taken = {name: (stamp + 1e-3, stamp, value, None) for name, value in values.items()}
    commands = InputRecord(stamp + 1e-3, stamp, inputs)
    return replay({**given, **configured}, taken, commands)


def moved(acting, masses=MASSES, seed=3):
    """Return the states (N, 4) of the carts under the forces that act (N, 2)."""
    rng, x, states = np.random.default_rng(seed), np.zeros(4), []
    for u in acting:
        states.append(x)
        decay = np.exp(-DRAG / masses * DT)
        v = x[1::2] * decay + u / DRAG * (1.0 - decay) + 1e-2 * DT**0.5 * rng.normal(size=2)
        x = np.ravel(np.column_stack((x[::2] + 0.5 * DT * (x[1::2] + v), v)))
    return np.array(states)


def pushes(least=0.0):
    """Return forces (N, 2) of both directions, none smaller than ``least``."""
    t = DT * np.arange(STEPS)
    waves = np.column_stack([np.sin(2.1 * t + np.sin(0.3 * t)), np.sin(1.3 * t + np.sin(0.4 * t))])
    return (least + 4.0 * np.abs(waves)) * np.sign(waves)


def places(states, seed=5):
    """Return the readings of the places of both carts."""
    y = states[:, ::2] + 0.002 * np.random.default_rng(seed).normal(size=(len(states), 2))
    return {'places': (['x', 'y'], 0.002, y)}


def first(evidence):
    return diagnose(evidence, proofs=False).findings[0]


@pytest.mark.slow
def test_what_is_right_raises_nothing():
    inputs = pushes()
    assert diagnose(replayed(MASSES, inputs, places(moved(inputs)))).findings == ()


@pytest.mark.slow
def test_all_inputs_that_act_late_are_one_delay():
    inputs, lag = pushes(), 6
    acting = np.vstack((np.zeros((lag, 2)), inputs[:-lag]))
    found = first(replayed(MASSES, inputs, places(moved(acting))))
    # stamps of the only sensor that are as late are the same
    causes = {(found.kind, found.subject), *found.same_as}
    assert causes >= {('input delay', 'f, g'), ('stamps late', 'places')}
    (size,) = re.search(r'(0\.\d+) ± ', found.sentence).groups()
    assert float(size) == pytest.approx(0.12, abs=0.001)


@pytest.mark.slow
def test_one_input_that_acts_late_is_named_alone():
    inputs, lag = pushes(), 6
    acting = inputs.copy()
    acting[:, 1] = np.concatenate((np.zeros(lag), inputs[:-lag, 1]))
    found = first(replayed(MASSES, inputs, places(moved(acting))))
    assert (found.kind, found.subject) == ('input delay', 'g')


@pytest.mark.slow
def test_a_dead_zone_below_every_command_is_found():
    inputs = pushes(least=3.0)
    acting = inputs - np.clip(inputs, -1.0, 1.0) * [1.0, 0.0]
    found = first(replayed(MASSES, inputs, places(moved(acting))))
    assert (found.kind, found.subject) == ('dead zone', 'f')
    assert float(found.sentence.split()[2]) == pytest.approx(1.0, rel=0.05)


@pytest.mark.slow
def test_another_mass_is_the_row_of_its_speed():
    inputs = pushes()
    found = first(replayed(MASSES, inputs, places(moved(inputs, np.array([2.0, 5.0])))))
    assert (found.kind, found.subject) == ('parameter', 'A[w]')
    share = found.change['model_parameters.B'][-1] * MASSES[1]
    assert share == pytest.approx(MASSES[1] / 5.0, rel=0.02)
    assert f'the row of w in A and B: {share:.1f}'[:-1] in found.sentence


@pytest.mark.slow
def test_a_scale_beside_a_bias_that_is_followed_is_a_scale():
    inputs, rng = pushes() + np.array([9.0, 0.0]), np.random.default_rng(8)
    states = moved(inputs)
    rate = 1.03 * states[:, 1:2] + 0.05 + 0.002 * rng.normal(size=(len(states), 1))
    readings = {**places(states), 'speed': (['v'], 0.002, rate)}
    evidence = replayed(MASSES, inputs, readings, **{'speed.bias_std': [0.1]})
    found = first(evidence)
    assert (found.kind, found.subject) == ('scale', 'speed.v')
    assert float(found.sentence.split()[9]) == pytest.approx(1.0 / 1.03, abs=0.003)
    # what is left beside the likeliest bias promises another scale
    left = Examination(bias.without_declared(Examination(evidence)))
    (column,) = left.responses.columns('mix', 'speed', '0', '0')
    assert abs(float(left.responses.alone(column).size[0])) < 0.8 * 0.03


def test_without_a_declared_bias_nothing_is_integrated_out():
    inputs = pushes()
    case = Examination(replayed(MASSES, inputs, places(moved(inputs))))
    assert bias.integrated(case) is case


class Field(Sensor):
    """A field of 1, seen in the axes of a vehicle with the heading y."""

    def __init__(self, state, noise):
        self.output = Space(('ahead', 'left'), ('T', 'T'))
        self.covariance = np.diag(np.square(noise))

    def measure(self, x):
        return np.stack([np.cos(x[..., 2]), -np.sin(x[..., 2])], axis=-1)


@pytest.mark.slow
def test_a_bias_that_misleads_the_filter_is_no_walk():
    rng, inputs = np.random.default_rng(9), 2.0 * pushes()
    states = moved(inputs)
    y = np.column_stack((np.cos(states[:, 2]), -np.sin(states[:, 2])))
    y += [0.4, 0.0] + 0.01 * rng.normal(size=y.shape)
    evidence = replayed(
        MASSES, inputs, {'place': (['x'], 0.002, places(states)['places'][2][:, :1]),
                         'field': (['x', 'y'], 0.01, y)},
        **{'field.kind': f'{__name__}:Field', 'field.measures': None, 'filter': 'ekf'},
    )  # fmt: skip
    found = first(evidence)
    assert (found.kind, found.subject) == ('bias', 'field')
    assert float(found.sentence.split(' by ')[1].split()[0]) == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
def test_gains_of_inputs_are_fitted_together():
    """Both carts are pushed by much the same force, so that each alone takes part of the blame."""
    inputs = pushes()
    inputs[:, 1] = inputs[:, 0] + 0.1 * inputs[:, 1]
    found = first(replayed(MASSES, inputs, places(moved(inputs * [1.0, 0.8]))))
    assert (found.kind, found.subject) in (('input gain', 'g'), ('parameter', 'B[7]'))


@pytest.mark.slow
def test_all_inputs_that_act_alike_have_one_gain():
    inputs = pushes()
    found = diagnose(replayed(MASSES, inputs, places(moved(inputs * 0.9))), proofs=False).findings
    assert (found[0].kind, found[0].subject) == ('input gain', 'f')
    assert float(found[0].sentence.split(' at ')[1].split()[0]) == pytest.approx(0.9, abs=0.005)
    assert 'all of it' in found[0].sentence and found[0].parameters == 1


def loose(rng, place):
    """A gear with a play of .02 m, which follows the motion by half of it behind."""
    way, last = np.empty(len(place)), 1.0
    for k, rate in enumerate(np.gradient(place, DT)):
        last = np.sign(rate) if abs(rate) > 0.05 else last
        way[k] = last
    return place - 0.01 * way


def alike(rng, place):
    """Noise of the declared size that decays within a second."""
    errors, left = np.zeros(len(place)), np.exp(-DT)
    errors[0] = 0.002 * rng.normal()
    for k in range(1, len(place)):
        errors[k] = left * errors[k - 1] + 0.002 * (1.0 - left**2) ** 0.5 * rng.normal()
    return place + errors


def stepped(rng, place):
    return place + 0.004 * (DT * np.arange(len(place)) > 17.3)


def growing(rng, place):
    return place + 0.0008 * DT * np.arange(len(place))


@pytest.mark.slow
@pytest.mark.parametrize(
    ('fault', 'kind', 'noise', 'word', 'size', 'within'),
    [
        (loose, 'backlash', 0.002, 4, 0.01, 0.0005),
        (alike, 'coloured noise', 0.0, 7, 1.0, 0.6),
        (stepped, 'bias', 0.002, 14, 17.3, 0.15),
        (growing, 'drift', 0.002, 9, 0.0008, 3e-5),
    ],
)
def test_the_course_of_an_error_is_told_with_its_size(fault, kind, noise, word, size, within):
    """One of two readings of the same place is wrong, so that the other one tells."""
    rng, inputs = np.random.default_rng(11), pushes()
    states = moved(inputs)
    y = fault(rng, states[:, 0]) + noise * rng.normal(size=STEPS)
    readings = {**places(states), 'scale': (['x'], 0.002, y[:, None])}
    found = first(replayed(MASSES, inputs, readings))
    assert found.kind == kind and found.subject.startswith('scale'), found.sentence
    words = [part.strip('+;,:') for part in found.sentence.split()]
    assert float(words[word]) == pytest.approx(size, abs=within), found.sentence
    # without it nothing is left
    assert Examination(found.mended()).passage.mean_square == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize('kind', ['constant', 'ramp', 'step'])
def test_an_offset_is_fitted_again_about_what_was_corrected(kind):
    inputs = pushes()
    states = moved(inputs)
    case = Examination(replayed(MASSES, inputs, places(states)))
    limits = edges(case.passage)
    shape = bias._shape(kind, 7, len(limits) - 1)
    times = case.evidence.sensors['places'].stamp
    piece = np.clip(np.searchsorted(limits, times, 'right') - 1, 0, len(shape) - 1)
    y = places(states)['places'][2] + 0.01 * shape[piece][:, None] * [1.0, 0.0]
    case = Examination(
        replayed(MASSES, inputs, {**places(states), 'places': (['x', 'y'], 0.002, y)})
    )
    rough = bias.Course(kind, 0.004 * shape, 100.0, began=7)
    found = bias._finding(case, 'places', {0: rough}, limits)
    once = found.again(Examination(found.mended()))
    again = bias._finding(case, 'places', {0: replace(rough, values=0.01 * shape)}, limits)
    read = [each.mended().sensors['places'].value[:, 0] for each in (once, again)]
    np.testing.assert_allclose(*read, atol=0.002 * shape.max())


@pytest.mark.slow
def test_noise_that_two_sensors_share_is_found_beside_what_hides_it():
    rng, inputs = np.random.default_rng(12), pushes()
    states, common = moved(inputs), np.random.default_rng(13).normal(size=(STEPS, 1))
    readings = {
        name: (['x'], 0.002, states[:, :1] + 0.0014 * (common + rng.normal(size=(STEPS, 1))))
        for name in ('left', 'right')
    }
    found = first(replayed(MASSES, inputs, {**places(states), **readings}))
    assert (found.kind, found.subject) == ('correlated noise', 'left and right')


@pytest.mark.slow
def test_noise_that_is_in_common_in_two_coordinates():
    """Of opposite sign in one of them. What is left once it is independent is right."""
    rng, inputs = np.random.default_rng(15), pushes()
    states = moved(inputs)
    common, alone = 0.002 * rng.normal(size=(2, STEPS, 2))
    mixed = np.array([0.8, -0.8]) * common + 0.6 * alone
    read = {
        'left': (['x', 'y'], 0.002, states[:, [0, 2]] + common),
        'right': (['x', 'y'], 0.002, states[:, [0, 2]] + mixed),
    }
    case = Examination(replayed(MASSES, inputs, {**places(states), **read}))
    (found,) = common_noise.find(case)
    assert found.subject == 'left and right' and found.gain > 500.0
    assert '(and of 1 more pair) has the correlation ' in found.sentence
    size = float(found.sentence.partition('correlation ')[2].split(' ')[0])
    sign = 1.0 if 'left.x and right.x' in found.sentence else -1.0
    assert sign * size == pytest.approx(0.8, abs=0.1)
    after = Examination(found.mended())
    assert common_noise.find(after) == []
    assert after.passage.mean_square == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_what_the_model_lacks_is_not_noise_in_common():
    """A force that nobody declared moves what both sensors read."""
    inputs = pushes()
    pushed = inputs + 0.5 * (np.sin(DT * np.arange(STEPS)) > 0.0)[:, None]
    states, rng = moved(pushed), np.random.default_rng(16)
    read = {
        name: (['x'], 0.002, states[:, :1] + 0.002 * rng.normal(size=(STEPS, 1)))
        for name in ('left', 'right')
    }
    findings = diagnose(
        replayed(MASSES, inputs, {**places(states), **read}), proofs=False
    ).findings
    assert findings and 'correlated noise' not in {each.kind for each in findings}


@pytest.mark.slow
@pytest.mark.parametrize('alike', [0.0, 0.6, 0.9])
def test_noise_in_common_of_sensors_whose_coordinates_are_correlated(alike):
    rng, inputs = np.random.default_rng(17), pushes()
    states, root = moved(inputs), np.linalg.cholesky(np.array([[1.0, alike], [alike, 1.0]]))
    common, one, other = 0.002 * rng.normal(size=(3, STEPS, 2)) @ root.T
    read = {
        name: (['x', 'y'], 0.002, states[:, [0, 2]] + 0.5**0.5 * (common + alone))
        for name, alone in (('left', one), ('right', other))
    }
    evidence = replayed(MASSES, inputs, {**places(states), **read})
    R = 0.002**2 * root @ root.T
    for name in read:
        record = evidence.sensors[name]
        whole = np.broadcast_to(R, record.covariance.shape).copy()
        evidence = evidence.with_sensor(name, replace(record, covariance=whole))
    (found,) = common_noise.find(Examination(evidence))
    size = float(found.sentence.partition('correlation ')[2].split(' ')[0])
    assert size == pytest.approx(0.5, abs=0.1) and found.gain > 300.0


@pytest.mark.slow
def test_a_push_on_one_of_several_inputs_is_named_alone():
    inputs = pushes()
    found = first(replayed(MASSES, inputs, places(moved(inputs + np.array([0.0, 0.5])))))
    assert (found.kind, found.subject) == ('disturbance', 'g')
    assert float(found.sentence.split()[2]) == pytest.approx(0.5, abs=0.02)


@pytest.mark.slow
def test_readings_of_a_slow_process_are_exchanged():
    """Two tanks that each keep their level, so that the filter believes what it reads."""
    rng, inputs = np.random.default_rng(14), np.zeros((STEPS, 2))
    states = moved(inputs) + np.array([0.05, 0.0, -0.05, 0.0])
    swap = {'first': 2, 'second': 0}
    readings = {
        name: (measured, 0.002, states[:, [at]] + 0.002 * rng.normal(size=(STEPS, 1)))
        for (name, at), measured in zip(swap.items(), (['x'], ['y']))
    }
    readings['other'] = (['x'], 0.004, states[:, :1] + 0.004 * rng.normal(size=(STEPS, 1)))
    found = first(replayed(MASSES, inputs, readings, initial_std=[0.1, 0.01, 0.1, 0.01]))
    assert (found.kind, found.subject) == ('swapped', 'first')
    assert 'first and second are exchanged' in found.sentence


@pytest.mark.slow
def test_what_an_input_loses_at_all_times_is_no_dead_zone():
    given = pushes() + np.array([7.0, 0.0])  # the first one is never near zero
    case = Examination(replayed(MASSES, given, places(moved(given - np.array([0.6, 0.0])))))
    kinds = {finding.kind for finding in input_faults.find(case) if finding.subject == 'f'}
    assert 'disturbance' in kinds and 'dead zone' not in kinds


@pytest.mark.parametrize(('every', 'count'), [(1, 1), (400, 0)])
def test_a_sine_is_corrected_where_inputs_follow_it(every, count):
    """A command that holds for seconds has no room for a sine between two of them."""
    time = DT * np.arange(STEPS)
    given = np.zeros((STEPS, 2))
    shaken = given + np.array([2.0, 0.0]) * np.sin(2.0 * np.pi * 0.4 * time)[:, None]
    evidence = replayed(MASSES, given, places(moved(shaken)))
    record = evidence.inputs
    rare = InputRecord(record.received[::every], record.stamp[::every], record.value[::every])
    found = input_faults._find_tones(Examination(replace(evidence, inputs=rare)))
    assert len([finding for finding in found if 'at 0.4' in finding.sentence]) == count


@pytest.mark.slow
def test_noise_that_is_correlated_in_time_hides_no_offset():
    rng, inputs = np.random.default_rng(11), pushes()
    states = moved(inputs)
    y = alike(rng, states[:, 0]) + 0.004 * (DT * np.arange(STEPS) > 15.0)
    readings = {**places(states), 'scale': (['x'], 0.002, y[:, None])}
    findings = diagnose(replayed(MASSES, inputs, readings), proofs=False).findings
    assert findings[0].kind == 'coloured noise'
    offsets = {'bias', 'drift', 'random walk', 'disturbed'}
    assert any(each.kind in offsets and each.subject == 'scale' for each in findings)


@pytest.mark.slow
def test_a_scale_with_the_declared_noise_is_compared_with_a_bias():
    """Of a speed that hardly changes, only a scale that leaves the noise alone fits as well."""
    noise, factor, force = 0.1, 0.8, 6.0 + np.sin(0.7 * DT * np.arange(STEPS))
    inputs = np.column_stack((force, -force))
    states, rng = moved(inputs), np.random.default_rng(5)
    speed = factor * states[:, 1:2] + noise * rng.normal(size=(STEPS, 1))
    readings = {**places(states), 'speed': (['v'], noise, speed)}
    found = first(replayed(MASSES, inputs, readings))
    assert (found.kind, found.subject) == ('scale', 'speed.v')
    assert found.change['speed.C'][1] == pytest.approx(factor, rel=0.02)
    assert found.change['speed.noise'] == pytest.approx([noise], rel=1e-3)


@pytest.mark.slow
def test_a_step_of_a_bias_that_the_estimator_follows():
    """The likeliest constant takes a part of the step with it."""
    followed = Injection(estimator={'velocity.bias_std': [0.1]})
    spring = recorded('mass_spring_damper', followed, 20.0, 3)
    record = spring.sensors['velocity']
    late = record.stamp[:, None] >= spring.start + 8.0
    stepped = Examination(spring.with_values('velocity', record.value + 0.3 * late))
    (found,) = bias.find(Examination(bias.without_declared(stepped)))
    size, std, begin = re.search(r'by (\S+) ± (\S+) from t = (\S+) s on', found.sentence).groups()
    assert (found.kind, found.subject) == ('bias', 'velocity')
    assert float(size) == pytest.approx(0.3, abs=3.0 * float(std)) and float(std) < 0.05
    assert float(begin) == pytest.approx(8.0, abs=0.5)
    mended = found.mended().sensors['velocity'].value - record.value
    assert np.median(mended[late]) == pytest.approx(np.median(mended[~late]), abs=0.05)


@pytest.mark.slow
def test_a_step_is_no_stretch():
    spring = recorded('mass_spring_damper', None, 20.0, 3)
    record = spring.sensors['velocity']
    off = {'to the end': record.stamp >= spring.start + 8.0}
    off['for a time'] = off['to the end'] & (record.stamp < spring.start + 14.0)
    found = {
        what: [
            finding.subject
            for finding in stretch._find_offsets(
                Examination(spring.with_values('velocity', record.value + 0.3 * rows[:, None]))
            )
        ]
        for what, rows in off.items()
    }
    assert 'velocity' in found['for a time'] and 'velocity' not in found['to the end']


def test_a_step_is_tried_beside_a_drift_that_explains_nearly_as_much():
    """A step about the middle has much of the shape of a ramp."""
    spring = recorded('mass_spring_damper', None, 20.0, 3)
    record = spring.sensors['velocity']
    late = record.stamp[:, None] >= spring.start + 8.0
    ramp = 0.1 * (record.stamp[:, None] - spring.start) / 20.0
    mixed = spring.with_values('velocity', record.value + 0.3 * late + ramp)
    findings = bias.find(Examination(mixed))
    kinds = [each.kind for each in findings if each.subject == 'velocity']
    assert kinds == ['drift', 'bias']


def test_a_factor_far_from_one_is_that_of_the_readings():
    """A filter that believes the wrong readings predicts them, so that a regression knows none."""
    spring = recorded('mass_spring_damper', None, 20.0, 3)
    record = spring.sensors['position']
    wrong = Examination(spring.with_values('position', 5.61 * record.value))
    kinds = {(each.kind, each.subject): each for each in units.find(wrong)}
    found = kinds['scale', 'position.x']
    size, std = re.search(r'multiplied by (\S+) ± (\S+):', found.sentence).groups()
    assert float(size) == pytest.approx(1.0 / 5.61, abs=3.0 * float(std))
    assert float(std) < 0.05 * float(size)


def test_a_factor_of_readings_with_the_wrong_sign_is_next_to_none():
    """The root of which nothing cancels, where a reading is far on the other side."""
    y, noise, count = 5e6, 0.01, 100
    information = np.array([[count * y**2 / noise**2]])
    responses = SimpleNamespace(
        columns=lambda *_: [0], gradient=2.0 * information[0], information=information
    )
    case = SimpleNamespace(responses=responses, passage=SimpleNamespace(of=lambda _: range(count)))
    factor, std = units._of_readings(case, 'gnss', (0,))
    assert factor == pytest.approx(4e-18, rel=1e-6) and 0.0 < std < factor


def test_a_filter_that_fits_has_no_factor_far_from_one(monkeypatch):
    """The largest gain of a factor is then one of the noise."""
    spring = recorded('mass_spring_damper', None, 20.0, 3)
    wide = Examination(spring.adopting({'position.noise': [1.0], 'velocity.noise': [3.0]}))
    monkeypatch.setattr(units, '_of_readings', lambda *_: pytest.fail('it is not looked for'))
    units._likeliest_factor(wide, 'position', (0,), 0.9, 0.01)
