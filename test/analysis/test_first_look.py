"""The part of a long recording that the doctor looks at first."""

from dataclasses import replace

import numpy as np
import pytest
from tools.strangers.injected.recordings import Injection, recorded

from kalman_ros.analysis.diagnosis import first_look
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.first_look import READINGS, begins
from kalman_ros.analysis.records import Beliefs

OFF = {'joint_states': {'random_walk': [0.0, 0.1], 'fault_window': [30.0, 1e9]}}


@pytest.fixture(scope='module')
def late():
    """A minute of a cart-pole whose encoder of the pole wanders from 30 s on."""
    return recorded('cart_pole', Injection(OFF), 60.0, 1)


def test_the_excess_begins_where_it_grows_and_not_where_it_was_noise():
    rng = np.random.default_rng(0)
    excess = rng.chisquare(2, 4000) - 3.0
    assert begins(excess) is None
    excess[2500:] += 4.0
    assert begins(excess) == pytest.approx(2500, abs=10)


@pytest.mark.parametrize(('count', 'beginning'), [(41, 100), (39, None)])
def test_the_excess_has_to_reach_what_chance_does_not(count, beginning):
    assert begins(np.concatenate((np.full(100, -1.0), np.full(count, 1.5)))) == beginning


def test_a_single_outlier_is_no_beginning():
    excess = np.full(100, -0.5)
    excess[50] = 17.0
    assert begins(excess) is None


@pytest.mark.slow
def test_the_part_begins_with_the_fault_and_shows_it(late):
    part, begin, end = first_look.part(late)
    assert begin == pytest.approx(30.0, abs=2.0)
    assert end > begin + 3.0
    assert sum(map(len, part.sensors.values())) == pytest.approx(READINGS, abs=2)
    # the force that acts at the beginning was commanded before
    assert part.inputs.received[0] < begin + late.start <= part.inputs.received[1]
    found = diagnose(part, proofs=False).findings
    assert (found[0].kind, found[0].subject) == ('random walk', 'joint_states')
    assert not any(np.isfinite(finding.proof) for finding in found)


def test_the_part_starts_at_the_belief_of_the_replay(late):
    part, begin, _ = first_look.part(late)
    before = np.searchsorted(late.beliefs.time, begin + late.start) - 1
    np.testing.assert_array_equal(part.scenario.initial_belief.mean, late.beliefs.mean[before])


def test_what_agrees_is_looked_at_from_its_beginning(late):
    calm = {
        name: replace(record, nis=np.minimum(record.nis, 1.0))
        for name, record in late.sensors.items()
    }
    part, begin, _ = first_look.part(replace(late, sensors=calm))
    assert begin == 0.0
    assert part.scenario is late.scenario


def test_without_beliefs_it_begins_with_the_recording(late):
    unknown = Beliefs(np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4, 4)))
    assert first_look.part(replace(late, beliefs=unknown))[1] == 0.0


def test_a_short_recording_has_no_part(late):
    assert first_look.part(late.between(late.start, late.start + 10.0)) is None
