# SPDX-License-Identifier: Apache-2.0
"""Plants by MuJoCo, which share no code with the package, behind the topics alone."""

import os
import sys
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import run_command

pytest.importorskip('mujoco', reason='the plants of docs/examples/mujoco need it')
pytest.importorskip('rclpy')

import mujoco

import kalman_ros as kr

FOLDER = Path(__file__).parents[2] / 'docs' / 'examples' / 'mujoco'
LIMITS = {'law': 'mpc', 'state_limit.x': [-0.75, 0.75], 'state_limit.theta': [-0.1, 0.1]}
FAR = {'initial_estimate': [0.7, 0.0, 0.0, 0.0]}
PATH = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)])


@pytest.fixture
def example(monkeypatch):
    """The module that runs the loops; quadrotor.py is on the path, too."""
    monkeypatch.syspath_prepend(str(FOLDER))
    folders = [str(FOLDER), os.environ.get('PYTHONPATH', '')]
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(filter(None, folders)))
    yield import_module('run')
    for name in ('run', 'quadrotor'):
        sys.modules.pop(name, None)


def consistent(loop, name, bound):
    """Return whether the mean NEES of each state is below the bound, and above its half."""
    space = kr.load(str(FOLDER / f'{name}.yaml')).model.state
    error = space.subtract(loop.estimate, loop.truth)
    nees = np.einsum('ki,kij,kj->k', error, np.linalg.inv(loop.covariance), error)
    return 0.5 < nees.mean() / space.size < bound


def accelerations(name, position, velocity, control):
    """Return what MuJoCo says of a state."""
    model = mujoco.MjModel.from_xml_path(str(FOLDER / f'{name}.xml'))
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.ctrl = position, velocity, control
    mujoco.mj_forward(model, data)
    return data.qacc.copy()


def test_the_equations_are_those_of_mujoco(example):
    """With MuJoCo's own parameters, models and MuJoCo have the same accelerations."""
    own = {'cart_mass': 0.8, 'pole_mass': 0.25, 'friction': 0.3, 'inertia': 0.01333}
    own |= {'length': 0.4, 'gravity': 9.81}
    values = {f'model_parameters.{key}': value for key, value in own.items()}
    cart = kr.load(str(FOLDER / 'cart_pole.yaml'), values).model
    rates = cart.derivative(np.array([0.1, -0.5, 2.0, 1.5]), np.array([3.0]))
    expected = accelerations('cart_pole', [0.1, 2.0], [-0.5, 1.5], [3.0])
    np.testing.assert_allclose(rates[[1, 3]], expected, rtol=1e-9)

    quadrotor = import_module('quadrotor').Quadrotor(1.2, 0.015, 0.25)
    x = np.array([0.2, 0.1, 0.4, 1.0, -0.5, 0.3])
    rates = quadrotor.derivative(x, np.array([13.0, 0.2]))
    expected = accelerations('quadrotor', x[:3], x[3:], [13.0, 0.2])
    np.testing.assert_allclose(rates[3:], expected, rtol=1e-9)


@pytest.mark.slow
def test_the_pole_stands_and_its_limits_are_kept(example):
    loop = example.run('cart_pole', 'far', {**FAR, **LIMITS}, seconds=4.0)
    x, _, theta, _ = loop.truth.T
    assert len(loop.time) == 401
    assert x[0] == 0.7
    assert np.abs(x).max() < 0.755
    assert 0.09 < np.abs(theta).max() < 0.11
    assert np.abs(loop.input).max() <= 10.0
    assert np.abs(x[300:]).max() < 0.05
    assert np.abs(theta[300:]).max() < 0.05
    assert consistent(loop, 'cart_pole', 1.3)


@pytest.mark.slow
@pytest.mark.thorough
def test_without_limits_the_same_cart_leaves_them(example):
    loop = example.run('cart_pole', 'far', FAR, seconds=2.0)
    assert loop.truth[:, 0].max() > 0.78
    assert loop.truth[:, 2].max() > 0.2


@pytest.mark.slow
@pytest.mark.thorough
def test_the_robot_on_wheels_follows_a_path(example):
    loop = example.run('robot', seconds=12.0, reference=example.path_of(PATH))
    position = loop.truth[:, :2]
    along = np.linspace(0.0, 1.0, 401)[:, None]
    points = np.concatenate([a + along * (b - a) for a, b in pairwise(PATH)])
    distance = np.linalg.norm(position[:, None] - points, axis=-1)
    assert distance.min(axis=1).max() < 0.1  # the corner is cut
    assert distance.min(axis=0).max() < 0.1
    np.testing.assert_allclose(position[-1], PATH[-1], atol=0.03)
    assert consistent(loop, 'robot', 3.0)


@pytest.mark.slow
@pytest.mark.thorough
def test_the_quadrotor_flies_a_circle(example):
    loop = example.run('quadrotor', seconds=7.5, reference=example.circle_of(1.0, 5.0))
    x, z = loop.truth[:, 0], loop.truth[:, 1]
    radius = np.hypot(x, z - 1.0)
    assert np.abs(radius - 1.0).max() < 0.1
    assert z.max() > 1.9
    assert np.hypot(x, z)[-50:].max() < 0.05
    assert consistent(loop, 'quadrotor', 1.5)


@pytest.mark.slow
@pytest.mark.thorough
def test_its_first_flight_tells_its_mass(example, tmp_path):
    guess, recording = 'quadrotor_guess.yaml', tmp_path / 'flight'
    circle = example.circle_of(1.0, 5.0)
    loop = example.run(
        'quadrotor', parameters=guess, seconds=12.0, reference=circle, record=recording
    )
    assert loop.truth[-1, 1] < -0.3  # the guess is too light
    options = ('--params-file', FOLDER / guess, '--fit', 'mass', 'inertia', 'drag')
    _, out, error = run_command('tune', recording, *options, '--out', tmp_path / 'tune')
    fitted = next((tmp_path / 'tune').rglob('fitted.yaml'))
    values = yaml.safe_load(fitted.read_text())['/**']['ros__parameters']
    assert values['model_parameters.mass'] == pytest.approx(1.2, rel=0.02), out + error
    assert values['model_parameters.inertia'] == pytest.approx(0.015, rel=0.1)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.real_time
def test_in_real_time_the_pole_stands(example):
    loop = example.run('cart_pole', seconds=5.0, lockstep=False)
    assert len(loop.time) > 300
    assert np.abs(loop.truth[-100:, 2]).max() < 0.1
    error = loop.estimate - loop.truth
    assert np.abs(error[-100:, [0, 2]]).max() < 0.03  # an interruption adds to it
