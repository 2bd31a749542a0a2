# SPDX-License-Identifier: Apache-2.0
"""Why a node refuses what it is configured with: one short line that names the parameter."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.nodes.middleware.managed import reason
from kalman_ros.nodes.middleware.topics import check


def test_a_reason_that_quotes_a_long_value_is_short():
    found = reason(ValueError(f"law: expected lqr, got '{'a' * 100_000}'"))
    assert len(found) <= 500
    assert found.startswith("law: expected lqr, got 'aaa")


@pytest.mark.parametrize('topic', ['{x}', 'a' * 300, 'a b', ''])
@pytest.mark.parametrize('name', ['state', 'input', 'position'])
def test_what_cannot_be_a_topic_is_refused_by_the_name_of_its_parameter(name, topic):
    built = scenario.build({f'{name}.topic': topic})
    with pytest.raises(ValueError, match=f'^{name}.topic: expected the name of a topic'):
        check(built, 'controller', '/robot')


@pytest.mark.parametrize('name', ['state_cost', 'input_cost'])
def test_a_weight_too_large_for_its_eigenvalues_is_named(name):
    size = 4 if name == 'state_cost' else 2
    with pytest.raises(ValueError, match=f'^{name}: '):
        scenario.build({name: [1e308] * size})


def test_what_is_quoted_cannot_break_the_line():
    found = reason(ValueError("law: expected lqr, got 'a\n\x1b[2Jé\x85\ud800'"))
    assert found == r"law: expected lqr, got 'a\n\x1b[2Jé\x85\ud800'"
