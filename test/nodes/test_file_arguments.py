# SPDX-License-Identifier: Apache-2.0
"""What ``ros2 param dump`` writes of a node, that node reads back, by either way there is."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from thorough import mostly_thorough

pytest.importorskip('rclpy')

import rclpy
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file

from kalman_ros.core import DesignError
from kalman_ros.harness.domain import Domain
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.middleware.file_arguments import hint, readable
from kalman_ros.nodes.middleware.parameters import given
from kalman_ros.nodes.middleware.runtime import _warn_of_files
from kalman_ros.nodes.plant.node import PlantNode

CONFIG = Path(__file__).parents[2] / 'config'
SCENARIOS = sorted(path.stem for path in CONFIG.glob('*.yaml'))
NODES = {'plant': PlantNode, 'estimator': EstimatorNode, 'controller': ControllerNode}


@pytest.fixture
def start():
    """Build a node with arguments, in a private domain; the one before it is destroyed."""
    domain, built = Domain(), []

    def end():
        while built:
            built.pop().destroy_node()
            rclpy.try_shutdown()

    def start(name, *arguments):
        end()
        with readable(['node', '--ros-args', *arguments]) as found:
            rclpy.init(args=found, domain_id=domain.id)
        try:
            built.append(NODES[name]())
        except BaseException:
            rclpy.try_shutdown()
            raise
        return built[-1]

    yield start
    end()
    domain.close()


def dump(node, path):
    """Write the parameters of a node as ``ros2 param dump`` does."""
    tree = {}
    for name, parameter in node.get_parameters_by_prefix('').items():
        *folders, last = name.split('.')
        place = tree
        for folder in folders:
            place = place.setdefault(folder, {})
        value = parameter.value
        place[last] = value if isinstance(value, (bool, int, float, str)) else list(value)
    full = {node.get_fully_qualified_name(): {'ros__parameters': tree}}
    path.write_text(yaml.dump(full, default_flow_style=False))


@pytest.mark.slow
@pytest.mark.parametrize('scenario', mostly_thorough(SCENARIOS, 'cart_pole', 'robot_3d'))
def test_what_is_dumped_is_loaded(scenario, start, tmp_path):
    config = CONFIG / f'{scenario}.yaml'
    for name in NODES:
        try:
            node = start(name, '--params-file', str(config))
        except DesignError:  # a model without an input has no controller
            assert name == 'controller'
            continue
        path, before = tmp_path / f'{name}.yaml', given(node)
        dump(node, path)
        # as `ros2 param load` does
        target = [node.get_fully_qualified_name()]
        for message in parameter_dict_from_yaml_file(str(path), target_nodes=target).values():
            result = node.set_parameters_atomically([Parameter.from_parameter_msg(message)])
            assert result.successful, (message, result.reason)
        assert given(node) == before
        assert given(start(name, '--params-file', str(path))) == before


def test_a_read_only_value_is_kept_and_no_other_taken(start):
    node = start('plant')
    for name, same, other in (('seed', 0, 1), ('rate', '100', 50.0), ('sensors', None, ['x'])):
        if same is not None:
            assert node.set_parameters_atomically([Parameter(name, value=same)]).successful
        refused = node.set_parameters_atomically([Parameter(name, value=other)])
        assert (refused.successful, 'read-only' in refused.reason) == (False, True)


@pytest.mark.slow
def test_an_empty_list_of_sensors_is_one(start, tmp_path):
    path = tmp_path / 'none.yaml'
    path.write_text('/**:\n  ros__parameters:\n    sensors: []\n')
    for arguments in (('--params-file', str(path)), ('-p', 'sensors:=[]')):
        for name in NODES:
            assert not start(name, *arguments).scenario.sensors


def test_a_word_that_ros_reads_as_true_gets_a_hint(start):
    with pytest.raises(ValueError, match='frame: expected a word, got True; write .* in quotes'):
        start('plant', '-p', 'frame:=y')
    with pytest.raises(Exception, match="Value type 'bool'") as refused:
        start('plant', '-p', 'position.measures:=[x, y]')
    assert 'write such words in quotes' in hint(str(refused.value))


@pytest.mark.parametrize('numbers', ['0, 0.5', '0.5, 1'])
def test_numbers_of_two_types_get_a_hint(start, tmp_path, numbers):
    file = tmp_path / 'robot.yaml'
    file.write_text(f'/**: {{ros__parameters: {{position.noise: [{numbers}]}}}}\n')
    with pytest.raises(Exception, match='Value type') as refused:
        start('plant', '--params-file', str(file))
    assert hint(str(refused.value)).endswith('write 0.0 for 0 beside 0.5')


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('a: [' + '0, ' * 250_000 + '0]', 'at most 10000 values'),
        ('a: ' + '[' * 50 + ']' * 50, 'at most 20 levels'),
        ('#' * 2_000_000, 'at most 1000000 bytes'),
    ],
)
def test_a_file_that_would_take_minutes_is_refused(text, says, tmp_path):
    file = tmp_path / 'large.yaml'
    file.write_text(text)
    arguments = ['node', '--ros-args', '--params-file', str(file)]
    with pytest.raises(ValueError, match=f"'large.yaml': .*{says}"), readable(arguments):
        pass


def test_a_pipe_is_read_once():
    text = '/**:\n  ros__parameters: {model: cart_pole}\n'
    reading, writing = os.pipe()
    with os.fdopen(writing, 'w') as file:
        file.write(text)
    with readable(['node', '--ros-args', '--params-file', f'/dev/fd/{reading}']) as found:
        assert Path(found[-1]).read_text() == text
    os.close(reading)


@pytest.mark.parametrize(
    ('section', 'arguments', 'warned'),
    [
        ('/**', (), False), ('estimator', (), False), ('ekf_filter_node', (), True),
        ('ekf_filter_node', ('-p', 'publish_rate:=50.0'), True), (None, (), False),
    ],
)  # fmt: skip
def test_a_file_without_a_section_for_the_node_is_noticed(
    start, tmp_path, monkeypatch, section, arguments, warned
):
    file, said = tmp_path / 'robot.yaml', []
    file.write_text(f'{section}:\n  ros__parameters:\n    model: cart_pole\n')
    argv = [*arguments, *(() if section is None else ('--params-file', str(file)))]
    node = start('estimator', *argv)
    monkeypatch.setattr(node, 'get_logger', lambda: SimpleNamespace(warning=said.append))
    _warn_of_files(node, argv)
    assert bool(said) is warned
    if said:
        assert said[0].startswith('no section of the parameter file is for /estimator: it has the')


@pytest.mark.parametrize(
    ('argument', 'warned'),
    [
        ('publish_rate:=50.0', True), ('publish_rate:=20', False), ('frame:=odom', True),
        ('frame:=base', False), ('sensors:=[position]', True), ('sensors:=[]', False),
        ('estimator:publish_rate:=50.0', False), ('rate:=100.0', False),
    ],
)  # fmt: skip
def test_an_argument_that_the_section_of_the_node_hides_is_named(
    start, tmp_path, monkeypatch, argument, warned
):
    """ROS takes the section of the node, wherever the argument for every node stands."""
    file, said = tmp_path / 'robot.yaml', []
    own = "{publish_rate: 20.0, frame: base, sensors: ['']}"
    file.write_text(
        f'/**: {{ros__parameters: {{rate: 50.0}}}}\nestimator:\n  ros__parameters: {own}\n'
    )
    argv = ['--params-file', str(file), '-p', argument]
    node = start('estimator', *argv)
    monkeypatch.setattr(node, 'get_logger', lambda: SimpleNamespace(warning=said.append))
    _warn_of_files(node, argv)
    name = argument.partition(':=')[0]
    assert [words.partition(':')[0] for words in said] == warned * [name]
    if argument == 'estimator:publish_rate:=50.0':
        assert node.get_parameter('publish_rate').value == 50.0
    if argument == 'rate:=100.0':  # is in the section for every node, which the argument replaces
        assert node.get_parameter('rate').value == 100.0
