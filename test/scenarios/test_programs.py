# SPDX-License-Identifier: Apache-2.0
"""The executables as a person meets them: what they say, how they end, what they leave."""

import json
import os
import re
import signal
import subprocess
import sys
from itertools import starmap
from pathlib import Path

import pytest
from commands import run_command
from thorough import mostly_thorough, thorough

pytest.importorskip('rclpy')

from kalman_ros.harness import executables
from kalman_ros.harness.domain import Domain
from kalman_ros.nodes.middleware.interruption import WATCHER
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file, sections

LOOP = ('plant', 'estimator', 'controller', 'monitor')
NODES = (*LOOP, 'microphone_array')


@pytest.fixture
def environment():
    domain = Domain()
    yield {**os.environ, 'ROS_DOMAIN_ID': str(domain.id)}
    domain.close()


def start(environment, name, *arguments):
    return subprocess.Popen(
        [str(executables.executable(name)), *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def finish(process, seconds=30):
    try:
        output, _ = process.communicate(timeout=seconds)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    return process.returncode, output


MISTAKES = [
    ('controller', ['-p', 'state_cost:=[1.0, 2.0]'], 'state_cost: expected 4 numbers'),
    ('monitor', ['-p', 'state_cost:=[1.0, 2.0]'], 'state_cost: expected 4 numbers'),
    ('plant', ['-p', 'position.dropout:=1.5'], 'position.dropout: expected 0 to 1, got 1.5'),
    ('estimator', ['-p', 'position.dropot:=0.5'], "did you mean 'position.dropout'?"),
    ('plant', ['-p', 'sensors:=position', '-p', 'position.dropout:=2.0'], 'position.dropout: exp'),
    ('estimator', ['-p', 'model:=turn_rate', '-p', 'state_cost:=[1.0]'], 'unknown parameter'),
    ('plant', ['-p', 'position.noise:=[-0.1, 0.1]'], 'position.noise: expected positive'),
    ('estimator', ['-p', 'model:=mass_sprin_damper'], "did you mean 'mass_spring_damper'?"),
    ('plant', ['-p', 'sede:=1'], "unknown parameter 'sede'; did you mean 'seed'?"),
    ('monitor', ['-p', 'position.nois:=[1.0, 1.0]'], "did you mean 'position.noise'?"),
    ('plant', ['-p', 'seed:=one'], "seed: expected a whole number, got 'one'"),
    ('estimator', ['-p', 'filter:=magic'], "unknown filter 'magic'"),
    ('estimator', ['-p', 'position.type:=geometry_msgs/Pos'], "has no message 'Pos'"),
    (
        'controller',
        ['-p', 'model_parameters.mass:=0.0'],
        'model_parameters.mass: expected at least',
    ),
    ('plant', ['--params-file', '/nowhere.yaml'], 'nowhere.yaml'),
    ('estimator', ['-p', 'sensors:=[position, position]'], 'sensors: expected each name once'),
    ('estimator', ['-p', 'position.kind:=liner'], "position.kind: unknown kind 'liner'"),
    (
        'estimator',
        [
            '-p',
            'state.type:=std_msgs/Float64MultiArray',
            '-p',
            "state.fields:=['data[0]', 'data[1]', 'data[2]', 'data[3]']",
        ],
        'state.type: expected a message with a header',
    ),
]


def test_arguments_that_ros_would_not_see_are_refused(environment):
    code, output = finish(start(environment, 'estimator', '--params-file', 'robot.yaml'))
    assert code == 1
    assert output == (
        "estimator: unknown argument '--params-file'; parameters stand behind --ros-args\n"
    )


@pytest.mark.parametrize(
    ('node', 'arguments', 'says'), [*MISTAKES[:3], *starmap(thorough, MISTAKES[3:])]
)
def test_a_mistake_is_one_line_and_an_exit_code(environment, node, arguments, says):
    code, output = finish(start(environment, node, '--ros-args', *arguments))
    assert code == 1
    assert says in output
    assert len(output.strip().splitlines()) == 1, output


@pytest.mark.parametrize('name', ['estimator', 'design'])
def test_too_little_address_space_is_one_line(name):
    """The libraries would fail in many ways, or loop for ever, deaf to signals."""
    process = subprocess.run(
        ['sh', '-c', 'ulimit -v 200000; exec "$0"', str(executables.executable(name))],
        capture_output=True, text=True, timeout=30,
    )  # fmt: skip
    assert process.returncode == 1
    assert process.stderr == (
        f'{name}: expected 1024 MiB of address space or more, got 195: '
        'raise the limit (ulimit -v)\n'
    )


def test_a_parameter_file_serves_the_whole_loop_and_a_typo_in_it_none(environment, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('/**:\n  ros__parameters:\n    position:\n      niose: [0.1, 0.1]\n')
    for node in LOOP:
        code, output = finish(start(environment, node, '--ros-args', '--params-file', str(path)))
        assert code == 1
        assert "unknown parameter 'position.niose'; did you mean 'position.noise'?" in output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('node', mostly_thorough(NODES, 'estimator'))
def test_a_signal_ends_a_node_cleanly_also_twice(environment, node, number):
    process = start(environment, node)
    _wait_for_node(environment, process, node)
    os.killpg(process.pid, number)
    os.killpg(process.pid, number)
    code, output = finish(process)
    assert code == 0, output
    assert 'Traceback' not in output


ENDED = """
import sys
from itertools import starmap
from importlib import import_module
from pathlib import Path

sys.argv = sys.argv[1:]
import_module(f'kalman_ros.nodes.{sys.argv[0]}.node').main()
print([path.read_text().strip() for path in Path('/proc/self/task').glob('*/comm')])
"""


@pytest.mark.parametrize('node', mostly_thorough(NODES, 'controller'))
def test_a_node_that_ended_leaves_no_thread_of_the_middleware(environment, node):
    # such a thread uses what the exit of the process destroys: a crash, once in some thousand
    process = subprocess.Popen(
        [sys.executable, '-c', ENDED, node],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    _wait_for_node(environment, process, node)
    assert any(name.startswith('dds.') for name in _threads(process))
    os.killpg(process.pid, signal.SIGTERM)
    code, output = finish(process)
    assert code == 0, output
    assert WATCHER in output
    # one that watches shared memory belongs to the process, and is joined at its exit
    assert 'dds.' not in output.replace('dds.shm.wdog', '')


def _wait_for_node(environment, process, name):
    """Wait until the node is on the graph, and its own process waits for signals."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(environment['ROS_DOMAIN_ID']))
    node = rclpy.create_node('watcher', context=context)
    try:
        for _ in range(600):
            if name in node.get_node_names() and WATCHER in _threads(process):
                return
            assert process.poll() is None
            rclpy.spin_once(node, executor=_executor(context), timeout_sec=0.05)
        raise AssertionError('the node did not come up')
    finally:
        node.destroy_node()
        context.try_shutdown()


def _threads(process):
    return [path.read_text().strip() for path in Path(f'/proc/{process.pid}/task').glob('*/comm')]


def _executor(context):
    from rclpy.executors import SingleThreadedExecutor

    return SingleThreadedExecutor(context=context)


def left_behind(name):
    """Return the command lines of processes that run an executable with this argument."""
    found = []
    for entry in Path('/proc').iterdir():
        if entry.name.isdigit():
            try:
                line = (entry / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
            except OSError:
                continue
            if name in line and '--params-file' in line:
                found.append(line)
    return found


def demo(environment, tmp_path, *arguments):
    return start(environment, 'demo', '--out', str(tmp_path / 'out'), *arguments)


def test_the_demo_passes_and_writes_its_results(environment, tmp_path):
    code, output = finish(demo(environment, tmp_path, '--duration', '12', '--seed', '1'), 90)
    assert code == 0, output
    assert re.search(r'PASS, (\d+) of \1 checks: The loop is stable', output)
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['passed']
    assert {check['name'] for check in summary['checks']} >= {'NEES / 4', 'cost J'}
    for name in ('states', 'errors', 'innovations', 'force'):
        assert (tmp_path / 'out' / f'{name}.png').stat().st_size > 10_000


@pytest.mark.thorough
def test_a_demo_is_drawn_in_motion(environment, tmp_path):
    code, output = finish(demo(environment, tmp_path, '--duration', '12', '--animate'), 200)
    assert code == 0, output
    assert (tmp_path / 'out' / 'animation.gif').read_bytes().startswith(b'GIF8')


@pytest.mark.thorough
def test_the_demo_fails_when_the_statistics_do_not_hold(environment, tmp_path):
    """The plant's tachometer is noisier than it says, by the plant's own section of the file."""
    path = tmp_path / 'liar.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    velocity.covariance_from: configuration\n'
        'estimator:\n  ros__parameters:\n    velocity.noise: [0.2, 0.2]\n'
    )
    code, output = finish(demo(environment, tmp_path, str(path), '--duration', '12'), 90)
    assert code == 1, output
    assert 'FAIL, ' in output
    assert 'theory and measurement disagree on' in output.replace('\n', ' ')
    assert 'NIS of velocity' in output
    assert 'suspect a velocity.noise that is too small' in ' '.join(output.split())


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['mass_spring'], "unknown scenario 'mass_spring'; did you mean 'mass_spring_damper'?"),
        (['-p', 'input_cost:=[0.0, 1.0]'], 'demo: input_cost: expected a positive definite'),
        (['-p', 'input_cost'], "demo: -p: expected NAME:=VALUE, got 'input_cost'"),
        (['-p', 'inptu_cost:=[1.0, 1.0]'], "unknown parameter 'inptu_cost'"),
        (['-p', 'filter:=ukff'], "unknown filter 'ukff'; did you mean 'ukf'?"),
        (['--duration', '1'], 'demo: duration: expected 6.9 s or more for a verdict, got 1'),
        (['--duration', 'nan'], 'demo: duration: expected 6.9 s or more for a verdict, got nan'),
        (
            ['cart_pole', '--duration', '-5'],
            'demo: duration: expected 1 s or more for a verdict, got -5',
        ),
    ],
)
def test_the_demo_says_what_is_wrong(tmp_path, arguments, says):
    code, _, err = run_command('demo', '--out', tmp_path / 'out', *arguments)
    assert code == 2
    assert says in err
    assert err.count('\n') == 1


@pytest.mark.parametrize('name', mostly_thorough(NODES, 'plant'))
def test_every_node_has_help(environment, name):
    arguments = ['--params-file', str(shipped.file('sound_tracker'))]
    code, output = finish(start(environment, name, '--help', '--ros-args', *arguments))
    assert code == 0
    assert output[output.index('usage: ') :].startswith(f'usage: {name} --ros-args [')
    assert "  model: 'bearing_tracker'  (name of the model" in output
    assert 'Traceback' not in output
    help = output[output.index('usage: ') :].splitlines()
    assert max(map(len, help)) <= 80


@pytest.mark.thorough
def test_a_node_that_does_not_start_by_itself_has_help(environment):
    arguments = ['--help', '--ros-args', '-p', 'autostart:=false', '-p', 'window:=2.0']
    code, output = finish(start(environment, 'estimator', *arguments))
    assert code == 0
    assert '  window*: 2.0' in output


def test_the_help_of_the_estimator_is_about_the_estimator(environment):
    code, output = finish(start(environment, 'estimator', '--help'))
    help = output[output.index('usage: ') :].splitlines()
    assert code == 0 and len(help) < 80
    for foreign in ('dropout', 'state_cost', 'law', 'actuator', 'input_limit'):
        assert foreign not in output
    for own in ('SENSOR.noise*: position [0.05, 0.05]; velocity', 'window*: 1.0', "filter: 'kf'"):
        assert own in output


@pytest.mark.thorough
def test_help_explains_a_feature_that_is_used_and_only_names_another(environment):
    unused = 'Not used, all at their defaults (docs/reference/parameters.md):\n'
    _, output = finish(start(environment, 'estimator', '--help'))
    listed = output[output.index(unused) :]
    assert '\n  frames: input.convention, frame, input.mount.rotation, tf, translation,' in listed
    assert 'SENSOR.frame:' not in output
    one = ['--help', '--ros-args', '-p', 'velocity.frame:=base_link']
    _, output = finish(start(environment, 'estimator', *one))
    assert "SENSOR.frame: position ''; velocity 'base_link'  (frame of the" in output
    assert "SENSOR.convention: 'enu'  (axes of" in output and 'frames: ' not in output


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        (
            '/**:\n  a: 1\n    b: 2\n',
            'not YAML: mapping values are not allowed in this context in line 3',
        ),
        ('a: [1\n', 'not YAML: did not find expected'),
        ('[1, 2]\n', 'not a ROS parameter file: expected NODE: ros__parameters:'),
        ('/**: {model: linear}\n', 'not a ROS parameter file: expected NODE: ros__parameters:'),
        ('else: {ros__parameters: {rate: 50.0}}\n', 'no section is for one of (/**,'),
        ('# nothing\n', 'no section is for one of (/**,'),
        (
            '/**: {ros__parameters: {rate: 50.0}}\ncontroler: {ros__parameters: {a: 1}}\n',
            "no node is named 'controler'; did you mean 'controller'?",
        ),
        ('/**: {ros__parameters: {gps: {measures: [x, y]}}}\n', "measures: write 'y' in quotes"),
        ('/**: [1, 2]\n', 'not a ROS parameter file: expected NODE: ros__parameters:'),
    ],
)
def test_a_file_that_is_no_parameter_file_is_one_line(tmp_path, text, says):
    path = tmp_path / 'robot.yaml'
    path.write_text(text)
    with pytest.raises(ValueError, match='^robot.yaml: ') as raised:
        sections(path)
        from_file(path, 'plant')
    assert says in str(raised.value)
    assert '\n' not in str(raised.value)


def test_sections_of_other_nodes_are_theirs(tmp_path):
    path = tmp_path / 'robot.yaml'
    names = '/robot/estimator', 'estimator_2', 'my_controller', 'slam_toolbox', 'planner'
    path.write_text(''.join(f'{name}: {{ros__parameters: {{rate: 50.0}}}}\n' for name in names))
    assert 'slam_toolbox' in sections(path)


@pytest.mark.thorough
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_running(environment, tmp_path, number):
    path = tmp_path / f'only_here_{number}.yaml'
    path.write_text('/**:\n  ros__parameters:\n    rate: 100.0\n')
    process = demo(environment, tmp_path, str(path), '--duration', '1000')
    for _ in range(3000):
        if len(left_behind(path.name)) >= 4:
            break
        assert process.poll() is None
    process.send_signal(number)
    code, output = finish(process)
    assert code in (130, 143, -9), output
    assert 'Traceback' not in output
    for _ in range(2000):
        if not left_behind(path.name):
            break
    assert left_behind(path.name) == []
