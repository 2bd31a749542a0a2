# SPDX-License-Identifier: Apache-2.0
"""Jacobians that are none are named by the design; those of this package are right."""

import re
from pathlib import Path

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.jacobians import wrong_jacobians
from kalman_ros.core import Model, Sensor, Space, variances
from kalman_ros.scenario.parameter_files import from_file

CONFIGS = sorted((Path(__file__).parents[2] / 'config').glob('*.yaml'))


class Pendulum(Model):
    state = Space(('theta', 'omega'), ('rad', 'rad/s'), angles=('theta',))
    input = Space(('tau',), ('N m',))

    def derivative(self, x, u):
        return np.stack((x[..., 1], 3.0 * u[..., 0] - 20.0 * np.sin(x[..., 0])), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.05])


class WrongSign(Pendulum):
    def state_jacobian(self, x, u):
        return np.array([[0.0, 1.0], [20.0 * np.cos(x[0]), 0.0]])


class WrongGain(Pendulum):
    def input_jacobian(self, x, u):
        return np.array([[0.0], [1.0]])


class Height(Sensor):
    def __init__(self, state, noise):
        self.output = Space(('height',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x):
        return -np.cos(x[..., :1])


class WrongHeight(Height):
    def jacobian(self, x):
        return np.array([[np.cos(x[0]), 0.0]])


def found(model, sensor=Height):
    """Return the sentences on the wrong Jacobians of a model and a sensor."""
    values = {
        'model': f'{__name__}:{model.__name__}',
        'sensors': ['height'],
        'height.kind': f'{__name__}:{sensor.__name__}',
        'height.type': 'sensor_msgs/Range',
        'height.fields': ['range'],
        'height.noise': [0.1],
        'initial_estimate': [0.5, 0.0],
    }
    return list(wrong_jacobians(scenario.build(values)))


@pytest.mark.parametrize('config', CONFIGS, ids=lambda path: path.stem)
def test_the_jacobians_of_this_package_are_derivatives(config):
    assert not list(wrong_jacobians(scenario.build(from_file(config))))


def test_numerical_jacobians_are_right():
    assert not found(Pendulum)


@pytest.mark.parametrize(
    ('wrong', 'says'),
    [
        ((WrongSign,), 'state_jacobian .* omega by theta is 17.55, and should be -17.55'),
        ((WrongGain,), 'input_jacobian .* omega by tau is 1, and should be 3'),
        ((Pendulum, WrongHeight), 'of height .* height by theta is 0.8776, and should be 0.4794'),
    ],
)
def test_a_wrong_jacobian_is_named_with_its_entry(wrong, says):
    (sentence,) = found(*wrong)
    assert re.search(says, sentence)
