# SPDX-License-Identifier: Apache-2.0
"""A fit whose filters are called in C has the innovations of one that takes step after step."""

from dataclasses import replace

import numpy as np
import pytest
from tuned_cases import COVERED, Case, likelihood, recorded

from kalman_ros.analysis.tuning import walk
from kalman_ros.analysis.tuning.compiled_steps import CompiledSteps
from kalman_ros.analysis.tuning.free_parameter import STEP
from kalman_ros.compiled.parts import VARIABLE
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

pytestmark = pytest.mark.slow  # the compiler is another process

CART_POLE = replace(COVERED[1], seconds=3.0)
ROBOT = replace(
    COVERED[2], seconds=3.0, errors={}, fitted=['turn_noise', 'imu.noise', 'imu.bias'], starts={}
)
WITH_ROTATIONS = Case(
    'robot_3d', {**from_file(shipped.file('robot_3d'), 'estimator'), 'filter': 'ekf'}, {},
    ['imu.noise'], 2.0,
)  # fmt: skip


@pytest.fixture(autouse=True)
def with_casadi(monkeypatch, tmp_path_factory):
    pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.getbasetemp()))
    monkeypatch.setattr(walk, '_BLOCK', 70)


def plain(case, **policy):
    """Return the likelihood of a recording of a case without gates, with this policy."""
    found = likelihood(case, recorded(case, 3))
    return changed(found, **policy)


def changed(found, **policy):
    conditions = replace(
        found.conditions, policy=replace(found.conditions.policy, gates=None, **policy)
    )
    return replace(found, conditions=conditions)


def with_readings(found, sensor, **fields):
    readings = dict(found.observations.readings)
    readings[sensor] = replace(readings[sensor], **fields)
    return replace(found, observations=replace(found.observations, readings=readings))


def innovations(found):
    """Return what a walk of neighbours of the start yields, by sensor in order of time."""
    z = found.start
    about = [z, *(z + s * STEP * e for e in np.eye(len(z)) for s in (1.0, -1.0))]
    columns = {}
    for block in found.walk([found.candidate(point) for point in about]).blocks(found.until):
        assert block.accepted.all()
        columns.setdefault((block.sensor, block.output.names), []).append(
            (block.time, block.innovation, block.covariance)
        )
    return {key: [*map(np.concatenate, zip(*parts))] for key, parts in columns.items()}


def compare(found, monkeypatch, as_expected):
    """Assert that both ways agree, and which chunks were processed at once is as expected."""
    outcomes, original = [], CompiledSteps.__call__

    def watched(self, *arguments):
        outcomes.append(original(self, *arguments))
        return outcomes[-1]

    monkeypatch.setattr(CompiledSteps, '__call__', watched)
    at_once = innovations(found)
    done = [each is not None for each in outcomes]
    monkeypatch.setattr(CompiledSteps, '__call__', lambda *_: None)
    in_turn = innovations(found)
    assert at_once.keys() == in_turn.keys()
    for key, columns in in_turn.items():
        for one, other in zip(at_once[key], columns):
            assert one.shape == other.shape
            size = np.abs(other).max()
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9 * size, err_msg=key)
    assert as_expected(done), done


@pytest.mark.parametrize('case', [CART_POLE, ROBOT, WITH_ROTATIONS], ids=lambda case: case.name)
def test_innovations_and_their_covariances_are_the_same(case, monkeypatch):
    compare(plain(case), monkeypatch, lambda done: len(done) > 1 and all(done))


def test_a_reading_without_a_number_is_processed_in_turn(monkeypatch):
    found = plain(ROBOT)
    value = found.observations.readings['odometry'].value.copy()
    value[40, 0] = np.nan
    found = with_readings(found, 'odometry', value=value)
    compare(found, monkeypatch, lambda done: done.count(False) == 1 and done.count(True) > 1)


def test_covariances_of_messages_hold(monkeypatch):
    found = plain(ROBOT)
    readings = found.observations.readings['odometry']
    covariance = np.eye(2) * np.linspace(0.01, 0.04, len(readings.stamp))[:, None, None]
    found = with_readings(found, 'odometry', covariance=covariance)
    compare(found, monkeypatch, lambda done: len(done) > 1 and all(done))


def test_a_belief_begins_again_after_a_gap(monkeypatch):
    found = plain(CART_POLE, max_gap=1.0)
    stamp = found.observations.readings['joint_states'].stamp.copy()
    stamp[90:] += 2_000_000_000
    found = with_readings(found, 'joint_states', stamp=stamp)
    acts = found.observations.input_stamp
    late = acts + np.where(acts > 1_700_000_000, 2_000_000_000, 0)
    found = replace(found, observations=replace(found.observations, input_stamp=late))
    compare(found, monkeypatch, lambda done: len(done) >= 1)


@pytest.mark.parametrize(
    'policy', [{'from_reading': True}, {'from_rest': True}, {'rest_until_input': True}]
)
def test_a_start_by_readings_is_processed_in_turn(policy, monkeypatch):
    compare(plain(CART_POLE, **policy), monkeypatch, lambda done: len(done) >= 1 and all(done))


def test_the_first_input_tells_where_a_state_rests_however_late_it_comes(monkeypatch):
    found = plain(CART_POLE, from_rest=True)
    late = found.observations.input_stamp > 2_000_000_000
    stamp, value = found.observations.input_stamp[late], found.observations.input[late].copy()
    value[0] += 0.5
    found = replace(
        found, observations=replace(found.observations, input_stamp=stamp, input=value)
    )
    compare(found, monkeypatch, lambda done: len(done) >= 1 and all(done))


def test_readings_out_of_order_and_before_the_start(monkeypatch):
    found = plain(ROBOT)
    stamp = found.observations.readings['odometry'].stamp.copy()
    stamp[[10, 11, 30, 33]] = stamp[[11, 10, 33, 30]]
    found = with_readings(found, 'odometry', stamp=stamp)
    compare(found, monkeypatch, lambda done: all(done))


def test_gates_and_delays_need_step_after_step():
    gated = changed(plain(ROBOT))
    policy = replace(gated.conditions.policy, gates={'imu': 9.0})
    gated = replace(gated, conditions=replace(gated.conditions, policy=policy))
    assert gated.walk([gated.candidate(gated.start)])._compiled is None
    delayed = plain(replace(ROBOT, fitted=['imu.delay']))
    neighbours = [delayed.candidate(delayed.start + each) for each in (0.0, 0.1)]
    assert delayed.walk(neighbours)._compiled is None
