# SPDX-License-Identifier: Apache-2.0
"""A pass of a filter in C is the one that takes a step after the other."""

from dataclasses import fields, replace

import numpy as np
import pytest
from thorough import thorough
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis.filter_pass import passage, rejected
from kalman_ros.analysis.diagnosis.passage import Event
from kalman_ros.compiled.parts import VARIABLE
from kalman_ros.core import Dynamics

pytestmark = pytest.mark.slow  # the compiler is another process


@pytest.fixture(autouse=True)
def with_casadi(monkeypatch, tmp_path_factory):
    pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.getbasetemp()))


@pytest.fixture
def both(monkeypatch):
    """Return a function that calls another with passes in C, and with passes by steps."""
    from kalman_ros.compiled.native_model import NativeModel

    def call(function):
        outcomes, original = [], NativeModel.filter_pass

        def watched(*arguments):
            outcomes.append(original(*arguments))
            return outcomes[-1]

        monkeypatch.setattr(NativeModel, 'filter_pass', watched)
        in_c = function()
        monkeypatch.setattr(NativeModel, 'filter_pass', Dynamics.filter_pass)
        return in_c, function(), outcomes

    return call


def commanded(evidence):
    """Return the evidence with inputs that act between the readings, and at some."""
    m = evidence.scenario.model.input.size
    if not m or len(evidence.inputs.stamp):
        return evidence
    stamp = np.arange(0.0, 3.0, 0.15)
    value = np.sin(np.outer(1.0 + stamp, np.arange(1.0, m + 1.0)))
    return replace(
        evidence, inputs=replace(evidence.inputs, received=stamp, stamp=stamp, value=value)
    )


@pytest.mark.parametrize(
    'name',
    ['cart_pole', 'robot_3d', 'diff_drive', thorough('inertial'), thorough('lidar_radar'),
     thorough('turn_rate'), thorough('gnss_imu'), thorough('submersible')],
)  # fmt: skip
def test_the_matrices_of_each_step_are_the_same(name, both):
    evidence = commanded(recorded(name, seconds=3.0, seed=2))
    (in_c, steps, outcomes) = both(lambda: passage(evidence))
    assert [each is not None for each in outcomes] == [True]
    assert len(in_c.events) == len(steps.events) > 20
    for field in (each.name for each in fields(Event)):
        for one, other in zip(in_c.events, steps.events):
            found, expected = getattr(one, field), getattr(other, field)
            if isinstance(expected, str):
                assert found == expected
            else:
                size = max(1.0, float(np.abs(expected).max(initial=0.0)))
                np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * size)
    assert in_c.misfit == pytest.approx(steps.misfit, rel=1e-8)
    middle = float(steps.series('time')[len(steps.events) // 2])
    for one, other in ((in_c, steps), (in_c.until(middle), steps.until(middle))):
        assert len(one.events) == len(other.events) and one.names == other.names
        for sensor in other.names:
            for field in ('index', 'time', 'innovation', 'H', 'whitened', 'x'):
                expected = other.series(field, sensor)
                size = max(1.0, float(np.abs(expected).max(initial=0.0)))
                np.testing.assert_allclose(
                    one.series(field, sensor), expected, rtol=0.0, atol=1e-7 * size
                )
            for found, wanted in zip(one.terms(sensor), other.terms(sensor)):
                np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(one.corrections, other.corrections, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(one.square, other.square, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(one.sizes, other.sizes)
        for field in ('index', 'innovation', 'whitened'):  # of a sensor that is not there
            assert one.series(field, 'none').shape == other.series(field, 'none').shape == (0,)


def test_a_gate_rejects_the_same_readings(both):
    evidence = recorded('robot_3d', seconds=3.0, seed=2)
    value = evidence.sensors['odometry'].value.copy()
    value[20:60:7] += 5.0
    value[-1] += 5.0
    spoilt = evidence.with_values('odometry', value)
    in_c, steps, outcomes = both(lambda: rejected(spoilt, 'odometry', 60.0))
    assert outcomes[0] is not None
    assert in_c.tolist() == steps.tolist() == [*range(20, 60, 7), len(value) - 1]


def test_a_filter_that_fails_ends_where_it_does_by_steps(both):
    evidence = recorded('cart_pole', seconds=3.0, seed=2)
    name = next(iter(evidence.sensors))
    value = evidence.sensors[name].value.copy()
    value[100] = 1e200
    spoilt = evidence.with_values(name, value)
    with np.errstate(all='ignore'):
        in_c, steps, outcomes = both(lambda: passage(spoilt, strict=False))
    assert outcomes == [None]
    assert len(in_c.events) == len(steps.events) > 100


def test_what_was_rejected_until_a_filter_fails_is_known(both):
    evidence = recorded('cart_pole', seconds=3.0, seed=2)
    name = next(iter(evidence.sensors))
    value = evidence.sensors[name].value.copy()
    value[50:60] += 100.0
    spoilt = evidence.with_values(name, value)
    record = spoilt.sensors[name]
    covariance = record.covariance.copy()
    covariance[60] = 1e300  # usable, and the innovation covariance overflows
    spoilt = spoilt.with_sensor(name, replace(record, covariance=covariance))
    with np.errstate(all='ignore'):
        in_c, steps, _ = both(lambda: rejected(spoilt, name, 1e4))
    assert in_c.tolist() == steps.tolist()
    assert {*range(50, 60)} <= {*in_c.tolist()}


def test_rotations_that_are_not_compiled_are_processed_by_steps(both, monkeypatch):
    """As those of a model whose space is a property."""
    from kalman_ros.compiled import native_model as native

    evidence = recorded('robot_3d', seconds=1.0, seed=2)
    monkeypatch.setattr(native, 'native_space', lambda space, wait: space)
    in_c, steps, outcomes = both(lambda: passage(evidence).misfit)
    assert outcomes == [None]
    assert in_c == steps


def test_readings_that_are_too_long_for_c_are_processed_by_steps(both, monkeypatch):
    from kalman_ros.compiled import native_recursion as native

    monkeypatch.setattr(native, 'MOST_READ', 2)
    evidence = recorded('robot_3d', seconds=1.0, seed=2)
    in_c, steps, outcomes = both(lambda: passage(evidence))
    assert outcomes == [None]
    assert in_c.misfit == steps.misfit
