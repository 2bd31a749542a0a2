# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.core import DesignError, LinearSystem, Space
from kalman_ros.linear.discretize import zero_order_hold
from kalman_ros.linear.placement import place, place_observer, sampled_place

A = np.array([[0.0, 1.0], [0.0, 0.0]])
B = np.array([[0.0], [1.0]])


def near(found, wanted, tolerance=1e-6):
    found, wanted = np.sort_complex(found), np.sort_complex(np.array(wanted, dtype=complex))
    np.testing.assert_allclose(found, wanted, rtol=tolerance, atol=tolerance)


def system(A, B):
    n, m = np.shape(B)
    state = Space(tuple(f'x{index}' for index in range(n)), ('',) * n)
    return LinearSystem(
        A, B, np.zeros((n, n)), state, Space(tuple(f'u{index}' for index in range(m)), ('',) * m)
    )


def test_the_double_integrator_by_hand():
    # s^2 + k2 s + k1
    np.testing.assert_allclose(place(A, B, [-1.0, -3.0]).gain, [[3.0, 4.0]], rtol=1e-12)
    np.testing.assert_allclose(place(A, B, [-1 + 2j, -1 - 2j]).gain, [[5.0, 2.0]], rtol=1e-12)


@pytest.mark.parametrize('inputs', [1, 2, 4])
@pytest.mark.parametrize('seed', range(5))
def test_placed_poles_are_the_eigenvalues(seed, inputs):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, inputs))
    poles = [-1.0, -2.5, -2 + 1j, -2 - 1j]
    design = place(A, B, poles)
    assert design.gain.shape == (inputs, 4)
    near(np.linalg.eigvals(A - B @ design.gain), poles)
    near(design.poles, poles)


@pytest.mark.parametrize('seed', range(5))
def test_an_observer_is_the_dual(seed):
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    design = place_observer(A, C, [-4.0, -5.0, -6.0])
    near(np.linalg.eigvals(A - design.gain @ C), [-4.0, -5.0, -6.0])


def test_sampled_poles_go_where_the_exponential_takes_them():
    plant, dt = system(A, B), 0.1
    poles = [-2 + 3j, -2 - 3j]
    design = sampled_place(plant.A, plant.B, poles, dt)
    step = plant.sampled(dt)
    near(np.linalg.eigvals(step.F - step.G @ design.gain), np.exp(np.array(poles) * dt))
    fast = sampled_place(plant.A, plant.B, poles, 1e-5)
    np.testing.assert_allclose(fast.gain, place(A, B, poles).gain, rtol=1e-3)


def test_equal_poles_are_placed_by_fewer_inputs_as_by_ackermann():
    near(place(A, np.eye(2), [-1.0, -1.0]).poles, [-1.0, -1.0])
    controllable = np.hstack((B, A @ B))
    square = (A + np.eye(2)) @ (A + np.eye(2))
    expected = np.linalg.solve(controllable.T, [0.0, 1.0]) @ square  # e_n' C^-1 phi(A)
    np.testing.assert_allclose(place(A, B, [-1.0, -1.0]).gain[0], expected, rtol=1e-9)
    twice = np.hstack((B, 2.0 * B))  # two inputs that do the same
    near(place(A, twice, [-1.0, -2.0]).poles, [-1.0, -2.0])
    closed = A - twice @ place(A, twice, [-1.0, -1.0]).gain
    np.testing.assert_allclose(np.poly(closed), [1.0, 2.0, 1.0], rtol=1e-7)


def test_chains_of_poles_of_random_systems():
    random = np.random.default_rng(1)
    for _ in range(60):
        n = int(random.integers(2, 7))
        m = int(random.integers(1, min(3, n) + 1))
        A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
        count = int(random.integers(2, n + 1))
        pair = [complex(-2.0, 1.0), complex(-2.0, -1.0)] if n - count >= 2 else []
        poles = [-1.0] * count + pair + [-3.0 - k for k in range(n - count - len(pair))]
        found = np.poly(A - B @ place(A, B, poles).gain)
        wanted = np.poly(np.array(poles)).real
        assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.parametrize(
    'poles',
    [
        [-0.3, -0.1 * 3, -1.0],  # these differ by rounding
        [-0.3, -0.1 * 3, -0.1 * 3],
        [-1.0, -1.0 - 1e-9, -1.0 - 2e-9],
        [-1.0, -1.0 - 1e-5, -1.0 - 2e-5],
        [-2.0, complex(-1.0, 1e-9), complex(-1.0, -1e-9)],
    ],
)
def test_nearly_equal_poles_are_all_there(poles):
    chain, last = np.eye(3, k=1), np.eye(3)[:, 2:]
    found = np.poly(chain - last @ place(chain, last, poles).gain)
    np.testing.assert_allclose(found, np.poly(np.array(poles)).real, rtol=1e-5)
    dual = place_observer(chain, np.eye(3)[:1], poles).gain
    np.testing.assert_allclose(np.poly(chain - dual @ np.eye(3)[:1]), found, rtol=1e-5)


def test_repeated_pairs_and_dead_beat():
    chain, last = np.eye(4, k=1), np.eye(4)[:, 3:]
    pairs = [complex(-1.0, 1.0), complex(-1.0, -1.0)] * 2
    np.testing.assert_allclose(place(chain, last, pairs).gain, [[4.0, 8.0, 8.0, 4.0]], rtol=1e-9)
    step, force = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    closed = step - force @ place(step, force, [0.0, 0.0]).gain
    np.testing.assert_allclose(closed @ closed, np.zeros((2, 2)), atol=1e-12)
    with pytest.raises(DesignError, match='no input moves'):
        place(np.eye(2), np.eye(2)[:, :1], [-1.0, -1.0])


@pytest.mark.parametrize(
    ('poles', 'says'),
    [
        ([-1.0], 'expected 2 finite numbers'),
        ([-1.0, np.nan], 'expected 2 finite numbers'),
        ([-1 + 1j, -1 + 1j], 'with its conjugate'),
    ],
)
def test_poles_that_cannot_be_meant(poles, says):
    with pytest.raises(ValueError, match=says):
        place(A, B, poles)


def test_what_cannot_be_placed_says_why():
    with pytest.raises(DesignError, match='no input moves the modes at -3'):
        place(np.diag([1.0, -3.0]), B[::-1], [-1.0, -2.0])
    with pytest.raises(DesignError, match='no reading sees the modes at -3'):
        place_observer(np.diag([1.0, -3.0]), B[::-1].T, [-1.0, -2.0])


@pytest.mark.parametrize('seed', range(20))
def test_units_of_states_inputs_and_time_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    poles = -rng.uniform(0.5, 3.0, n)
    rate, force, t = 10.0 ** rng.uniform(-9, 9), 10.0 ** rng.uniform(-8, 8), rng.uniform(-8, 8, n)
    t = 10.0**t
    scaled = rate * A * t[:, np.newaxis] / t, rate * force * B * t[:, np.newaxis]
    found = place(*scaled, (rate * poles).tolist())
    closed = np.sort(np.linalg.eigvals(A - B @ (found.gain * t * force)).real)
    np.testing.assert_allclose(closed, np.sort(poles), rtol=1e-4)


def test_an_input_that_moves_nothing_is_named_in_any_units():
    A, B = np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]])
    for size in (1e-12, 1.0, 1e12):
        with pytest.raises(DesignError, match='poles: no input moves the modes at -2'):
            place(A, size * B, [-3.0, -4.0])


def chain(count, order):
    """Return integrators one behind the other, with the states in any order."""
    A, B = np.diag(np.ones(count - 1), 1), np.zeros((count, 1))
    B[-1] = 1.0
    return A[np.ix_(order, order)], B[order]


@pytest.mark.parametrize('turned', ['forwards', 'backwards', 'shuffled'])
def test_twelve_integrators_have_the_coefficients_of_their_polynomial(turned):
    order = np.arange(12)
    if turned == 'backwards':
        order = order[::-1]
    if turned == 'shuffled':
        order = np.random.default_rng(1).permutation(12)
    wanted = -np.arange(1.0, 13.0)
    gain = place(*chain(12, order), wanted.tolist()).gain[0]
    expected = np.array([float(c) for c in np.poly(wanted)[:0:-1]])
    np.testing.assert_allclose(gain, expected[order], rtol=1e-14)


def test_twelve_sampled_integrators_are_placed():
    A, B = chain(12, np.arange(12))
    wanted = -np.arange(1.0, 13.0)
    design = sampled_place(A, B, wanted.tolist(), 0.1)
    F, G = zero_order_hold(A, B, 0.1)
    found = np.sort(np.linalg.eigvals(F - G @ design.gain).real)
    np.testing.assert_allclose(found, np.sort(np.exp(0.1 * wanted)), atol=1e-5)


@pytest.mark.parametrize('dt', [1e-6, 1e-9, 1e-12, 1e-300])
def test_a_short_step_has_nearly_the_gain_of_none(dt):
    A, B = np.array([[-1.0, 0.3], [0.0, -2.0]]), np.array([[0.0], [1.0]])
    expected = place(A, B, [-3.0, -4.0]).gain
    np.testing.assert_allclose(sampled_place(A, B, [-3.0, -4.0], dt).gain, expected, rtol=1e-5)


@pytest.mark.parametrize('periods', [0.5, 1.5])
def test_samples_of_half_a_period_hide_an_oscillation(periods):
    oscillator = np.array([[0.0, 1.0], [-4.0, 0.0]]), np.array([[0.0], [1.0]])
    dt = periods * np.pi  # a period is pi
    with pytest.raises(DesignError, match=r'^poles: in samples of \S+ s no input moves the modes'):
        sampled_place(*oscillator, [-1.0, -2.0], dt)


def test_a_sampled_mode_out_of_reach_is_named_as_it_is():
    A, B = np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]])
    with pytest.raises(DesignError, match=r'^poles: no input moves the modes at -2$'):
        sampled_place(A, B, [-3.0, -4.0], 0.1)


def test_a_pole_that_no_sample_has_is_refused():
    with pytest.raises(DesignError, match=r'^poles: samples of 1 s have none at'):
        sampled_place(A, B, [-1.0, 800.0], 1.0)
