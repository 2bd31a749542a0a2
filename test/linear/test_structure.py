# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.linear.structure import controllability, observability

NAMES = ('x', 'v', 'z')
# a body, and an independent growing mode
A = np.array([[0.0, 1.0, 0.0], [-2.0, -1.0, 0.0], [0.0, 0.0, 0.5]])


def test_what_the_input_cannot_move_is_named():
    found = controllability(A, np.array([[0.0], [1.0], [0.0]]), NAMES)
    assert (found.reached, found.unreached) == (('x', 'v'), ('z',))
    assert not found.stabilizable
    assert [str(mode) for mode in found.hidden] == ['0.5 (z)']
    assert str(found) == 'the input controls x, v; not z'


def test_what_decays_by_itself_may_be_left_alone():
    B = np.array([[0.0], [0.0], [1.0]])
    found = controllability(A, B, NAMES)
    assert found.stabilizable and found.reached == ('z',)
    assert [mode.states for mode in found.hidden] == [('x', 'v')]  # one for the pair
    slow = controllability(A + np.diag([1.0, 1.0, 0.0]), B, NAMES)
    assert not slow.stabilizable


def test_stability_in_samples_is_another():
    F, G = np.diag([0.9, 1.2]), np.array([[0.0], [1.0]])
    assert controllability(F, G, ('a', 'b'), sampled=True).stabilizable
    assert not controllability(F, G, ('a', 'b')).stabilizable


def test_a_speed_hides_where_one_is():
    free = np.array([[0.0, 1.0], [0.0, -0.3]])
    found = observability(free, np.array([[0.0, 1.0]]), ('x', 'v'))
    assert (found.seen, found.unseen, found.detectable) == (('v',), ('x',), False)
    assert str(found.hidden[0]) == '0 (x)'


@pytest.mark.parametrize('seed', range(10))
def test_random_systems_are_controllable_until_they_are_split(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 1))
    names = tuple('abcd')
    assert controllability(A, B, names).reached == names
    A[2:, :2], B[2:] = 0.0, 0.0
    found = controllability(A, B, names)
    assert found.unreached == ('c', 'd')
    poles = np.linalg.eigvals(A[2:, 2:])
    expected = np.sort_complex(poles[poles.imag >= 0.0])
    np.testing.assert_allclose(np.sort_complex([m.pole for m in found.hidden]), expected)
    assert found.stabilizable == bool(np.all(poles.real < 0.0))
