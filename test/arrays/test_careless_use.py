# SPDX-License-Identifier: Apache-2.0
"""What is easily left out is right without it, or refused: no number is wrong without a word."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kalman_ros as kr


class Turning(kr.Model):
    state = kr.Space('rx ry rz', rotations=('rx ry rz',))
    input = kr.Space('wx wy wz')
    max_step = 0.01

    def derivative(self, x, u):
        return np.broadcast_to(u, x.shape).copy()

    def noise_density(self, x):
        return 0.01 * np.eye(3)


class Attitude(kr.Sensor):
    output = kr.Space('a b c', rotations=('a b c',))
    covariance = 1e-4 * np.eye(3)

    def measure(self, x):
        return x


@pytest.mark.parametrize('kind', ['ExtendedKalmanFilter', 'UnscentedKalmanFilter'])
def test_a_sensor_of_a_rotation_needs_no_space_of_its_state(kind):
    at = np.array([0.3, -2.0, 1.5])
    turned = Rotation.from_rotvec([0.01, 0.0, 0.0]) * Rotation.from_rotvec(at)
    found = getattr(kr, kind)(Turning()).correct((at, 1e-4), turned.as_rotvec(), Attitude())
    half = Rotation.from_rotvec(found.posterior.mean) * Rotation.from_rotvec(at).inv()
    np.testing.assert_allclose(half.as_rotvec(), [0.005, 0.0, 0.0], atol=1e-6)
    assert found.nis == pytest.approx(0.5, rel=1e-4)


def test_a_sensor_that_is_a_function_has_the_slope_of_errors_of_a_rotation():
    sensor = kr.sensor(lambda x: Rotation.from_rotvec(x.copy()).apply([0.0, 0.0, 1.0]), [1e-4] * 3)
    sensor = sensor.of(Turning.state)
    at = np.array([0.3, -2.0, 1.5])
    # an error d about the axes of the world moves a vector v by d x v
    x, y, z = sensor.measure(at)
    expected = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    np.testing.assert_allclose(sensor.jacobian(at), expected, atol=1e-6)
    assert sensor.of(Turning.state) is sensor


def test_a_matrix_that_reads_an_angle_reads_an_angle():
    model = kr.continuous_model(
        [[0, 1], [0, 0]], W=[0, 0.01], states='th [rad] w [rad/s]', angles=['th']
    )
    times = 0.1 * np.arange(200)
    truth = 3.0 + 0.2 * times
    readings = (truth + np.pi) % (2.0 * np.pi) - np.pi
    found = kr.filter(model, ([1, 0], 4e-4), times, readings, initial=([3.0, 0.2], 0.01))
    assert np.nanmax(found.nis) < 1.0 and found.last.mean[1] == pytest.approx(0.2, abs=1e-3)
    step = kr.KalmanFilter(model).correct(([3.1, 0.2], 0.01), -3.1, kr.sensor([1, 0], 4e-4))
    assert step.innovation[0] == pytest.approx(2.0 * np.pi - 6.2)
    # of a sum of angles nothing is known
    assert not kr.sensor([1, 1], 4e-4).of(model.state).output.angles


def test_what_is_masked_is_unknown():
    model = kr.discrete_model([[1, 0.1], [0, 1]], Q=[1e-3, 1e-2], period=0.1)
    given = (model, ([1, 0], 0.04))
    masked = np.ma.array([1.0, 1e6, 1.0], mask=[0, 1, 0])
    found = kr.filter(*given, readings=masked, initial=([0, 0], 1))
    gap = kr.filter(*given, readings=[1.0, np.nan, 1.0], initial=([0, 0], 1))
    np.testing.assert_array_equal(found.mean, gap.mean)
    whole = kr.filter(*given, readings=np.ma.array([1, 2, 1]), initial=([0, 0], 1))
    assert whole.counts['y']['fused'] == 3


def test_a_filter_that_began_again_says_so():
    model = kr.continuous_model(lambda x: [x[0] ** 2], 1e-4, states=1)  # escapes at 0.67 s
    with np.errstate(all='ignore'):
        found = kr.filter(model, ([1.0], 0.01), [0, 1.0], [1.5, 1.5], initial=([1.5], 0.01))
    assert found.restarts == 1 and 'began again from the start: 1' in repr(found)
    assert 'began' not in repr(kr.filter(model, ([1.0], 0.01), [0.0], [0.1], initial=([0.1], 1.0)))


@pytest.mark.parametrize(
    ('change', 'rest'),
    [
        (lambda x: [2.0 - 0.5 * x[0] ** 2], [2.0]),
        (lambda x: [x[0] ** 2 - 1.0], [1.0]),
        (lambda x: [np.cos(x[0]) + 2.0], None),
        (lambda x: [1.0 - x[0] ** 2 - x[1] ** 2, x[0] * x[1]], [0.0, 1.0]),
    ],
)
def test_where_a_derivative_vanishes_is_no_rest(change, rest):
    model = kr.continuous_model(change, 1.0, states=len(change([0.3, 0.4])))
    with pytest.raises(ValueError, match='does not rest'):
        kr.linearize(model)
    if rest is None:
        with pytest.raises(ValueError, match='finds no rest'):
            kr.trim(model)
        return
    found = kr.trim(model).state
    np.testing.assert_allclose(np.sort(np.abs(found)), rest, atol=1e-9)
    start = np.zeros(len(rest))
    with pytest.raises(ValueError, match='equilibrium: '):
        kr.continuous_model(change, 1.0, states=len(rest), equilibrium=start)


def test_a_car_rests_at_a_speed():
    car = kr.continuous_model(lambda x, u: [x[1], u[0]], [0, 1], states='p v', inputs='a')
    moving = kr.OperatingPoint([0.0, 3.0], [0.0])
    assert (
        kr.continuous_model(
            lambda x, u: [x[1], u[0]], [0, 1], states='p v', inputs='a', equilibrium=moving
        ).equilibrium.state[1]
        == 3.0
    )
    assert not kr.trim(car).state.any()


@pytest.mark.parametrize('rate', [2.0, 5.0, 20.0])
def test_a_loop_has_the_period_of_its_model(rate):
    model = kr.discrete_model([[1, 0.1], [0, 1]], [0.005, 0.1], [1e-5, 1e-3], period=0.1)
    with pytest.raises(ValueError, match=f'rate: expected 10, .* got {rate:g}'):
        kr.make_scenario(model, ([1, 0], 1e-4), rate=rate)
    assert kr.make_scenario(model, ([1, 0], 1e-4), rate=10.0).rate == 10.0


def test_a_reference_in_time_begins_at_zero_in_a_loop_of_ones_own():
    asked = []

    def reference(t):
        asked.append(t)
        return {'x': float(t >= 0.45)}

    regulator = kr.Regulator('mass_spring_damper_2d', reference=reference)
    asked.clear()
    for _ in range(3):
        regulator.step(np.zeros(4))
    np.testing.assert_allclose(sorted(set(asked))[:3], regulator.dt * np.arange(3), atol=1e-9)


@pytest.mark.parametrize('rate', [-300.0, -1e4])
def test_a_fast_mode_shortens_the_steps_of_a_function(rate):
    model = kr.continuous_model(lambda x: [rate * x[0]], 1.0, states=1)
    assert model.max_step == pytest.approx(1.0 / abs(rate), rel=1e-3)
    after = kr.ExtendedKalmanFilter(model).predict(([1.0], 0.1), dt=0.1)
    assert abs(after.mean[0]) < 1e-6
    slow = kr.continuous_model(lambda x: [-x[0]], 1.0, states=1)
    assert slow.max_step == 0.01
    given = kr.continuous_model(lambda x: [rate * x[0]], 1.0, states=1, max_step=0.01)
    assert given.max_step == 0.01


def test_a_truth_that_is_not_known_is_left_out():
    model = kr.discrete_model([[1, 0.1], [0, 1]], Q=[1e-3, 1e-2], period=0.1)
    found = kr.filter(model, ([1, 0], 0.04), readings=np.zeros(40), initial=([0, 0], 1))
    truth = np.zeros((40, 2))
    truth[::3] = np.nan
    assert np.isfinite(kr.consistency(found, truth).checks[0].mean)
    with pytest.raises(ValueError, match='truth: expected a time at which'):
        kr.consistency(found, truth + np.nan)


def test_a_path_beside_the_positions_of_a_model_is_refused():
    with pytest.raises(
        ValueError, match='path: expected points that differ in x alone, .* y, too'
    ):
        kr.motion('cart_pole', path=[[0, 0], [1, 5]])


def test_a_direct_path_is_a_number():
    assert repr(kr.margins(-1, 1, 1, 0.5)) == repr(kr.margins(-1, 1, 1, [[0.5]]))
