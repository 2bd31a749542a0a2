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
from kalman_ros.core import OperatingPoint
from kalman_ros.scenario.motions import with_law
from kalman_ros.scenario.regulator import feedback, feedback_at, steered

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

    np.testing.assert_allclose(inputs(2), inputs(50), atol=1e-6)


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
