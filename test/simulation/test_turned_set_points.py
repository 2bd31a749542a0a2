# SPDX-License-Identifier: Apache-2.0
"""Set points at which a robot has another heading, where the gains of its equilibrium fail."""

from dataclasses import replace

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros import scenario
from kalman_ros.control.feedback import Regulator
from kalman_ros.control.limiter import limits_of
from kalman_ros.control.motion import Motion
from kalman_ros.core import DesignError, OperatingPoint
from kalman_ros.scenario import regulator as regulators
from kalman_ros.scenario.motions import motion_of, moving_point, with_law
from kalman_ros.scenario.reference_motions import in_time
from kalman_ros.scenario.regulator import SetPointGains, feedback, feedback_at, steered

ROBOT = {'model': 'robot_2d', 'model_parameters.command_time': 0.2}


def built(law='lqr', **changes):
    return scenario.build({**ROBOT, 'law': law, **changes})


def at(found, **named):
    rest = found.model.equilibrium
    state = rest.state.copy()
    state[found.model.state.indices(named, 'named')] = [*named.values()]
    return OperatingPoint(state, rest.input)


def slowest(found, held, gains):
    """Return the largest size of a pole of the loop about a point, in steps."""
    step = kr.linearize(found.model, *held).sampled(1.0 / found.rate)
    return np.abs(np.linalg.eigvals(step.F - step.G @ gains)).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ('law', 'near', 'far'),
    [('lqr', 0.15, 5.0), ('mpc', 0.15, 5.0), ('lqi', 0.15, 5.0), ('placement', 0.3, 10.0)],
)
@pytest.mark.parametrize('yaw', [-1.8, 3.0])
def test_it_drives_to_a_place_where_it_has_another_heading(law, near, far, yaw):
    reference = {'x': 1.0, 'y': 0.5, 'yaw': yaw}
    run = kr.simulate('robot_2d', {**ROBOT, 'law': law}, seconds=15, reference=reference, seed=2)
    off = run.scenario.model.state.subtract(run.truth[-1], at(built(), **reference).state)
    assert np.abs(off[:3]).max() < near
    assert np.abs(run.truth).max() < far


def test_the_gains_are_those_of_the_place():
    found = built()
    known, held = feedback(found), at(found, yaw=2.5)
    gains = feedback_at(found, held, known)
    assert slowest(found, held, known.gain) > 1.0
    assert slowest(found, held, gains.gain) < 1.0
    np.testing.assert_allclose(
        np.sort(np.abs(gains.poles)), np.sort(np.abs(known.poles)), rtol=1e-6
    )


def test_where_the_model_is_alike_they_stay_the_same_object():
    for found, held in (
        (built(), at(built(), x=3.0, y=-2.0)),
        (built(), at(built(), x=0.0)),
        (scenario.build({'model': 'mass_spring_damper'}), None),
    ):
        known = feedback(found)
        assert feedback_at(found, held or at(found, x=1.0), known) is known


def test_a_state_that_does_not_rest_and_a_robot_on_wheels_keep_theirs():
    found = built()
    known = feedback(found)
    assert feedback_at(found, at(found, yaw=2.0, vx=1.0), known) is known
    wheels = scenario.build({'model': 'diff_drive', 'model_parameters.command_time': 0.2})
    assert steered(wheels)
    known = feedback(wheels)
    assert feedback_at(wheels, at(wheels, psi=2.0), known) is known


def test_after_a_motion_limits_are_predicted_about_its_end():
    found, dt = built('mpc', **{'state_limit.vx': [-0.2, 0.2]}), 0.02
    end = at(found, x=1.0, yaw=2.5)
    limits = limits_of(found.model.input.size, {'input_limit': [0.3]})

    def inputs(count):
        states, u = np.tile(end.state, (count, 1)), np.tile(end.input, (count, 1))
        motion = with_law(found, Motion(found.model.state, 1.0 / found.rate, states, u))
        regulator = Regulator(
            found.model.state, feedback(found), found.model.equilibrium, limits=limits
        )
        regulator.follow_motion(motion)
        x = end.state + 0.5
        wanted = []
        for _ in range(5):
            wanted.append(regulator.propose(x, dt))
            regulator.applied(x, wanted[-1], limits.within(wanted[-1]), dt)
        return wanted

    np.testing.assert_allclose(inputs(2), inputs(50), atol=1e-5)


def regulated(found, regulator, x, seconds, motion=None):
    """Return where a robot without noise gets to, by a regulator that follows a motion."""
    limiter, dt = limits_of(found.model.input.size, {}), 1.0 / found.rate
    if motion is not None:
        regulator.follow_motion(motion)
    for _ in range(round(seconds * found.rate)):
        u = regulator.propose(x, dt)
        regulator.applied(x, u, limiter.within(u), dt)
        x = found.model.step(x, u, dt)
    return x


def moved(found, first, last):
    """Return a motion of 5 s in which the robot turns on the spot."""
    values = np.array([[0.0, 0.0, first], [0.0, 0.0, last]])
    return motion_of(found, in_time(found, (0, 1, 2), np.array([0.0, 5.0]), values))


@pytest.mark.slow
@pytest.mark.parametrize('law', ['lqr', 'mpc', 'lqi', 'placement'])
def test_it_stays_where_a_motion_ends_and_follows_one_from_a_set_point(law):
    found = built(law)
    known, rest = feedback(found), found.model.equilibrium
    regulator = Regulator(found.model.state, known, rest)
    held = at(found, yaw=2.5)
    regulator.hold(*held, feedback_at(found, held, known))
    back = moved(found, 2.5, 0.0)
    x = regulated(found, regulator, held.state + 0.01 * np.eye(8)[0], 30.0, back)
    assert np.abs(found.model.state.subtract(x, rest.state)[:3]).max() < 0.02
    assert regulator.feedback is known
    x = regulated(found, regulator, x + 0.1 * np.eye(8)[0], 40.0, moved(found, 0.0, 2.5))
    assert np.abs(found.model.state.subtract(x, held.state)[:3]).max() < 0.02


@pytest.mark.parametrize('law', ['lqr', 'mpc', 'lqi'])
def test_a_set_point_that_moved_on_is_held_where_it_rests(law):
    found = built(law)
    motion = moving_point(found, at(found, yaw=2.5, vx=0.3).state, None, 0.5)
    regulator = Regulator(found.model.state, feedback(found), found.model.equilibrium)
    x = regulated(found, regulator, at(found, yaw=2.5).state, 30.0, motion)
    off = found.model.state.subtract(x, motion.states[-1])
    assert np.abs(off[:3]).max() < 0.05


def test_limits_of_states_are_kept_after_a_set_point_that_moved_on():
    found = scenario.build({'model': 'cart_pole', 'law': 'mpc', 'state_limit.v': [-0.3, 0.3]})
    limits = limits_of(1, {'input_limit': [20.0]})
    rest = found.model.equilibrium
    motion = moving_point(found, rest.state + 0.1 * np.eye(4)[1], None, 0.2)
    regulator = Regulator(found.model.state, feedback(found), rest, limits=limits)
    regulator.follow_motion(motion)
    x, fastest = rest.state, 0.0
    for step in range(800):
        if step == 100:
            x = x - 2.0 * np.eye(4)[0]
        u = limits.within(regulator.propose(x, 0.01))
        regulator.applied(x, u, u, 0.01)
        x = found.model.step(x, u, 0.01)
        fastest = max(fastest, abs(x[1]))
    assert fastest < 0.35
    assert abs(x[0]) < 2.0


def test_the_gain_of_somebody_is_that_of_every_set_point():
    K = np.zeros((3, 8))
    K[2, 2] = 1.0
    overrides = {key: value for key, value in ROBOT.items() if key != 'model'}
    mine, designed = (kr.Regulator('robot_2d', overrides, gain=gain) for gain in (K, None))
    for regulator in (mine, designed):
        before = regulator.gain
        regulator.hold({'yaw': 2.5})
        assert np.array_equal(regulator.gain, before) == (regulator is mine)


def test_a_set_point_that_comes_again_keeps_its_plan():
    found = built('mpc')
    gains, held = SetPointGains(found, feedback(found)), at(found, yaw=2.5)
    regulator = Regulator(found.model.state, gains.law, found.model.equilibrium)
    regulator.hold(*held, gains.at(held))
    first = regulator.predictor
    regulator.hold(*held, gains.at(at(found, yaw=2.5)))
    assert regulator.predictor is first
    regulator.hold(*found.model.equilibrium, gains.at(found.model.equilibrium))
    assert regulator.feedback is gains.law


def test_a_set_point_changes_what_is_predicted():
    found = built('mpc')
    held = at(found, yaw=2.5)
    regulator = Regulator(found.model.state, feedback(found), found.model.equilibrium)
    before = regulator.predictor
    regulator.hold(*held, feedback_at(found, held, feedback(found)))
    assert regulator.predictor is not before
    assert not np.allclose(regulator.feedback.prediction.F, feedback(found).prediction.F)
    regulator.adopt(replace(feedback(found)), 0.0)
    np.testing.assert_array_equal(regulator.feedback.gain, feedback(found).gain)


@pytest.mark.parametrize('error', [ZeroDivisionError, np.linalg.LinAlgError, ValueError])
def test_a_place_where_there_are_no_gains_is_refused_in_a_sentence(error, monkeypatch):
    found = built()
    gains = SetPointGains(found, feedback(found))

    def fails(*arguments):
        raise error('as it happens')

    monkeypatch.setattr(regulators, 'feedback_at', fails)
    with pytest.raises(DesignError, match='^reference: the law has no gains there: as it'):
        gains.at(at(found, yaw=2.5))
    assert gains.where_possible(at(found, yaw=2.5)) is gains.law
    assert gains.at(found.model.equilibrium) is gains.law
