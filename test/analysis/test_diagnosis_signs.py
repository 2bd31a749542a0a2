# SPDX-License-Identifier: Apache-2.0
"""A wrong sign that the other sensors hold in check is found by passes of the filter."""

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import gross
from kalman_ros.analysis.diagnosis.examination import Examination

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def car():
    return recorded('gnss_imu', None, 20.0, 3)


def braked(evidence):
    """Return a recording in which the accelerometer has the wrong sign."""
    value = evidence.sensors['imu'].value.copy()
    value[:, 0] *= -1.0
    return Examination(evidence.with_values('imu', value))


def test_a_sign_is_found_though_the_filter_is_not_lost(car, monkeypatch):
    case = braked(car)
    assert not gross.lost(case)
    first = gross.find(case)[0]
    assert (first.kind, first.subject) == ('sign', 'imu.acceleration')
    after = Examination(first.mended()).passage
    assert after.misfit == pytest.approx(Examination(car).passage.misfit, rel=1e-9)
    assert first.gain == pytest.approx(case.passage.misfit - after.misfit, rel=0.05)
    monkeypatch.setattr(gross, '_PART', 600)  # of the start, at which it is slow
    part = gross.find(case)[0]
    assert part.subject == first.subject
    assert 0.02 < part.gain / first.gain < 3.0


def test_a_filter_that_is_right_is_not_suspected(car, monkeypatch):
    assert gross.find(Examination(car)) == []
    monkeypatch.setattr(gross, '_SUSPECT', np.inf)
    assert gross.find(braked(car)) == []


def test_two_coordinates_are_exchanged(car):
    value = car.sensors['gnss'].value[:, ::-1].copy()
    case = Examination(car.with_values('gnss', value))
    tried = [(found.kind, found.subject) for found in gross._signs(case)]
    assert ('swapped', 'gnss') in tried and ('sign', 'imu.yaw_rate') in tried
    assert not any(kind == 'swapped' and name == 'imu' for kind, name in tried)  # other units
