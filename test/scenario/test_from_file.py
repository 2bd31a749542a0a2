# SPDX-License-Identifier: Apache-2.0
"""Parameter files that would take long to read are refused at once, with a reason."""

import re
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


@pytest.mark.slow
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
    taken = []
    for _ in range(3):  # a collection of garbage may take as long as that
        start = time.process_time()
        with pytest.raises(ValueError, match=says):
            from_file(path)
        taken.append(time.process_time() - start)
    assert min(taken) < 1.0


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


#: Words of a YAML file that PyYAML and the parser of ROS read differently, or nearly.
WORDS = (
    '1:2:3', '1_000', '0b1', '0o17', '2001-01-01', '1e3', '1.', '.5', '-.5e-3', '0x1F', '017',
    '08', '089.5', '.inf', '-.inf', '.nan', 'inf', 'nan', '~', 'null', 'yes', 'on', 'oN', '+5',
    '-0', '1e', '1.2.3', '=', '0x', '<<', '1e-310', '1e400', '1e-400', '0e-400', '-.nan', '+.inf',
    '9223372036854775807', '9223372036854775808', '0xffffffffffffffff', '2.3e-308',
)  # fmt: skip


def test_words_are_what_they_are_to_ros(tmp_path):
    """Compared with the parameters that rcl makes of the same file."""
    rclpy = pytest.importorskip('rclpy')
    path = tmp_path / 'words.yaml'
    lines = [f'    p{number}: {word}' for number, word in enumerate(WORDS)]
    path.write_text('\n'.join(['/**:', '  ros__parameters:', *lines]))
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', '--params-file', str(path)], context=context)
    try:
        node = rclpy.create_node(
            'reader', context=context, start_parameter_services=False,
            enable_rosout=False, automatically_declare_parameters_from_overrides=True,
        )  # fmt: skip
        theirs = [node.get_parameter(f'p{number}').value for number in range(len(WORDS))]
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    ours = [*from_file(path, 'plant').values()]
    assert list(map(repr, ours)) == list(map(repr, theirs))


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('!!float 1:2', "ROS reads no tags, 'tag:yaml.org,2002:float' in line 3"),
        ('!!python/name:os.system x', 'ROS reads no tags'),
    ],
)
def test_tags_are_refused(tmp_path, text, reason):
    path = tmp_path / 'mine.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    rate: {text}\n')
    with pytest.raises(ValueError, match=reason):
        from_file(path)


def test_a_merge_is_a_name_like_any_other(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters:\n    <<: {rate: 1.0}\n')
    assert from_file(path) == {'<<.rate': 1.0}


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (
            '/**:\n  ros__parameters: {a: 1}\n/**:\n  ros__parameters: {b: 1}\n',
            "'/**' stands twice",
        ),
        ('/**:\n  ros__parameters: {a: 1, a: 2}\n', "'a' stands twice in line 2"),
        ('/**:\n  ros__parameters: {[a]: 1}\n', 'expected a name in line 2'),
    ],
)
def test_a_name_stands_once(tmp_path, text, reason):
    """The parser of ROS merges some of these and takes the first or the last of others."""
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(reason)):
        from_file(path)


def test_names_are_texts_as_they_stand(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters: {no: 1, 010: 2, 1e5: 3, y: 4}\n')
    assert from_file(path) == {'no': 1, '010': 2, '1e5': 3, 'y': 4}
