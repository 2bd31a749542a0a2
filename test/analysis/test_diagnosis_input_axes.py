# SPDX-License-Identifier: Apache-2.0
"""Inputs that act along other axes than commanded, or in other units."""

from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import gross, input_axes
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.passage import Passage
from kalman_ros.analysis.diagnosis.responses import Responses
from kalman_ros.core import rotations


@pytest.fixture(scope='module')
def plane():
    return recorded('mass_spring_damper_2d', seconds=12.0, seed=4)


@pytest.fixture(scope='module')
def space():
    return recorded('inertial', seconds=4.0, seed=4)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def euler_in(sentence):
    return [float(a) for a in sentence.split('rotation: [')[1].split(']')[0].split(',')]


@pytest.mark.slow
def test_what_acts_as_commanded_has_its_axes(plane, space):
    assert not input_axes.find(Examination(plane))
    assert not input_axes.find(Examination(space))


@pytest.mark.thorough
@pytest.mark.slow
def test_two_inputs_that_are_exchanged(plane):
    finding, *_ = diagnose(input_axes.mixed(plane, np.eye(2)[::-1])).findings
    assert (finding.kind, finding.subject) == ('input swapped', 'input')
    assert 'f_x and f_y' in finding.sentence


@pytest.mark.slow
@pytest.mark.parametrize('angle', [1.0, -1.4])
def test_a_force_that_is_turned_in_its_plane(plane, angle):
    turned = Examination(input_axes.mixed(plane, rotation(-angle)))
    finding = next(f for f in input_axes.find(turned) if f.kind == 'input rotated')
    nearer = finding.again(Examination(finding.mended()))
    found = float(nearer.sentence.split('turned by ')[1].split(' deg')[0])
    assert found == pytest.approx(np.degrees(angle), abs=8.0)
    assert nearer.parameters == 1


@pytest.mark.slow
def test_an_instrument_is_turned_with_all_its_vectors(space):
    turn = np.array([0.0005, -0.0005, 0.03])
    askew = Examination(input_axes.mixed(space, np.kron(np.eye(2), rotations.exp(turn).T)))
    found = [f for f in input_axes.find(askew) if 'the input acts' in f.sentence]
    assert len(found) <= 1  # the rotation of both vectors, and not of one alone


@pytest.mark.slow
@pytest.mark.parametrize('angle', [0.031, 1.0, np.pi])
def test_the_rotation_of_an_instrument_is_the_likeliest_one(space, angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    M = np.kron(np.eye(2), rotations.exp(angle * axis))
    names, labels, change = space.scenario.model.input.names, [], []
    for i, j in np.ndindex(6, 6):
        across = ('across', names[i], names[j])
        labels.append(('gain', names[i]) if i == j else across)
        change.append(M[i, j] - (i == j))
    information = np.kron(np.diag([3.0, 2.0, 1.0, 2.0, 1.0, 3.0]) * 1e6, np.eye(6))
    case = Examination(space)
    case.__dict__['responses'] = Responses(labels, information @ change, information)
    vectors = input_axes._instruments(space.scenario.model.input)[-1]
    found = input_axes._likeliest_rotation(case, vectors)
    np.testing.assert_allclose(found, M[:3, :3], atol=1e-5)


@pytest.mark.thorough
@pytest.mark.slow
def test_a_lost_filter_finds_the_rotation_by_its_passes(space):
    turn = np.array([0.0, 0.0, 0.5 * np.pi])
    askew = Examination(input_axes.mixed(space, np.kron(np.eye(2), rotations.exp(turn).T)), False)
    until = askew.passage.events[0].time + 1.0
    (finding,) = input_axes.by_passes(askew, until)
    np.testing.assert_allclose(euler_in(finding.sentence), rotations.to_euler(turn), atol=0.1)


@pytest.mark.parametrize(
    ('factor', 'kind', 'why'),
    [(np.pi / 180.0, 'input gain', 'it is in degrees'), (-1.0, 'input sign', 'the wrong sign')],
)
def test_rates_in_another_unit_or_direction_are_tried(space, factor, kind, why, monkeypatch):
    monkeypatch.setattr(input_axes, 'by_passes', lambda case, until: iter(()))
    wrong = Examination(input_axes.mixed(space, np.diag([*[1.0 / factor] * 3, 1.0, 1.0, 1.0])))
    tried = [f for f in gross._input_candidates(wrong) if (f.kind, f.subject) == (kind, 'wx')]
    finding = next(f for f in tried if 'wx, wy, wz' in f.sentence and why in f.sentence)
    np.testing.assert_allclose(finding.mended().inputs.value, space.inputs.value)


def test_a_filter_is_lost_from_where_its_errors_are():
    def onset(whitened):
        events = [SimpleNamespace(time=0.1 * k) for k in range(400)]
        return gross._onset(SimpleNamespace(passage=Passage(events, whitened)))

    later = [np.full(2, 0.1 if k < 200 else 20.0) for k in range(400)]
    assert onset(later) == pytest.approx(20.0, abs=0.2)
    assert onset([np.full(2, 1.0)] * 400) == 0.0
    # from the beginning, but not of one reading
    assert 0.2 < onset([np.full(2, 3.0)] * 400) < 1.5
