# SPDX-License-Identifier: Apache-2.0
"""A scenario after a change is the one that is built as a whole."""

import numpy as np
import pytest

from kalman_ros import scenario


def full(**given):
    return scenario.complete(given, scenario.options(given))


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('position.noise', [0.5, 0.5]),
        ('velocity.rate', 20.0),
        ('velocity.enabled', False),
        ('position.gate', 0.99),
        ('state_cost', [1.0, 2.0, 3.0, 4.0]),
        ('model_parameters.mass', 3.0),
    ],
)
def test_a_change_gives_what_a_build_does(name, value):
    values = full()
    changed = {**values, name: value}
    found = scenario.rebuild(scenario.assemble(values), changed, [name])
    assert repr(found) == repr(scenario.build(changed))


def test_no_change_is_the_same_object():
    built = scenario.build({})
    assert scenario.rebuild(built, full(), []) is built


def test_a_node_without_a_law_stays_without():
    values = scenario.complete({}, scenario.options({}, with_law=False))
    built = scenario.assemble(values, with_law=False)
    found = scenario.rebuild(built, values, ['model_parameters.mass'])
    assert found.law == ''
    np.testing.assert_array_equal(found.state_cost, np.zeros((4, 4)))


def test_a_wrong_value_is_refused_with_its_name():
    values = full()
    with pytest.raises(ValueError, match=r'position\.noise'):
        scenario.rebuild(
            scenario.assemble(values), {**values, 'position.noise': [0.1]}, ['position.noise']
        )
