# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Model, Sensor, Space, variances


@pytest.mark.parametrize(
    ('values', 'says'),
    [
        ({'model': 'mass_spring'}, "unknown model 'mass_spring'; did you mean"),
        ({'model': 'nowhere:Thing'}, "model: cannot load 'nowhere:Thing'"),
        ({'state_cost': [1.0, 2.0]}, 'state_cost: expected 4 numbers'),
        ({'input_cost': [1.0, 0.0]}, 'input_cost: expected a positive definite'),
        ({'velocity.rate': 200.0}, 'velocity.rate: expected 0.01 to 100 Hz, got 200'),
        ({'position.noise': [-1.0, 2.0]}, 'position.noise: expected positive standard dev'),
        ({'position.noise': [1.0]}, 'position.noise: expected 2 numbers, got 1'),
        (
            {'sensors': ['positon']},
            "unknown sensor 'positon'; did you mean 'position'.* needs positon",
        ),
        ({'model_parameters.mass': -1}, 'model_parameters.mass: expected at least 1e-09 kg'),
        ({'position.measures': ['z', 'y']}, 'position.measures: expected names among'),
        ({'position.fields': ['a']}, 'position.fields: expected 2 fields, got 1'),
        ({'position.kind': 'sonar'}, "unknown kind 'sonar'"),
        ({'position.covariance_from': 'air'}, 'position.covariance_from: expected message'),
        ({'initial_std': [-1.0, 0.0, 1.0, 1.0]}, 'initial_std: expected zero or positive'),
        ({'rate': 'fast'}, "rate: expected a number, got 'fast'"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(values, says):
    with pytest.raises(ValueError, match=says) as error:
        scenario.build(values)
    assert '\n' not in str(error.value)


def test_values_reach_the_objects():
    built = scenario.build(
        {
            'model': 'mass_spring_damper',
            'model_parameters.mass': 2,
            'sensors': ['position'],
            'position.noise': 0.3,
            'state_cost': [2.0, 0.5, 0.5, 1.0],
        }
    )
    np.testing.assert_allclose(built.model.A, [[0.0, 1.0], [-1.0, -0.2]])
    assert list(built.sensors) == ['position']
    np.testing.assert_allclose(built.sensors['position'].sensor.covariance, [[0.09]])
    np.testing.assert_allclose(built.state_cost, [[2.0, 0.5], [0.5, 1.0]])


def test_every_option_has_a_meaning():
    for option in scenario.options({}).values():
        assert len(option.description.split()) > 1, option.name


class Own(Sensor):
    """A user's sensor, valid except for the change of a test."""

    def __init__(self, state, noise):
        self.output, self.covariance = Space(('y',), ('',)), variances('noise', noise, 1)

    def measure(self, x):
        return x[..., :1]


class WithoutMeasure(Sensor):
    def __init__(self, state, noise):
        self.output, self.covariance = Space(('y',), ('',)), variances('noise', noise, 1)


def own(**changes):
    return type('Own', (Own,), changes)


ReturnsNothing = own(measure=lambda self, x: None)
Raises = own(measure=lambda self, x: 1 / 0)
OneAtATime = own(measure=lambda self, x: np.array([x[0]]))
FlatJacobian = own(jacobian=lambda self, x: np.ones(4))
NotLinear = own(linear=True, measure=lambda self, x: x[..., :1] ** 2)


class Mass(Model):
    """A user's model, valid except for the change of a test."""

    state, input = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0]), axis=-1)

    def noise_density(self, x):
        return np.eye(2)


class FlatNoise(Mass):
    def noise_density(self, x):
        return np.ones(2)


class ShortDerivative(Mass):
    def derivative(self, x, u):
        return x[..., 1:]


class OneState(Mass):
    def derivative(self, x, u):
        return np.array([x[1], u[0]])


@pytest.mark.parametrize(
    ('kind', 'says'),
    [
        ('WithoutMeasure', 'position.kind: .*WithoutMeasure.*abstract'),
        ('ReturnsNothing', r'position.kind: its measure: expected the shape \(1,\), got \(\)'),
        ('Raises', 'position.kind: its measure fails: ZeroDivisionError: division by zero'),
        ('OneAtATime', r'measure of several states at once \(x\[..., 0\], not x\[0\]\): expected'),
        ('FlatJacobian', r'its jacobian: expected the shape \(1, 4\), got \(4,\)'),
        ('NotLinear', r'position.kind: its readings .* cannot have linear = True'),
        ('Own', 'velocity'),
    ],
)
def test_mistakes_in_a_sensor_of_ones_own_are_named(kind, says):
    values = {'position.kind': f'{__name__}:{kind}', 'position.noise': [0.1]}
    values['position.fields'] = ['pose.pose.position.x']
    if kind == 'Own':
        assert says in scenario.build(values).sensors
        return
    with pytest.raises(ValueError, match=says):
        scenario.build(values)


@pytest.mark.parametrize(
    ('model', 'says'),
    [
        ('FlatNoise', r'model: its noise_density: expected the shape \(2, 2\), got \(2,\)'),
        ('ShortDerivative', r'model: its derivative: expected the shape \(2,\), got \(1,\)'),
        (
            'OneState',
            r'model: its derivative of several states at once \(x\[..., 0\], not x\[0\]\)',
        ),
    ],
)
def test_mistakes_in_a_model_of_ones_own_are_named(model, says):
    assert scenario.build({'model': f'{__name__}:Mass'})
    with pytest.raises(ValueError, match=says):
        scenario.build({'model': f'{__name__}:{model}'})
