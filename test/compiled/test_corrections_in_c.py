# SPDX-License-Identifier: Apache-2.0
"""Corrections in C, of one belief and of many, are those of the textbook's products in numpy."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Definite, Dynamics, Gaussian
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
from kalman_ros.compiled import compiled
from kalman_ros.compiled import native_model as native
from kalman_ros.compiled.parts import parts

pytestmark = pytest.mark.slow  # the compiler is another process
#: With angles and rotations in readings and states, biases, and sensors that are a matrix.
SHIPPED = 'inertial', 'robot_3d', 'turn_rate', 'cart_pole'


@pytest.fixture(scope='module', autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('cache')))
        patch.delenv('KALMAN_ROS_ARITHMETIC', raising=False)
        yield


def believed(name, **changes):
    values = {**from_file(shipped.file(name), 'estimator'), **changes}
    return scenario.build(values, with_law=False).believed


def assert_same(mine, theirs, close=1e-12):
    scale = max(1.0, np.abs(theirs).max(initial=0.0))
    np.testing.assert_allclose(mine, theirs, rtol=close, atol=close * scale)


def in_numpy(monkeypatch, *given):
    """Return a correction by the products of numpy, with what C reads of a sensor."""
    with monkeypatch.context() as patch:
        patch.setattr(native.NativeModel, 'corrected', Dynamics.corrected)
        return given[0].corrected(*given[1:])


def beliefs(model, count=10, seed=5):
    """Yield means and covariances, with rotations and angles of any size."""
    rng, n = np.random.default_rng(seed), model.state.size
    for _ in range(count):
        root = rng.standard_normal((n, n))
        yield model.equilibrium.state + 2.0 * rng.standard_normal(n), root @ root.T, rng


@pytest.mark.parametrize('name', SHIPPED)
def test_a_reading_corrects_a_belief_as_in_numpy(name, monkeypatch):
    whole = believed(name)
    fast = parts(whole.model, whole.sensors)
    assert isinstance(fast.model, native.NativeModel)
    for sensor in fast.sensors.values():
        for x, P, rng in beliefs(fast.model):
            # of a state far away, so that differences of angles and rotations wrap
            y = sensor.measure(x + rng.standard_normal(x.size))
            found = fast.model.corrected(x, P, y, sensor)
            expected = in_numpy(monkeypatch, fast.model, x, P, y, sensor)
            for mine, theirs in zip(found[:-2], expected[:-2]):
                assert_same(mine, theirs, 1e-9)  # S of three axes in tesla is nearly singular
            _, _, innovation, S, _, _, nis, definite = found
            assert expected[-2] is None
            assert (definite, expected[-1]) == (True, False)
            assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-9)


def test_the_noise_of_one_reading_and_a_covariance_by_columns_count(monkeypatch):
    whole = believed('robot_3d')
    fast = parts(whole.model, whole.sensors)
    x, P, _ = next(beliefs(fast.model))
    P = np.asfortranarray(P)
    for sensor in fast.sensors.values():
        y, R = sensor.measure(x) + 0.1, 3.0 * sensor.covariance
        noisier = sensor.with_covariance(R)
        expected = in_numpy(monkeypatch, fast.model, x, P, y, noisier)
        for mine, theirs in zip(fast.model.corrected(x, P, y, noisier)[:-2], expected[:-2]):
            assert_same(mine, theirs)
        given = y.copy(), x.copy(), P.copy(), R.copy()
        fast.model.corrected(x, P, y, noisier)
        for before, after in zip(given, (y, x, P, R)):
            np.testing.assert_array_equal(before, after)


def test_what_is_not_positive_definite_or_finite_fails_as_in_numpy():
    whole = believed('robot_3d')
    fast = parts(whole.model, whole.sensors)
    x, P, _ = next(beliefs(fast.model))
    for sensor in fast.sensors.values():
        y = sensor.measure(x)
        with pytest.raises(np.linalg.LinAlgError):
            fast.model.corrected(x, -1e3 * P, y, sensor)
        assert np.isnan(fast.model.corrected(x, P, np.full_like(y, np.nan), sensor)[0]).any()


@pytest.mark.parametrize('name', ['robot_3d', 'turn_rate'])
def test_what_rounding_may_make_indefinite_is_looked_at_by_numpy(name):
    whole = believed(name)
    fast = parts(whole.model, whole.sensors)
    sensor = next(iter(fast.sensors.values()))
    filter = ExtendedKalmanFilter(fast.model)
    x, P, _ = next(beliefs(fast.model))
    u = fast.model.equilibrium.input
    good = filter.predict(Gaussian(x, P), u, 0.01)
    assert isinstance(good, Definite)
    assert isinstance(filter.correct(good, sensor.measure(x), sensor).posterior, Definite)
    assert type(good._replace(mean=x)) is Gaussian
    flat = (
        np.outer(np.ones(len(x)), np.ones(len(x))) * 1e12
    )  # of rank 1, beside which Q is rounding
    assert type(filter.correct(Gaussian(x, flat), sensor.measure(x), sensor).posterior) is Gaussian
    for doubtful in (flat, 1e200 * P, np.full_like(P, np.nan)):
        with np.errstate(all='ignore'):
            try:
                belief = filter.predict(Gaussian(x, doubtful), u, 1e-6)
            except np.linalg.LinAlgError:
                continue
        assert type(belief) is Gaussian


def test_the_sizes_of_another_sensor_are_refused_as_in_numpy():
    whole = believed('cart_pole')
    fast = parts(whole.model, whole.sensors)
    (sensor,) = fast.sensors.values()
    x, P, _ = next(beliefs(fast.model))
    with pytest.raises(ValueError):
        fast.model.corrected(x, P, np.zeros(3), sensor)


@pytest.mark.parametrize('k', [1, 2, 3, 5])
def test_many_members_are_corrected_as_in_numpy(k):
    model, rng = believed('robot_3d').model, np.random.default_rng(6)
    fast, n, members = compiled(model), model.state.size, (4, 3)
    x = rng.standard_normal((*members, n))
    P = rng.standard_normal((*members, n, n))
    P = P @ P.swapaxes(-1, -2)
    H, nu = rng.standard_normal((*members, k, n)), rng.standard_normal((*members, k))
    R = np.diag(rng.uniform(0.1, 1.0, k))
    P[1, 2], H[2, 0] = -P[1, 2], 0.0
    for given in ((x, P, H, R, nu), (x, P[0, 0], H[0], R, nu), (x, P, H[0, 0], R, nu)):
        with np.errstate(invalid='ignore'):
            expected = model.corrected_moments(*given)
        found = fast.corrected_moments(*given)
        for mine, theirs in zip(found[:4], expected[:4], strict=True):
            # what is not positive definite is so in both
            assert_same(mine, np.broadcast_to(theirs, mine.shape))
        S, nis = found[3], found[4]
        good = np.isfinite(found[2]).all(axis=(-2, -1))
        exact = np.einsum('...i,...ij,...j->...', nu, np.linalg.inv(S), nu)
        np.testing.assert_allclose(nis[good], exact[good], rtol=1e-7)
        assert np.all(nis[~good] == np.inf)


def test_a_single_member_and_many_numbers_are_corrected_by_numpy():
    model, rng = compiled(believed('cart_pole').model), np.random.default_rng(7)
    x, P, most = rng.standard_normal(4), np.eye(4), native.MOST_READ + 1
    H, nu = rng.standard_normal((most, 4)), rng.standard_normal(most)
    one = model.corrected_moments(x, P, H, np.eye(most), nu)
    many = model.corrected_moments(np.stack((x, x)), P, H, np.eye(most), np.stack((nu, nu)))
    for alone, both in zip(one[:4], many[:4], strict=True):
        np.testing.assert_allclose(np.broadcast_to(both, (2, *alone.shape))[1], alone, rtol=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        model.corrected_moments(x, -P, H[:1], 1e-3 * np.eye(1), nu[:1])
