# SPDX-License-Identifier: Apache-2.0
"""Margins: published ones to the digits, and those of random loops by their closed poles."""

import numpy as np
import pytest
from seeds import first_fast

from kalman_ros.control.compensator import compensator, current_compensator
from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.guarantee import sampled_guarantees
from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.control.lqr import cost, dlqr, lqr, sampled_cost
from kalman_ros.control.margins import loop_at_a_time, margins
from kalman_ros.control.state_space import state_space, static
from kalman_ros.core import DesignError, LinearSystem, Space, zero_order_hold
from kalman_ros.linear.placement import place


def closed(loop, factor):
    """Return how far the loop with L times ``factor`` is from stable: below 0 it is."""
    D = 1.0 + factor * loop.D[0, 0]
    poles = np.linalg.eigvals(loop.A - factor / D * loop.B @ loop.C)
    return np.abs(poles).max() - 1.0 if loop.sampled else poles.real.max()


def random_loop(seed, dt=None):
    """A random unstable plant with its LQG compensator, of random weights."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 4
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, 1)), rng.normal(size=(1, n))
    W, V = np.diag(rng.uniform(0.1, 2.0, n)), np.array([[rng.uniform(0.01, 1.0)]])
    weights = cost(rng.uniform(0.1, 2.0, n), rng.uniform(0.01, 1.0, 1), (n, 1))
    if dt is None:
        plant = state_space(A, B, C)
        return compensator(plant, lqr(A, B, weights).gain, lqe(A, C, W, V).gain) @ plant
    F, G = zero_order_hold(A, B, dt)
    plant = state_space(F, G, C, dt=dt)
    return (
        current_compensator(plant, static(dlqr(F, G, weights).gain, plant.dt), dlqe(F, C, W, V))
        @ plant
    )


LOOPS = first_fast([(seed, dt) for seed in range(12) for dt in (None, 0.1)], 8)


@pytest.mark.parametrize(('seed', 'dt'), LOOPS)
def test_gain_margins_are_where_stability_ends(seed, dt):
    loop = random_loop(seed, dt)
    found = margins(loop)
    low, high = found.lower_gain.value, found.upper_gain.value
    inside = np.linspace(max(low, 1e-3) * (1 + 1e-6), min(high, 1e3) * (1 - 1e-6), 300)
    assert all(closed(loop, k) < 0.0 for k in inside)
    assert low == 0.0 or closed(loop, low * (1 - 1e-6)) > 0.0
    assert high == np.inf or closed(loop, high * (1 + 1e-6)) > 0.0


@pytest.mark.parametrize(('seed', 'dt'), LOOPS)
def test_phase_margins_are_where_stability_ends(seed, dt):
    """A complex factor turns both halves of the axis: the nearer of lead and lag is the end."""
    loop = random_loop(seed, dt)
    found = margins(loop)
    least = min(found.lead.value, found.lag.value)
    for phase in np.linspace(-1.0, 1.0, 200) * min(least * (1 - 1e-6), np.pi):
        assert closed(loop, np.exp(1j * phase)) < 0.0
    assert least == np.inf or closed(loop, np.exp(1j * least * (1 + 1e-6))) > 0.0
    for turn, sign in ((found.lead, 1.0), (found.lag, -1.0)):
        if np.isfinite(turn.value):
            L = loop.response(turn.frequency)[0, 0, 0]
            np.testing.assert_allclose(L * np.exp(1j * sign * turn.value), -1.0, rtol=1e-7)


@pytest.mark.parametrize(('seed', 'dt'), LOOPS)
def test_the_disk_is_the_distance_on_a_fine_grid(seed, dt):
    loop = random_loop(seed, dt)
    found = margins(loop).disk
    w = np.concatenate(([0.0], np.logspace(-4, 4, 4000)))
    w = w if dt is None else np.append(w[w < np.pi / dt], np.pi / dt)
    L = loop.response(w)[:, 0, 0]
    on_grid = (2.0 * np.abs(1.0 + L) / np.abs(1.0 - L)).min()
    assert on_grid * (1 - 1e-3) < found.alpha < on_grid * (1 + 1e-7)
    if np.isfinite(found.frequency):
        L = loop.response(found.frequency)[0, 0, 0]
        np.testing.assert_allclose(2 * abs(1 + L) / abs(1 - L), found.alpha, rtol=1e-6)


@pytest.mark.parametrize(('seed', 'dt'), LOOPS)
def test_the_disk_is_within_the_margins_of_one_change(seed, dt):
    found = margins(random_loop(seed, dt))
    assert found.disk.upper_gain <= found.upper_gain.value * (1 + 1e-6)
    assert found.disk.lower_gain >= found.lower_gain.value * (1 - 1e-6)
    assert found.disk.phase <= min(found.lead.value, found.lag.value) * (1 + 1e-6)


@pytest.mark.parametrize('seed', first_fast(range(12), 4))
def test_a_delay_margin_is_where_stability_ends(seed):
    """With the delay as a Pade approximant, good to far beyond the frequencies of the loop."""
    loop = random_loop(seed)
    found = margins(loop).delay

    def delayed(tau):
        part = tau / 8  # (1 - s part / 2) / (1 + s part / 2), eight times
        one = state_space([[-2 / part]], [[1.0]], [[4 / part]], [[-1.0]])
        total = loop
        for _ in range(8):
            total = one @ total
        return total.closed().poles.real.max()

    if found.value == np.inf:
        assert np.abs(loop.response(np.logspace(-4, 4, 1000))).max() < 1.0
        return
    assert found.value * found.frequency < 8.0
    assert delayed(found.value * 0.98) < 0.0
    assert delayed(found.value * 1.02) > 0.0


def test_textbook_third_order():
    # MathWorks, documentation of margin and allmargin: 25 / (s^3 + 10 s^2 + 10 s + 10)
    loop = state_space([[-10, -10, -10], [1, 0, 0], [0, 1, 0]], [[1], [0], [0]], [[0, 0, 25]])
    found = margins(loop)
    np.testing.assert_allclose(found.upper_gain.value, 3.6, rtol=1e-9)
    np.testing.assert_allclose(found.upper_gain.frequency, 3.1623, atol=5e-5)
    np.testing.assert_allclose(np.degrees(found.lag.value), 29.1104, atol=5e-5)
    np.testing.assert_allclose(found.lag.frequency, 1.7844, atol=5e-5)
    np.testing.assert_allclose(found.delay.value, 0.2847, atol=5e-5)
    assert (found.lower_gain.value, found.lead.value) == (0.0, np.inf)
    text = 'gain 0 to 3.6, lead any, lag 29.1 deg, delay 0.285 s, disk 0.458, min|1 + L| 0.402'
    assert str(found) == text


def test_the_michigan_cart_pole_at_100_hz():
    from test_references import michigan_cart_pole

    F, G = zero_order_hold(*michigan_cart_pole(), 0.01)
    weights = cost([5000, 0, 100, 0], [1], (4, 1))
    design = dlqr(F, G, weights)
    (promise,) = sampled_guarantees(design, G, weights, weights.input)
    found = margins(state_space(F, G, design.gain, dt=0.01))
    np.testing.assert_allclose(promise.distance, 0.87672, atol=5e-6)
    np.testing.assert_allclose(np.degrees(promise.phase), 52.0, atol=0.05)
    np.testing.assert_allclose(np.degrees(found.lag.value), 53.39, atol=0.01)
    assert found.lag.value > promise.phase
    assert found.upper_gain.value >= promise.upper_gain * (1 - 1e-9)
    assert found.lower_gain.value < promise.lower_gain


@pytest.mark.parametrize('seed', range(10))
def test_the_sampled_guarantee_holds(seed):
    rng = np.random.default_rng(seed)
    F, G = rng.normal(size=(3, 3)), rng.normal(size=(3, 1))
    weights = cost(rng.uniform(0.1, 1.0, 3), rng.uniform(0.1, 1.0, 1), (3, 1))
    design = dlqr(F, G, weights)
    (promise,) = sampled_guarantees(design, G, weights, weights.input)
    loop = state_space(F, G, design.gain, dt=1.0)
    w = np.linspace(0.0, np.pi, 2000)
    assert np.abs(1.0 + loop.response(w)).min() >= promise.distance * (1 - 1e-9)
    found = margins(loop)
    assert found.upper_gain.value >= promise.upper_gain * (1 - 1e-9)
    assert found.lower_gain.value <= promise.lower_gain * (1 + 1e-9)
    assert min(found.lag.value, found.lead.value) >= promise.phase * (1 - 1e-9)


@pytest.mark.parametrize('seed', range(10))
def test_the_sampled_guarantee_holds_for_each_of_several_inputs(seed):
    """Of the exactly sampled cost, which has a cross weight; the inputs have one, too."""
    rng = np.random.default_rng(seed)
    A, B, root, dt = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=(2, 2)), 0.3
    names = ('a', 'b', 'c'), ('', '', '')
    system = LinearSystem(A, B, np.zeros((3, 3)), Space(*names), Space(('u', 'v'), ('', '')))
    R = root @ root.T + 0.01 * np.eye(2)
    weights = sampled_cost(system, cost(rng.uniform(0.1, 1.0, 3), R, (3, 2)), dt)
    step = system.sampled(dt)
    design = dlqr(step.F, step.G, weights)
    loop = state_space(step.F, step.G, design.gain, dt=dt)
    w = np.linspace(0.0, np.pi / dt, 2000)
    promises = sampled_guarantees(design, step.G, weights, R * dt)
    for index, (promise, found) in enumerate(zip(promises, loop_at_a_time(loop))):
        distance = np.abs(1.0 + loop.channel(index).response(w)).min()
        assert distance >= promise.distance * (1 - 1e-9)
        assert min(found.lag.value, found.lead.value) >= promise.phase * (1 - 1e-9)


@pytest.mark.parametrize('seed', range(10))
def test_the_guarantee_of_the_continuous_regulator_holds_input_by_input(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    design = lqr(A, B, cost(rng.uniform(0.1, 1.0, 4), rng.uniform(0.1, 1.0, 2), (4, 2)))
    for found in loop_at_a_time(state_space(A, B, design.gain)):
        assert found.upper_gain.value == np.inf
        assert found.lower_gain.value <= 0.5 + 1e-9
        assert min(found.lag.value, found.lead.value) >= np.pi / 3 - 1e-9


def test_inputs_one_at_a_time_are_those_of_two_loops_apart():
    one, other = random_loop(1), random_loop(2)
    n, k = len(one.A), len(other.A)
    both = state_space(
        np.block([[one.A, np.zeros((n, k))], [np.zeros((k, n)), other.A]]),
        np.block([[one.B, np.zeros((n, 1))], [np.zeros((k, 1)), other.B]]),
        np.block([[one.C, np.zeros((1, k))], [np.zeros((1, n)), other.C]]),
    )
    for found, loop in zip(loop_at_a_time(both), (one, other)):
        alone = margins(loop)
        np.testing.assert_allclose(found.upper_gain.value, alone.upper_gain.value, rtol=1e-7)
        np.testing.assert_allclose(found.lag.value, alone.lag.value, rtol=1e-7)
        np.testing.assert_allclose(found.disk.alpha, alone.disk.alpha, rtol=1e-7)


def pendulum():
    space = Space(('theta', 'omega'), ('rad', 'rad/s'))
    A = [[0.0, 1.0], [9.0, -0.1]]
    return LinearSystem(A, [[0.0], [1.0]], np.zeros((2, 2)), space, Space(('tau',), ('N m',)))


def test_the_time_to_compute_costs_phase():
    plant, dt = pendulum(), 0.02
    K = lqr(plant.A, plant.B, cost([10, 1], [0.1], (2, 1))).gain
    delays = [0.0, 0.3 * dt, dt, 1.5 * dt, 2.0 * dt]
    found = [margins(sampled_plant(plant, K, dt, delay)) for delay in delays]
    lags = [each.lag.value for each in found]
    assert np.all(np.diff(lags) < 0.0)
    w = found[0].lag.frequency
    np.testing.assert_allclose(lags[0] - lags[2], w * dt, rtol=0.05)
    # whole samples are exact: the delay margin shrinks by just as much
    np.testing.assert_allclose(found[0].delay.value - found[4].delay.value, 2 * dt, rtol=1e-6)
    np.testing.assert_allclose(found[0].delay.value - found[3].delay.value, 1.5 * dt, rtol=0.02)
    tau = found[0].delay.value
    assert sampled_plant(plant, K, dt, 0.97 * tau).closed().stable
    assert not sampled_plant(plant, K, dt, 1.03 * tau).closed().stable


@pytest.mark.parametrize('scale', [1e-6, 1e-3, 1e3, 1e6])
def test_units_do_not_matter(scale):
    loop, found = random_loop(3), margins(random_loop(3))
    T = np.diag(scale ** np.linspace(-1, 1, len(loop.A)))
    other = margins(state_space(T @ loop.A @ np.linalg.inv(T), T @ loop.B * scale,
                                loop.C @ np.linalg.inv(T) / scale))  # fmt: skip
    for name in ('lower_gain', 'upper_gain', 'lead', 'lag', 'delay'):
        np.testing.assert_allclose(
            getattr(other, name).value, getattr(found, name).value, rtol=1e-6
        )
    np.testing.assert_allclose(other.disk.alpha, found.disk.alpha, rtol=1e-6)


@pytest.mark.parametrize('scale', [1e-4, 1e4])
def test_the_unit_of_time_does_not_matter(scale):
    loop, found = random_loop(3), margins(random_loop(3))
    other = margins(state_space(loop.A * scale, loop.B * scale, loop.C))
    np.testing.assert_allclose(other.lag.value, found.lag.value, rtol=1e-6)
    np.testing.assert_allclose(other.delay.value * scale, found.delay.value, rtol=1e-6)
    np.testing.assert_allclose(other.disk.alpha, found.disk.alpha, rtol=1e-6)


def test_a_gain_alone():
    found = margins(state_space(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-0.5]]))
    assert (found.lower_gain.value, found.upper_gain.value) == (0.0, 2.0)
    np.testing.assert_allclose(found.disk.alpha, 2.0 * 0.5 / 1.5)


@pytest.mark.parametrize('gain', [-0.9, -0.5, 0.0, 0.3, 1.0, 2.0, 1e6])
@pytest.mark.parametrize('dt', [None, 0.1])
def test_a_gain_alone_has_a_disk_within_its_range(gain, dt):
    found = margins(static(np.array([[gain]]), dt))
    assert 0.0 < found.disk.alpha <= 2.0 and 0.0 <= found.disk.lower_gain <= 1.0
    assert found.disk.upper_gain >= 1.0 and 0.0 < found.disk.phase <= np.pi / 2
    alpha = 2.0 * abs(1.0 + gain) / max(abs(1.0 - gain), abs(1.0 + gain))
    np.testing.assert_allclose(found.disk.alpha, alpha)
    np.testing.assert_allclose(found.distance.value, 1.0 + gain)


@pytest.mark.parametrize(('seed', 'dt'), LOOPS)
def test_the_distance_from_minus_one_is_the_least_on_a_fine_grid(seed, dt):
    loop = random_loop(seed, dt)
    found = margins(loop).distance
    w = np.concatenate(([0.0], np.logspace(-4, 4, 4000)))
    w = w if dt is None else np.append(w[w < np.pi / dt], np.pi / dt)
    on_grid = np.abs(1.0 + loop.response(w)[:, 0, 0]).min()
    assert on_grid * (1 - 1e-3) < found.value < on_grid * (1 + 1e-7)
    if np.isfinite(found.frequency):
        near = abs(1.0 + loop.response(found.frequency)[0, 0, 0])
        np.testing.assert_allclose(near, found.value, rtol=1e-6)


def test_a_direct_path_leaves_no_time():
    found = margins(state_space([[-1.0]], [[1.0]], [[1.0]], [[2.0]]))
    assert found.delay.value == 0.0
    assert margins(state_space([[-1.0]], [[1.0]], [[1.0]], [[0.5]])).delay.value > 0.0


def test_what_has_no_margins_says_why():
    with pytest.raises(DesignError, match='loop: unstable when closed, with poles at 1'):
        margins(state_space([[2.0]], [[1.0]], [[1.0]]))
    with pytest.raises(ValueError, match='expected one input and one output, got 2 and 2'):
        margins(state_space(-np.eye(2), np.eye(2), np.eye(2)))
    plant = pendulum()
    weights = sampled_cost(plant, cost([1, 1], [1], (2, 1)), 0.1)
    step = plant.sampled(0.1)
    with pytest.raises(ValueError, match='floor: expected no sample to cost less'):
        sampled_guarantees(dlqr(step.F, step.G, weights), step.G, weights, weights.input)


@pytest.mark.parametrize('late', [None, 0.0, 0.013])
@pytest.mark.parametrize('stiffness', [0.0, 4.0])
def test_an_open_loop_on_the_boundary(stiffness, late):
    space = Space(('x', 'v'), ('m', 'm/s'))
    A = [[0.0, 1.0], [-stiffness, 0.0]]
    plant = LinearSystem(A, [[0], [1]], np.zeros((2, 2)), space, Space(('f',), ('N',)))
    K = lqr(plant.A, plant.B, cost([1, 1], [1], (2, 1))).gain
    loop = state_space(A, plant.B, K) if late is None else sampled_plant(plant, K, 0.01, late)
    found = margins(loop)
    assert found.lower_gain.value == 0.0 and closed(loop, 1e-4) < 0.0
    high = found.upper_gain.value
    assert high == np.inf if late is None else closed(loop, high * (1 + 1e-6)) > 0.0
    assert closed(loop, min(high, 1e6) * (1 - 1e-6)) < 0.0
    w = np.logspace(-2, 2, 2000)
    L = loop.response(w)[:, 0, 0]
    turns = np.angle(-L)[np.abs(np.abs(L) - 1.0) < 0.01]
    np.testing.assert_allclose(found.lag.value, turns[turns > 0.0].min(), atol=0.02)


def placed_loop(seed, dt):
    """A random plant with poles placed anywhere, often by a very high gain; None if it is none."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, 1))
    real = rng.uniform(0.3, 8.0, n) if dt is None else rng.uniform(1.0, 20.0, n)
    poles = -real.astype(complex)
    for k in range(0, n - 1, 2) if seed % 2 else ():
        w, damping = rng.uniform(0.5, 10.0), rng.uniform(0.02, 0.9)
        poles[k] = complex(-w * damping, w * np.sqrt(1.0 - damping**2))
        poles[k + 1] = poles[k].conjugate()
    try:
        gain = place(A, B, poles if dt is None else np.exp(poles * dt)).gain
        loop = state_space(A, B, gain, dt=dt)
        return loop, margins(loop)
    except DesignError:
        return None


def check_peaks(seed, dt):
    """The claimed peaks are there, and no frequency of a fine grid, refined, has higher ones."""
    if (made := placed_loop(seed, dt)) is None:
        return
    loop, found = made
    high = 1e6 if dt is None else np.pi / dt
    grid = np.append(np.geomspace(1e-4, high, 1500), np.linspace(1e-3, min(high, 30.0), 500))
    peaks = [
        (found.disk.frequency, 2.0 / found.disk.alpha, lambda L: abs((1.0 - L) / (1.0 + L))),
        (found.distance.frequency, 1.0 / found.distance.value, lambda L: 1.0 / abs(1.0 + L)),
    ]
    for at, claimed, size in peaks:
        if claimed > 1.0 + 1e-9 and np.isfinite(at):
            np.testing.assert_allclose(size(loop.response(at))[0, 0, 0], claimed, rtol=1e-4)
        w = grid
        for width in (1e-2, 1e-3, 1e-4, 0.0):
            values = size(loop.response(w))[:, 0, 0]
            assert values.max() <= claimed * (1.0 + 1e-4), (seed, dt)
            w = np.minimum(w[np.argmax(values)] * (1.0 + width * np.linspace(-1, 1, 41)), high)


@pytest.mark.parametrize('dt', [None, 0.1])
@pytest.mark.parametrize('seed', [39, 67, 71, 7, 13, 33])
def test_no_peak_of_a_high_gain_is_missed(seed, dt):
    check_peaks(seed, dt)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('dt', [None, 0.1])
def test_no_peak_of_six_hundred_loops_is_missed(dt):
    for seed in range(600):
        check_peaks(seed, dt)


def test_a_mode_that_alternates_has_margins():
    """L = k / (z + 1), stable with gains of 0 to -2 / k, beside a search of the unit circle."""
    k = -0.618
    found = margins(state_space([[-1.0]], [[1.0]], [[k]], dt=1.0))
    assert found.lower_gain.value == 0.0
    assert found.upper_gain.value == pytest.approx(-2.0 / k, rel=2e-6)
    w = np.linspace(1e-6, np.pi - 1e-6, 2_000_001)
    L = k / (np.exp(1j * w) + 1.0)
    assert found.distance.value == pytest.approx(np.abs(1.0 + L).min(), rel=1e-5)
    (crossing,) = np.flatnonzero(np.diff(np.abs(L) > 1.0))
    phase = np.angle(-L[crossing]) % (2.0 * np.pi)
    assert found.delay.value == pytest.approx(phase / w[crossing], rel=1e-4)
