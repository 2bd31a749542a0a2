# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalman_ros.core import Space

HEADING = Space(('x', 'psi'), ('m', 'rad'), angles=('psi',))


@given(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0))
def test_a_difference_of_angles_is_the_shortest(a, b):
    difference = HEADING.subtract(np.array([a, a]), np.array([b, b]))
    assert difference[0] == a - b
    assert -np.pi <= difference[1] <= np.pi
    np.testing.assert_allclose(np.cos(difference[1]), np.cos(a - b), atol=1e-9)
    np.testing.assert_allclose(np.sin(difference[1]), np.sin(a - b), atol=1e-9)


def test_neighbours_across_pi_are_near():
    near = HEADING.subtract(np.array([0.0, np.pi - 0.01]), np.array([0.0, -np.pi + 0.01]))
    np.testing.assert_allclose(near[1], -0.02)


def test_the_mean_of_angles_is_their_direction():
    points = np.array([[1.0, np.pi - 0.1], [3.0, -np.pi + 0.1]])
    mean = HEADING.mean(points, np.array([0.5, 0.5]))
    assert mean[0] == 2.0
    np.testing.assert_allclose(abs(mean[1]), np.pi)


def test_a_space_without_angles_is_plain_subtraction():
    space = Space(('a', 'b'), ('', ''))
    np.testing.assert_array_equal(
        space.subtract(np.array([5.0, 9.0]), np.array([1.0, 2.0])), [4.0, 7.0]
    )


@pytest.mark.parametrize(
    ('names', 'units', 'angles', 'says'),
    [
        (('x', 'x'), ('m', 'm'), (), 'unique'),
        (('x',), ('m', 'm'), (), 'units: expected 1'),
        (('x',), ('m',), ('psi',), "angles: expected names among \\(x\\), got 'psi'"),
    ],
)
def test_a_wrong_space_says_why(names, units, angles, says):
    with pytest.raises(ValueError, match=says):
        Space(names, units, angles)


def test_labels_have_units():
    assert HEADING.label('x') == 'x [m]'
    assert Space(('n',), ('',)).label('n') == 'n'


def test_a_selection_keeps_units_and_angles_in_the_order_asked_for():
    found = Space(('x', 'psi', 'v'), ('m', 'rad', 'm/s'), angles=('psi',)).select(('v', 'psi'))
    assert found == Space(('v', 'psi'), ('m/s', 'rad'), angles=('psi',))
    np.testing.assert_allclose(found.wrap(np.array([4.0, 4.0])), [4.0, 4.0 - 2.0 * np.pi])
