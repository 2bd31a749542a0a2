# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.control.tracking import feed_forward
from kalman_ros.core import LinearSystem, Space

MASS = Space(('x', 'v'), ('m', 'm/s'))
FORCE = Space(('f',), ('N',))


def body(stiffness=2.0, inputs=1):
    A = [[0.0, 1.0], [-stiffness, -0.3]]
    forces = Space(tuple(f'f{index}' for index in range(inputs)), ('N',) * inputs)
    return LinearSystem(A, [[0.0] * inputs, [0.5] * inputs], np.zeros((2, 2)), MASS, forces)


@pytest.mark.parametrize('stiffness', [0.0, 2.0, 1e9])
def test_a_spring_is_held_by_its_force(stiffness):
    found = feed_forward(body(stiffness)).equilibrium([0.3, 0.0])
    np.testing.assert_allclose(found.state, [0.3, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.input, [0.6 * stiffness], rtol=1e-9, atol=1e-12)


def test_some_coordinates_say_where_the_others_are():
    found = feed_forward(body(), ['x']).equilibrium([-0.2])
    np.testing.assert_allclose(found.state, [-0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.input, [-0.8], rtol=1e-9)


@pytest.mark.parametrize('stiffness', [0.0, 2.0, 1e9])
def test_a_body_that_rests_does_not_move(stiffness):
    tracking = feed_forward(body(stiffness))
    np.testing.assert_allclose(tracking.nearest([0.3, 0.5]).state, [0.3, 0.0], atol=1e-12)
    with pytest.raises(ValueError, match=r'holds the system at v = 0\.5 \(nearest .*\)$'):
        tracking.equilibrium([0.3, 0.5])
    with pytest.raises(ValueError, match='v = 0.5'):
        feed_forward(body(stiffness), ['v']).equilibrium([0.5])


def test_what_is_not_reached_is_said_as_it_was_asked_for():
    """About a place at rest of x = 3 m and v = 0, in its numbers and without rounding errors."""
    tracking = feed_forward(body(), ['x', 'v'])
    with pytest.raises(ValueError, match=r'at v = 0\.5 \(nearest 0\)$'):
        tracking.equilibrium([0.0, 0.5], [3.0, 0.0])
    stuck = LinearSystem(body().A, np.zeros((2, 1)), np.zeros((2, 2)), MASS, FORCE)
    with pytest.raises(ValueError, match=r'at x = 3\.2 \(nearest 3\), v = 1 \(nearest 0\)$'):
        feed_forward(stuck, ['x', 'v']).equilibrium([0.2, 1.0], [3.0, 0.0])


def test_inputs_that_do_the_same_share():
    found = feed_forward(body(inputs=2)).equilibrium([0.3, 0.0])
    np.testing.assert_allclose(found.input, [0.6, 0.6], rtol=1e-9)


@pytest.mark.parametrize('seed', range(20))
def test_nearest_is_nearest_of_all_equilibria(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    space = Space(tuple('abcd'), ('',) * 4)
    plant = LinearSystem(A, B, np.zeros((4, 4)), space, Space(('u', 'w'), ('', '')))
    r = rng.normal(size=3)
    found = feed_forward(plant, ['d', 'a', 'b']).nearest(r)
    np.testing.assert_allclose(A @ found.state + B @ found.input, 0.0, atol=1e-10)
    states = -np.linalg.solve(A, B)[[3, 0, 1]]
    best = states @ np.linalg.lstsq(states, r, rcond=None)[0]
    np.testing.assert_allclose(found.state[[3, 0, 1]], best, atol=1e-9)
    # as many inputs as coordinates reach them all
    two = feed_forward(plant, ['c', 'b']).equilibrium(r[:2])
    np.testing.assert_allclose(two.state[[2, 1]], r[:2], atol=1e-9)


def test_an_equilibrium_rests_in_samples_too():
    plant = body()
    found = feed_forward(plant).equilibrium([0.3, 0.0])
    np.testing.assert_allclose(plant.step(found.state, found.input, 0.1), found.state, atol=1e-12)


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match='coordinates: expected names among'):
        feed_forward(body(), ['y'])
    with pytest.raises(ValueError, match='reference: expected 2 numbers, got 1'):
        feed_forward(body()).equilibrium([1.0])
