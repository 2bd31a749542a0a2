# SPDX-License-Identifier: Apache-2.0
"""What gravity and the field of the Earth show without a filter: mountings and units."""

from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import diagnose, gravity, norms
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.core import rotations
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file

ROLLED = np.pi / 3.0


def lying(force, name='imu', scenario='diff_drive', **changes):
    """Return the findings about an IMU that reads a force at the start."""
    parameters = {**from_file(shipped.file(scenario), 'estimator'), **changes}
    asked = []
    evidence = SimpleNamespace(
        scenario=build(parameters, with_law=False),
        forces={name: np.array(force)},
        rerun=lambda change: asked.append(change) or 'replayed',
        adopting=lambda change: build({**parameters, **change}, with_law=False),
    )
    found = list(gravity.find(SimpleNamespace(evidence=evidence)))
    for finding in found:
        assert finding.plain and finding.kind == 'rotated' and finding.subject == name
        if finding.change:
            assert finding.mended() == 'replayed' and asked == [finding.change]
    return found


@pytest.mark.parametrize('force', [(0.1, 9.8, 0.2), (-9.7, 0.3, 0.1), (5.0, -7.0, 5.0)])
def test_an_imu_on_its_side_is_turned_upright(force):
    (finding,) = lying(force)
    turn = rotations.exp(rotations.from_euler(np.array(finding.change['imu.mount.rotation'])))
    size = np.linalg.norm(force)
    np.testing.assert_allclose(turn @ force, [0.0, 0.0, size], atol=2e-3 * size)
    main = 'xyz'[int(np.argmax(np.abs(force)))]
    way = 'up' if max(force, key=abs) > 0.0 else 'down'
    assert f'Its {main} looks {way}' in finding.sentence
    assert not lying(force, **finding.change)  # as it is known to be mounted
    (finding,) = lying(force, **{'imu.mount.rotation': [0.0, 0.0, 1.0]})
    turn = rotations.exp(rotations.from_euler(np.array(finding.change['imu.mount.rotation'])))
    np.testing.assert_allclose(turn @ force, [0.0, 0.0, size], atol=2e-3 * size)


def test_plain_physics_comes_before_larger_gains():
    plain = Finding('rotated', 'imu', 'it lies.', np.inf, plain=True)
    large = Finding('noise too small', 'imu', 'it is noisy.', 9.0, gain=1e6)
    silent = Finding('no readings', 'gnss', 'none.', np.inf, silent=True)
    kinds = [each.kind for each in diagnose._rank([large, plain, silent])]
    assert kinds == ['no readings', 'rotated', 'noise too small']


def test_a_detector_without_an_inverse_takes_no_other_with_it():
    def failing(case):
        raise np.linalg.LinAlgError('Singular matrix')

    found = Finding('bias', 'gnss', 'it is off.', 9.0, gain=100.0)
    (kept,) = diagnose._promised(None, [failing, lambda case: [found]], 2.0)
    assert kept.kind == 'bias' and kept.gain == 98.0


@pytest.mark.parametrize(
    'force',
    [
        (0.0, 0.0, 9.8),
        9.8 * np.array([0.0, np.sin(0.55), np.cos(0.55)]),  # a slope
        (0.0, 4.9, 0.0),  # it is shaken, or has removed gravity
        (0.0, 0.0, 0.0),
        (0.0, 0.3, -9.8),  # upside down, or another sign: the gyroscope tells
    ],
)
def test_no_side_is_seen_where_none_is_sure(force):
    assert not lying(force)


@pytest.mark.parametrize('scenario', ['dc_motor', 'cart_pole'])
def test_an_instrument_on_a_pendulum_may_read_gravity_anywhere(scenario):
    assert not lying((0.0, 9.8, 0.0), name='input', scenario=scenario)


def test_fields_that_no_mounting_turns_have_no_lines_to_change(monkeypatch):
    real = gravity._turned

    def refusing(case, *args):
        def adopting(change):
            raise ValueError('mount.rotation: these fields have no axes')

        case.evidence.adopting = adopting
        return real(case, *args)

    monkeypatch.setattr(gravity, '_turned', refusing)
    (finding,) = lying((0.0, 9.8, 0.0))
    assert not finding.change and finding.mended is None


@pytest.mark.slow
def test_readings_that_are_no_numbers_have_no_size(flight):
    value = np.full_like(flight.sensors['magnetometer'].value, np.nan)
    assert not units_of(flight.with_values('magnetometer', value))


def test_a_robot_in_space_starts_as_it_believes():
    first = from_file(shipped.file('robot_3d'), 'estimator')['initial_estimate']
    rolled = [*first[:3], ROLLED, 0.0, 0.0, *first[6:]]
    leaning = {'scenario': 'robot_3d', 'initial_estimate': rolled}
    assert not lying(9.8 * np.array([0.0, np.sin(ROLLED), np.cos(ROLLED)]), **leaning)
    (finding,) = lying((0.0, 0.0, 9.8), **leaning)
    assert abs(finding.change['imu.mount.rotation'][0]) == pytest.approx(ROLLED, abs=2e-3)
    anywhere = [0.5] * 3 + [0.6] * 2 + [0.1] * 10
    assert not lying((0.0, 9.8, 0.0), scenario='robot_3d', initial_std=anywhere)


def units_of(evidence):
    return list(norms.find(SimpleNamespace(evidence=evidence)))


@pytest.fixture(scope='module')
def robot():
    return recorded('robot_3d', None, 3.0, 3)


@pytest.mark.slow
def test_gravity_shows_that_forces_are_in_g(robot):
    assert not units_of(robot)
    value = robot.sensors['imu'].value.copy()
    value[:, 3:] /= 9.80665
    (finding,) = units_of(robot.with_values('imu', value))
    assert finding.subject == 'imu.fx,fy,fz' and finding.plain and 'are in g.' in finding.sentence
    mended = finding.mended().sensors['imu'].value
    np.testing.assert_allclose(mended, robot.sensors['imu'].value, rtol=1e-9)
    value[:, 3:] *= 3.0  # no unit
    assert not units_of(robot.with_values('imu', value))


@pytest.fixture(scope='module')
def flight():
    """Return a recording with a magnetometer, and an IMU behind the input."""
    evidence = recorded('inertial', None, 3.0, 3)
    noise = np.random.default_rng(0).normal(size=evidence.inputs.value.shape)
    return evidence.with_inputs([0.0, 0.0, 0.0, 0.3, -0.2, 9.8] + 0.3 * noise)


@pytest.mark.parametrize(('factor', 'unit'), [(1e6, 'microtesla'), (1e4, 'gauss'), (1.5, None)])
def test_the_field_shows_the_unit_of_a_magnetometer(flight, factor, unit):
    value = flight.sensors['magnetometer'].value
    found = units_of(flight.with_values('magnetometer', factor * value))
    assert [f'are in {unit}.' in each.sentence for each in found] == ([True] if unit else [])
    for finding in found:
        assert finding.subject == 'magnetometer'
        after = finding.mended().sensors['magnetometer'].value
        np.testing.assert_allclose(after, value, rtol=1e-9)


def test_the_accelerometer_behind_an_input_is_in_g(flight):
    assert not units_of(flight)
    value = flight.inputs.value.copy()
    value[:, 3:] /= 9.80665
    (finding,) = units_of(flight.with_inputs(value))
    assert finding.kind == 'input gain' and 'it is in g' in finding.sentence
    np.testing.assert_allclose(finding.mended().inputs.value, flight.inputs.value, rtol=1e-9)
