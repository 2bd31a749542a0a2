"""Names that a system of python-control has, in every result about it."""

import numpy as np
import pytest

import kalman_ros as kr

control = pytest.importorskip('control')


@pytest.fixture(scope='module')
def cart():
    return control.ss(
        [[0, 1], [-1, -0.5]],
        [[0], [1]],
        [[1, 0]],
        0,
        states=['p', 'v'],
        inputs=['f'],
        outputs=['y'],
    )


def test_an_estimator_has_the_names_of_states_and_readings(cart):
    for found in (
        kr.lqe(cart, 1, 0.1),
        kr.lqe(cart, 1, 0.1, dt=0.1),
        kr.dlqe(cart.sample(0.1), 1, 1),
    ):
        assert found.states == ('p', 'v') and found.readings == ('y',)
        assert 'gain p' in repr(found) or 'L p' in repr(found)


def test_a_step_has_the_names_of_states_and_inputs(cart):
    found = kr.discretize(cart, dt=0.1)
    assert found.states == ('p', 'v') and found.inputs == ('f',)
    assert 'G v' in repr(found) and len(found) == 4
    assert kr.discretize([[0, 1], [0, 0]], [0, 1], 0.1).states == ('x0', 'x1')


def test_readings_of_a_model_have_the_names_of_its_sensors():
    model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0.1], states='p v')
    place = kr.sensor([1, 0], 0.1, outputs='p_read')
    assert kr.lqe(model, place, dt=0.1).readings == ('p_read',)
    assert kr.lqe(model, [place, place], dt=0.1).readings == ('y0', 'y1')


def test_what_is_rounding_against_the_input_is_zero():
    turn = kr.discretize([[0, 1], [-1, 0]], [[0], [1]], 2.0 * np.pi)
    assert not turn.G.any()
    small = kr.discretize([[0, 1], [-1, 0]], [[0], [1]], 1e-6)
    assert small.G[0, 0] == pytest.approx(5e-13)


def test_the_gain_of_an_observer_by_another_letter():
    with pytest.raises(AttributeError, match=r'here it is \.L'):
        kr.lqe([[0, 1], [0, 0]], [1, 0], [0, 1], 1).K  # noqa: B018


@pytest.mark.slow
def test_what_is_printed_is_an_attribute():
    run = kr.simulate(seconds=1.0)
    for i, row in enumerate(repr(run).splitlines()[2:6]):
        *_, rms, claimed = row.split()
        assert float(rms) == pytest.approx(run.rms_error[i], rel=1e-3)
        assert float(claimed) == pytest.approx(run.claimed[i], rel=1e-3)
    design = kr.design('mass_spring_damper_2d')
    assert f'J = {design.cost:.4g} a second' in ' '.join(repr(design).split())
    assert f'a thousandth in {design.settling_time:.3g}' in ' '.join(repr(design).split())
    with pytest.raises(ValueError, match='cost: there is no loop'):
        kr.design('constant_velocity').cost  # noqa: B018
