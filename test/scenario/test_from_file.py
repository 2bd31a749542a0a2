# SPDX-License-Identifier: Apache-2.0
"""Parameter files that would take long to read are refused at once, with a reason."""

import time

import pytest

from kalman_ros import scenario
from kalman_ros.scenario.parameter_files import from_file, overrides

HEAD = '/**:\n  ros__parameters:\n'


def bomb():
    """Return a file of a few lines whose aliases stand for 9**12 numbers."""
    lines = ['    a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]']
    for level in range(1, 12):
        inner = ', '.join([f'*a{level - 1}'] * 9)
        lines.append(f'    a{level}: &a{level} [{inner}]')
    return '\n'.join(lines)


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        (bomb(), r"mine.yaml: ROS reads no aliases, '\*a0' in line 4"),
        (f'    initial_std: [{"0.5, " * 250_000}]', 'mine.yaml: expected at most 1000000 bytes'),
        (f'    initial_std: [{"1," * 250_000}]', 'expected at most 10000 values in line 3'),
        (f'    initial_std: {"[" * 5000}', 'mine.yaml: expected at most 20 levels in line 3'),
    ],
)
def test_a_file_that_would_take_long_is_refused_within_a_second(text, says, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(HEAD + text + '\n')
    start = time.process_time()
    with pytest.raises(ValueError, match=says):
        from_file(path)
    assert time.process_time() - start < 1.0


def test_a_parameter_of_the_command_line_is_read_by_the_same_rules():
    with pytest.raises(ValueError, match='-p: expected NAME:=VALUE'):
        overrides([f'rate:={"[" * 5000}'])


def test_a_number_beyond_64_bits_is_refused():
    with pytest.raises(ValueError, match='rate: expected a number of at most 64 bits'):
        scenario.build({'rate': 10**400})


def test_a_long_value_is_quoted_by_its_beginning():
    with pytest.raises(ValueError, match='rate: expected a number') as raised:
        scenario.build({'rate': [[1] * 100] * 100})
    assert len(str(raised.value)) < 2500


def test_a_deviation_without_a_square_is_refused():
    with pytest.raises(ValueError, match='initial_std: the square'):
        scenario.build({'initial_std': [1e200] * 4})
