# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kalman_ros.core import Space, numerical_jacobian
from kalman_ros.core import rotations as so3

unit = st.floats(-1.0, 1.0)
#: Angles with those where formulas are delicate: 0, the limit of the series, pi.
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.2999999, 0.3, 0.3000001]),
    st.sampled_from([np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12, np.pi]),
)


@st.composite
def rotations(draw):
    axis = np.array([draw(unit) for _ in range(3)])
    length = np.linalg.norm(axis)
    axis = axis / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
    return draw(angles) * axis


def peer(r):
    return Rotation.from_rotvec(r)


def assert_same(a, b, atol=1e-14):
    """Hold two rotations equal, which at an angle of pi have two vectors."""
    np.testing.assert_allclose(peer(a).as_matrix(), peer(b).as_matrix(), atol=atol)


@given(rotations())
def test_the_matrix_is_that_of_scipy_and_back(r):
    R = so3.exp(r)
    np.testing.assert_allclose(R, peer(r).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert_same(so3.log(R), r)
    assert np.linalg.norm(so3.log(R)) <= np.pi + 1e-12


@given(rotations())
def test_small_and_large_angles_lose_no_digits_in_the_logarithm(r):
    angle = np.linalg.norm(r)
    found = so3.from_quaternion(so3.to_quaternion(r))
    assert np.linalg.norm(found) == pytest.approx(angle, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize('off', [0.0, 1e-16, 1e-12, 1e-9, 1e-7, 9e-7, 2e-6, 1e-3])
@pytest.mark.parametrize('up', [1.0, -1.0])
def test_roll_and_yaw_go_together_where_the_pitch_is_a_quarter_turn(off, up):
    rng = np.random.default_rng(3)
    given = rng.uniform(-3.0, 3.0, (200, 3))
    given[:, 1] = up * (np.pi / 2 - off)
    turns = Rotation.from_euler('xyz', given)
    found = so3.to_euler(turns.as_rotvec())
    error = (Rotation.from_euler('xyz', found).inv() * turns).magnitude()
    assert error.max() < 1e-7


@given(rotations(), rotations())
def test_the_product_is_that_of_scipy(a, b):
    assert_same(so3.compose(a, b), (peer(a) * peer(b)).as_rotvec())
    assert np.linalg.norm(so3.compose(a, b)) <= np.pi + 1e-12


@given(rotations(), st.tuples(unit, unit, unit))
def test_vectors_turn_there_and_back(r, v):
    turned = so3.rotate(r, np.array(v))
    np.testing.assert_allclose(turned, peer(r).apply(v), atol=1e-14)
    np.testing.assert_allclose(so3.rotate_back(r, turned), v, atol=1e-14)


@given(rotations())
def test_quaternions_and_angles_are_those_of_scipy(r):
    q = so3.to_quaternion(r)
    assert abs(q @ peer(r).as_quat()) == pytest.approx(1.0, abs=1e-14)
    assert_same(so3.from_quaternion(-3.0 * q), r)
    roll, pitch, yaw = so3.to_euler(r)
    assert_same(so3.from_euler(np.array([roll, pitch, yaw])), r, atol=1e-7)
    if abs(pitch) < 1.5:
        expected = peer(r).as_euler('xyz')
        difference = np.exp(1j * np.array([roll, pitch, yaw])) - np.exp(1j * expected)
        np.testing.assert_allclose(difference, 0.0, atol=1e-10)


@given(rotations())
def test_the_left_jacobian_is_the_numerical_one(r):
    found = numerical_jacobian(lambda d: so3.compose(r + d, -r), np.zeros(3))
    np.testing.assert_allclose(so3.left_jacobian(r), found, atol=1e-9)
    identity = so3.left_jacobian(r) @ so3.inverse_left_jacobian(r)
    np.testing.assert_allclose(identity, np.eye(3), atol=1e-13)
    rate = np.array([0.3, -0.2, 0.5])
    expected = np.linalg.solve(so3.left_jacobian(r), rate)
    np.testing.assert_allclose(so3.pulled_back(r, rate), expected, atol=1e-13)


def test_leading_axes_are_one_by_one():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 4, 5, 3))
    cases = {
        so3.skew: (a,), so3.exp: (a,), so3.left_jacobian: (a,), so3.inverse_left_jacobian: (a,),
        so3.compose: (a, b), so3.rotate: (a, b), so3.pulled_back: (a, b), so3.to_euler: (a,),
        so3.from_euler: (a,), so3.to_quaternion: (a,), so3.shortest: (3.0 * a,),
    }  # fmt: skip
    for function, arguments in cases.items():
        together = function(*arguments)
        alone = function(*(each[2, 3] for each in arguments))
        np.testing.assert_allclose(together[2, 3], alone, atol=1e-15, err_msg=str(function))
    R = so3.exp(a)
    np.testing.assert_allclose(so3.log(R)[2, 3], so3.log(R[2, 3]), atol=1e-15)


def test_a_vector_of_more_than_pi_is_the_same_rotation():
    r = np.array([[0.0, 0.0, 3.5], [4.0, -3.0, 9.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    found = so3.shortest(r)
    np.testing.assert_allclose(peer(found).as_matrix(), peer(r).as_matrix(), atol=1e-14)
    assert (np.linalg.norm(found, axis=-1) <= np.pi).all()
    np.testing.assert_array_equal(found[2:], r[2:])


def test_no_quaternion_is_no_rotation():
    assert np.isnan(so3.from_quaternion(np.zeros(4))).all()


POSE = Space('x psi rx ry rz v', angles=('psi',), rotations=('rx ry rz',))
poses = st.builds(
    lambda x, psi, r, v: np.array([x, psi, *r, v]),
    st.floats(-9.0, 9.0), st.floats(-3.0, 3.0), rotations(), st.floats(-9.0, 9.0),
)  # fmt: skip


@given(poses, poses)
def test_add_and_subtract_are_inverse(a, b):
    d = POSE.subtract(a, b)
    there = POSE.add(b, d)
    np.testing.assert_allclose(POSE.subtract(there, a), np.zeros(6), atol=1e-13)
    if np.linalg.norm(d[2:5]) < np.pi - 1e-6:
        np.testing.assert_allclose(POSE.subtract(there, b), d, atol=1e-9)


@given(rotations(), rotations())
def test_a_difference_is_in_the_axes_of_the_world(r, e):
    space = Space('rx ry rz', rotations=('rx ry rz',))
    assert_same(space.add(r, e), (peer(e) * peer(r)).as_rotvec())


@given(rotations(), st.integers(0, 2**32 - 1))
def test_the_mean_of_rotations_is_that_of_scipy_near_pi_too(r, seed):
    rng = np.random.default_rng(seed)
    space = Space('rx ry rz', rotations=('rx ry rz',))
    spread = 0.02 * rng.normal(size=(7, 3))
    spread -= spread.mean(axis=0)
    points = space.add(np.broadcast_to(r, spread.shape), spread)
    found = space.mean(points, np.full(7, 1.0 / 7.0))
    # scipy minimises chords and not angles, which differ by the third power of the spread
    assert_same(found, peer(points).mean().as_rotvec(), atol=1e-4)
    errors = space.subtract(points, found)
    np.testing.assert_allclose(errors.mean(axis=0), np.zeros(3), atol=1e-12)


def test_a_covariance_moves_with_its_mean():
    """Samples of an error about one rotation, seen from their own mean, scatter by J P J'."""
    space = Space('rx ry rz', rotations=('rx ry rz',))
    rng = np.random.default_rng(3)
    d, P = np.array([0.4, -1.1, 1.2]), np.diag([4e-4, 1e-4, 2e-4])
    origin = np.array([0.2, 2.0, -1.0])
    points = space.add(np.broadcast_to(origin, (40_000, 3)), rng.multivariate_normal(d, P, 40_000))
    mean, Q = space.arrived(origin + d, origin, P)
    np.testing.assert_allclose(np.cov(space.subtract(points, mean).T), Q, atol=5e-6)
    np.testing.assert_allclose(space.from_afar(Q, d), P, atol=1e-15)
    assert np.abs(Q - P).max() > 5e-5


def test_a_curve_jumps_where_the_numbers_of_a_rotation_do():
    """A turn about one axis for 10 rad, and an angle, pass pi twice and once."""
    turn = np.linspace(0.0, 10.0, 200)[:, np.newaxis] * np.array([0.6, 0.0, 0.8])
    curve = np.zeros((200, 6))
    curve[:, 2:5], curve[:, 1] = so3.shortest(turn), np.linspace(3.0, 3.2, 200)
    found = POSE.jumps(POSE.wrap(curve))
    np.testing.assert_array_equal(found.sum(axis=0), [0, 1, 2, 2, 2, 0])
    assert not Space(('x',)).jumps(np.array([[0.0], [9.0]])).any()


@pytest.mark.parametrize(
    'rotation', ['rx rz ry', 'rx ry', 'ry rz v', 'rx ry rz v', 'x y z', '', 'v rx ry']
)
def test_a_rotation_is_three_neighbours(rotation):
    with pytest.raises(ValueError, match='rotations: expected'):
        Space('v rx ry rz psi', angles=('psi',), rotations=(rotation, 'ry rz psi'))


def test_a_rotation_is_selected_whole():
    assert POSE.select(('v', 'rx', 'ry', 'rz')).rotations == (('rx', 'ry', 'rz'),)
    assert POSE.select(('v', 'x')).rotations == ()
    assert POSE.tangent.rotations == ()
    assert POSE.tangent.angles == ('psi',)
    for part in (('rx',), ('rz', 'ry', 'rx'), ('rx', 'v', 'ry', 'rz')):
        with pytest.raises(ValueError, match='names: expected a rotation as a whole'):
            POSE.select(part)
