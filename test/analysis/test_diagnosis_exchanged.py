# SPDX-License-Identifier: Apache-2.0
"""Two sensors that are exchanged are named, whether or not the filter is lost by it."""

import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import exchanged, gross
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination


def swapped(evidence, one, other):
    first, second = evidence.sensors[one], evidence.sensors[other]
    return evidence.with_sensor(one, second).with_sensor(other, first)


@pytest.fixture(scope='module')
def bearings():
    return recorded('two_bearings', None, 20.0, 3)


@pytest.mark.slow
def test_two_bearings_are_exchanged(bearings):
    case = Examination(swapped(bearings, *bearings.sensors))
    assert gross.lost(case)
    (candidate,) = exchanged.candidates(case)
    for name in ('west', 'east'):
        assert candidate.mended().sensors[name] is bearings.sensors[name]
    finding = diagnose(case.evidence).findings[0]
    # either sensor alone has no contradiction, so that leaving one out fits as well
    assert ('swapped', 'west') in [(finding.kind, finding.subject), *finding.same_as]
    assert finding.certainty > 0.9


def test_sensors_in_their_places_gain_nothing(bearings):
    assert exchanged.find(Examination(bearings)) == []
    assert not diagnose(bearings).findings
