# SPDX-License-Identifier: Apache-2.0
"""Users' models and sensors: valid ones load, errors are named in one line."""

import sys
from pathlib import Path

import numpy as np
import pytest

from kalman_ros import scenario

PACKAGE = Path(__file__).parents[1] / 'packages' / 'strange_sensors'
ONE = {
    'sensors': ['place'],
    'place.type': 'sensor_msgs/JointState',
    'place.fields': ['position[x]'],
    'place.noise': [0.1],
}


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    yield
    for name in [name for name in sys.modules if name.startswith('strange_sensors')]:
        del sys.modules[name]


def own(name):
    return f'strange_sensors.mistakes:{name}'


def test_a_strangers_sensor_loads_with_its_options():
    values = {
        **ONE,
        'model': 'constant_velocity',
        'place.kind': 'strange_sensors.beacon:Beacon',
        'place.height': 0.0,
    }
    known = scenario.options(values)
    assert known['place.place'].default == [5.0, -3.0]
    assert known['place.height'].description == 'of the beacon above the robot [m]'
    built = scenario.build(values)
    sensor = built.sensors['place'].sensor
    x = np.array([8.0, 1.0, 0.0, 0.0])
    at = dict(zip(built.model.state.names, x))
    assert sensor.measure(x) == pytest.approx(np.hypot(at['x'] - 5.0, at['y'] + 3.0))
    assert sensor.jacobian(x).shape == (1, 4)


@pytest.mark.parametrize(
    ('model', 'says'),
    [
        ('OneState', 'its derivative of several states at once (x[..., 0], not x[0])'),
        ('FirstAxis', 'its derivative of several states at once (x[..., 0], not x[0])'),
        ('StackedFirst', 'its derivative of several states at once (x[..., 0], not x[0])'),
        ('Changes', 'its derivative fails: ValueError: output array is read-only'),
        ('IsComplex', 'its derivative: expected real numbers at initial_estimate'),
        ('NoTable', "NoTable' cannot be built: FileNotFoundError: no table.csv"),
        ('TuplePoint', 'its equilibrium: expected OperatingPoint(state, input)'),
        ('WrongPoint', "its equilibrium's state: expected the shape (2,), got (3,)"),
        ('ListPoint', "its equilibrium's state: expected an array, got [0.0, 0.0]"),
        ('Fast', "its max_step: expected a number of seconds, got 'fast'"),
        ('Still', 'its max_step: expected a number of seconds, got 0.0'),
        ('NoSpace', 'its state: expected a Space, got None'),
    ],
)
def test_what_is_wrong_with_a_model_is_named(model, says):
    with pytest.raises(ValueError) as refused:
        scenario.build({**ONE, 'model': own(model), 'place.kind': own('Place')})
    assert says in str(refused.value)
    assert '\n' not in str(refused.value)


def test_a_model_that_no_longer_builds_with_its_parameters_says_why():
    values = {**ONE, 'model': own('NoGear'), 'place.kind': own('Place')}
    assert scenario.build(values)
    with pytest.raises(
        ValueError, match='model_parameters: the model cannot be built: KeyError: 2'
    ):
        scenario.build({**values, 'model_parameters.gear': 2})


@pytest.mark.parametrize(
    ('sensor', 'says'),
    [
        ('NotANumber', 'its measure: expected finite numbers at initial_estimate, got [nan]'),
        ('NoConstructor', '__init__(self, state, noise'),
        ('OwnConstructor', '__init__(self, state, noise'),
        ('NoOutput', 'its output: expected Space, which its __init__ sets, got None'),
        ('Breaks', "KeyError: 'no such state'"),
        ('NoMeasure', 'measure'),
        ('NoSensor', 'is not a Sensor class'),
    ],
)
def test_what_is_wrong_with_a_sensor_is_named(sensor, says):
    with pytest.raises(ValueError) as refused:
        scenario.build({**ONE, 'model': own('Cart'), 'place.kind': own(sensor)})
    assert str(refused.value).startswith('place.kind: ')
    assert says in str(refused.value)
    assert '\n' not in str(refused.value)


def test_numbers_of_numpy_are_numbers():
    given = {
        **ONE,
        'model': own('Cart'),
        'place.kind': own('Place'),
        'place.noise': np.array([0.1]),
        'rate': np.int64(50),
        'model_parameters.mass': np.float32(4.0),
        'model_parameters.gains': [np.float64(1.0), 2],
        'place.enabled': np.bool_(True),
    }
    built = scenario.build(given)
    assert (built.rate, built.model.mass, built.model.wheels) == (50.0, 4.0, 4)
    assert built.model.gains == [1.0, 2.0]
    assert scenario.options(given)['model_parameters.mass'].default == 2.0


def test_no_sensors_are_allowed():
    assert scenario.build({'sensors': []}).sensors == {}


def test_a_linear_model_needs_no_units():
    chain = {
        'model': 'linear',
        'model_parameters.states': ['a', 'b', 'c'],
        'model_parameters.A': [-1.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, -1.0],
        'model_parameters.B': [0.0, 0.0, 0.0, 0.0, 1.0, 1.0],
        'model_parameters.inputs': ['u', 'w'],
        'model_parameters.noise_density': [0.1, 0.1, 0.1],
        'sensors': [''],
    }
    model = scenario.build(chain).model
    assert (model.state.units, model.input.units) == (('', '', ''), ('', ''))
    with pytest.raises(ValueError, match='model_parameters.state_units: expected 3 units, got 1'):
        scenario.build({**chain, 'model_parameters.state_units': ['m']})
