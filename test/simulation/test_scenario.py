# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.simulation import scenario


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
        ({'initial_std': [0.0, 1.0, 1.0, 1.0]}, 'initial_std: expected positive'),
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
