# SPDX-License-Identifier: Apache-2.0
"""What a user of the Python functions writes in the place of a file and its parameters."""

from pathlib import Path

import pytest

from kalman_ros.pipeline import names
from kalman_ros.scenario import shipped


def test_the_first_belief_of_a_filter_has_two_names_in_a_file():
    with pytest.raises(ValueError, match='initial_estimate and initial_std, .inf for what is'):
        names.refuse({'model', 'initial'}, {'model', 'initialize'}, ())


@pytest.mark.parametrize(('given', 'kind'), [(['a.yaml', 'b.yaml'], 'list'), (3, 'int')])
def test_a_scenario_is_one_file(given, kind):
    with pytest.raises(ValueError, match=f'one file, and overrides, got a {kind}'):
        shipped.file(given)


def test_a_file_by_its_path(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('')
    assert shipped.file(path) == shipped.file(str(path)) == Path(path).resolve()
