# SPDX-License-Identifier: Apache-2.0
"""A scale or a unit that two sensors share, and that neither shows beside the other."""

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay
from tools.strangers.injected.recordings import Injection, simulated

from kalman_ros.analysis.diagnosis import common_scale, units
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.trials import Trials
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

NAME = 'mass_spring_damper_2d'
#: A mass in a plane whose two speeds are read by a sensor each.
PARAMETERS = {
    **{key: value for key, value in from_file(shipped.file(NAME), 'estimator').items()
       if not key.startswith(('position.', 'velocity.'))},
    'sensors': ['left', 'right', 'place'],
    'left.measures': ['v_x'], 'left.noise': [0.5], 'left.rate': 100.0,
    'right.measures': ['v_y'], 'right.noise': [0.5], 'right.rate': 100.0,
    **{f'{name}.type': 'geometry_msgs/Vector3Stamped' for name in ('left', 'right', 'place')},
    'left.fields': ['vector.x'], 'right.fields': ['vector.x'],
    'place.fields': ['vector.x', 'vector.y'],
    'place.measures': ['x', 'y'], 'place.noise': [0.05, 0.05], 'place.rate': 20.0,
}  # fmt: skip


def recorded(*factors, offset=0.0, **changes):
    """Return a recording of 20 s with the speeds multiplied by factors, and with an offset."""
    readings, inputs = simulated(NAME, Injection(), 20.0, 3)
    speed, place = readings['velocity'], readings['position']
    given = {'place': (place.received, place.stamp, place.value, place.covariance)}
    for index, (name, factor) in enumerate(zip(('left', 'right'), factors)):
        value = factor * speed.value[:, index : index + 1] + offset
        given[name] = (speed.received, speed.stamp, value, None)
    return replay({**PARAMETERS, **changes}, given, inputs)


@pytest.mark.slow
@pytest.mark.parametrize('factor', [1.3, 0.6, -1.0])
def test_the_factor_that_sensors_share_is_fitted(factor):
    case = Examination(recorded(factor, factor))
    (found,) = (each for each in common_scale.find(case) if each.kind != 'bias')
    assert found.subject == 'left and right'
    after = Examination(found.mended()).passage
    assert found.gain == pytest.approx(case.passage.misfit - after.misfit - found.dues, rel=0.05)
    scale = 1.0 / found.mended().sensors['left'].value[5] * case.evidence.sensors['left'].value[5]
    assert scale == pytest.approx(factor, rel=0.12)
    # no sensor explains as much without the other
    single = [each for each in units.find(case) if each.subject.startswith(('left', 'right'))]
    assert all(each.gain < 0.8 * found.gain for each in single)


@pytest.mark.slow
@pytest.mark.parametrize('factors', [(1.0, 1.0), (1.3, 1.0 / 1.3)])
def test_sensors_that_are_right_or_differ_share_no_factor(factors):
    assert list(common_scale.find(Examination(recorded(*factors)))) == []


@pytest.mark.slow
@pytest.mark.parametrize('offset', [0.2, -0.3])
def test_an_offset_that_sensors_share_is_a_bias_of_all(offset):
    case = Examination(recorded(1.0, 1.0, offset=offset))
    found = max(common_scale.find(case), key=lambda finding: finding.gain)
    assert (found.kind, found.subject) == ('bias', 'left and right')
    size = case.evidence.sensors['left'].value - found.mended().sensors['left'].value
    np.testing.assert_allclose(size, offset, atol=0.05)
    after = Examination(found.mended()).passage
    assert found.gain == pytest.approx(case.passage.misfit - after.misfit, rel=0.05)


@pytest.mark.slow
def test_sensors_of_another_type_are_of_another_kind():
    other = {'right.type': 'geometry_msgs/TwistStamped', 'right.fields': ['twist.linear.y']}
    assert list(common_scale.find(Examination(recorded(1.5, 1.5, **other)))) == []


@pytest.mark.slow
def test_its_size_is_fitted_again():
    case = Examination(recorded(1.5, 1.5))
    trials = Trials(case)
    (found,) = (each for each in common_scale.find(case) if each.kind != 'bias')
    trials.add_nearer(found, Examination(found.mended()))
    scale = trials.best.mended().sensors['left'].value[5] / case.evidence.sensors['left'].value[5]
    (first,) = found.mended().sensors['left'].value[5] / case.evidence.sensors['left'].value[5]
    assert scale != first and scale == pytest.approx(1.0 / 1.5, rel=0.05)
    assert trials.best.gain > trials.gain(found, Examination(found.mended()))


@pytest.mark.slow
def test_the_doctor_names_a_unit_that_sensors_share_first():
    first = diagnose(recorded(3.6, 3.6), proofs=False).findings[0]
    assert (first.kind, first.subject) == ('unit', 'left and right')
    assert 'km/h' in first.sentence and 'radius' not in first.sentence
    np.testing.assert_allclose(first.change['left.C'], [0.0, 3.6, 0.0, 0.0], atol=0.05)
    assert first.certainty > 0.7
