# SPDX-License-Identifier: Apache-2.0
"""Stamps that are wrong at random: errors as large as what is read moves meanwhile."""

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import uneven_stamps
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination


def evidence_of(std, noise=1.0):
    """Return a spring that is read ``std`` s beside its stamps, or with more noise."""
    evidence = recorded('mass_spring_damper', None, 40.0, 4)
    record, beliefs = evidence.sensors['position'], evidence.beliefs
    rng = np.random.default_rng(7)
    velocity = np.interp(record.stamp, beliefs.time, beliefs.mean[:, 1])
    value = record.value.copy()
    value[:, 0] += velocity * std * rng.normal(size=len(value))
    scatter = np.sqrt(record.covariance[:, 0, 0] * max(noise**2 - 1.0, 0.0))
    value[:, 0] += scatter * rng.normal(size=len(value))
    return evidence.with_values('position', value)


@pytest.mark.slow
@pytest.mark.parametrize('std', [0.15, 0.3])
def test_they_are_found_with_their_spread(std):
    case = Examination(evidence_of(std))
    findings = {finding.subject: finding for finding in uneven_stamps.find(case)}
    finding = findings['position']
    size = float(finding.sentence.partition('wrong by ')[2].split()[0])
    assert size == pytest.approx(std, rel=0.25)
    (curve,) = finding.figure.curves  # errors grow with the rate
    fast = np.abs(curve.x) > np.median(np.abs(curve.x))
    of_fast, of_slow = (float(np.median(np.abs(curve.y[rows]))) for rows in (fast, ~fast))
    assert of_fast > 1.1 * of_slow
    after = Examination(finding.mended())
    assert case.passage.misfit - after.passage.misfit > 0.7 * finding.gain > 30.0


@pytest.mark.slow
def test_right_stamps_are_not_found():
    assert not list(uneven_stamps.find(Examination(evidence_of(0.0))))


@pytest.mark.slow
def test_a_smooth_error_of_time_is_not_found():
    evidence = evidence_of(0.0)
    record, beliefs = evidence.sensors['position'], evidence.beliefs
    velocity = np.interp(record.stamp, beliefs.time, beliefs.mean[:, 1])
    late = 0.3 * np.sin(6.0 * record.stamp)
    value = record.value + (velocity * late)[:, None]
    case = Examination(evidence.with_values('position', value))
    assert 'position' not in {finding.subject for finding in uneven_stamps.find(case)}


@pytest.mark.parametrize(('shape', 'least', 'most'), [('random', -0.1, 0.1), ('slow', 0.5, 1.0)])
def test_times_that_are_alike_have_another_cause(shape, least, most):
    """A constant delay beside them does not make them alike."""
    rng, N, tau = np.random.default_rng(2), 2000, 0.1
    rate = 30.0 * np.cos(0.05 * np.arange(N))
    late = tau * rng.normal(size=N)
    if shape == 'slow':
        late = tau * np.sqrt(2.0) * np.sin(0.02 * np.arange(N))
    innovation = rate * (0.2 + late) + rng.normal(size=N)
    assert least < uneven_stamps._likeness(rate * innovation, rate**2, tau) < most


@pytest.mark.slow
def test_they_come_before_noise_and_noise_before_them(monkeypatch):
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    kinds = [
        diagnose(evidence_of(*fault), proofs=False).findings[0].kind
        for fault in ((0.2,), (0.0, 2.0))
    ]
    assert kinds == ['stamps uneven', 'noise too small']
