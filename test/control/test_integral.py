# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.control.integral import lqi, sampled_lqi
from kalman_ros.control.lqr import cost
from kalman_ros.core import DesignError, LinearSystem, Space

MASS = Space(('x', 'v'), ('m', 'm/s'))
FORCE = Space(('f',), ('N',))
WEIGHTS = cost([1, 0.1], [0.2], (2, 1))


def body(stiffness=2.0, damping=0.3, mass=1.0):
    A = [[0.0, 1.0], [-stiffness / mass, -damping / mass]]
    return LinearSystem(A, [[0.0], [1.0 / mass]], np.zeros((2, 2)), MASS, FORCE)


def test_the_gains_of_an_integrator_by_hand():
    # dx/dt = u, dq/dt = x: the double integrator (q, x), for which K = [1, sqrt 3]
    plant = LinearSystem([[0]], [[1]], [[0]], Space(('x',), ('m',)), FORCE)
    design = lqi(plant, ['x'], cost([1], [1], (1, 1)), [1])
    np.testing.assert_allclose(design.gain, [[np.sqrt(3.0)]], atol=1e-10)
    np.testing.assert_allclose(design.integral_gain, [[1.0]], atol=1e-10)
    np.testing.assert_allclose(np.abs(design.poles), 1.0, atol=1e-10)


def test_no_force_and_no_wrong_model_leaves_an_error_continuous():
    design = lqi(body(), ['x'], WEIGHTS, [3.0])
    real, push, r = body(stiffness=4.0, mass=1.5), np.array([0.0, -0.7]), 0.4
    # at rest: 0 = A x - B (K x + Kq q) + push, 0 = C x - r
    K, Kq = design.gain, design.integral_gain
    M = np.block([[real.A - real.B @ K, -real.B @ Kq], [np.array([[1.0, 0.0, 0.0]])]])
    assert np.all(np.linalg.eigvals(M).real < 0.0)
    rest = np.linalg.solve(M, [*-push, r])
    np.testing.assert_allclose(rest[:2], [r, 0.0], atol=1e-12)


def test_no_force_and_no_wrong_model_leaves_an_error_sampled():
    dt, r = 0.05, 0.4
    design = sampled_lqi(body(), ['x'], WEIGHTS, [3.0], dt)
    step = body(stiffness=4.0, mass=1.5).sampled(dt)
    x, q = np.zeros(2), np.zeros(1)
    for _ in range(2000):
        u = -design.gain @ x - design.integral_gain @ q
        x, q = step.F @ x + step.G @ (u - 0.7), q + (x[:1] - r) * dt
    np.testing.assert_allclose(x, [r, 0.0], atol=1e-9)


def test_the_poles_are_those_of_the_loop():
    dt = 0.05
    plant = body()
    design = sampled_lqi(plant, ['x'], WEIGHTS, [3.0], dt)
    step = plant.sampled(dt)
    K, Kq = design.gain, design.integral_gain
    loop = np.block([[step.F - step.G @ K, -step.G @ Kq], [np.array([[dt, 0.0, 1.0]])]])
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(loop)), np.sort_complex(design.poles), atol=1e-10
    )
    assert np.all(np.abs(design.poles) < 1.0)


def test_fast_sampling_approaches_the_continuous_design():
    slow, fast = (
        lqi(body(), ['x'], WEIGHTS, [3.0]),
        sampled_lqi(body(), ['x'], WEIGHTS, [3.0], 1e-4),
    )
    np.testing.assert_allclose(fast.gain, slow.gain, rtol=1e-3)
    np.testing.assert_allclose(fast.integral_gain, slow.integral_gain, rtol=1e-3)


@pytest.mark.parametrize(('design', 'where'), [(lqi, 's = 0'), (sampled_lqi, 'z = 1')])
def test_what_no_steady_input_holds_is_named(design, where):
    sample = (0.1,) if design is sampled_lqi else ()
    with pytest.raises(DesignError, match=f'holds v at a reference: .* zero at {where}') as error:
        design(body(), ['v'], WEIGHTS, [1.0], *sample)
    assert 'inputs hold' not in str(error.value)
    with pytest.raises(
        DesignError, match='holds v at a reference: .*1 inputs hold no more than 1'
    ):
        design(body(), ['x', 'v'], WEIGHTS, [1.0, 1.0], *sample)


def test_a_speed_without_its_position_can_be_tracked():
    plant = LinearSystem([[-0.3]], [[1]], [[0]], Space(('v',), ('m/s',)), FORCE)
    assert lqi(plant, ['v'], cost([1], [1], (1, 1)), [1]).integral_gain[0, 0] > 0.0


@pytest.mark.parametrize(
    ('tracked', 'integral_cost', 'says'),
    [
        (['y'], [1.0], 'tracked: expected names among'),
        ([], [], 'tracked: expected one or more'),
        (['x', 'x'], [1.0, 1.0], 'tracked: expected one or more unique'),
        (['x'], [0.0], 'integral_cost: expected a positive definite'),
        (['x'], [1.0, 2.0], 'integral_cost: expected 1 numbers'),
    ],
)
def test_wrong_arguments_are_named(tracked, integral_cost, says):
    with pytest.raises(ValueError, match=says):
        lqi(body(), tracked, WEIGHTS, integral_cost)
