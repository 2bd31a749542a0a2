# SPDX-License-Identifier: Apache-2.0
"""What the nodes may publish and receive, where, and what no file or message can make them do."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import NodeNameNonExistentError
from sensor_msgs.msg import JointState, TimeReference

from kalman_ros.harness import Run, executables
from kalman_ros.harness.process import NodeProcess, isolated

POLICY = Path(__file__).parents[2] / 'config' / 'sros2_policy.xml'
#: How the graph calls what the policy calls a list with an attribute.
WAYS = {
    ('topics', 'publish'): 'publisher',
    ('topics', 'subscribe'): 'subscriber',
    ('services', 'reply'): 'service',
    ('services', 'request'): 'client',
}


def allowed():
    """Return the full names that the policy allows, by node and way."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    found = {}
    for enclave in root.findall('enclaves/enclave'):
        (profile,) = enclave.findall('profiles/profile')
        node = profile.get('node')
        assert enclave.get('path') == f'/{node}'
        for (kind, attribute), way in WAYS.items():
            names = found.setdefault((node, way), set())
            for block in profile.findall(f'{kind}[@{attribute}="ALLOW"]'):
                for item in block:
                    name = item.text
                    if name.startswith('~'):
                        name = f'/{node}/{name[1:]}'
                    names.add(name if name.startswith('/') else f'/{name}')
    return found


def of_node(graph, way, node):
    """Return the names of what a node has, as far as it has been discovered."""
    try:
        found = getattr(graph, f'get_{way}_names_and_types_by_node')(node, '/')
    except NodeNameNonExistentError:  # not yet
        return set()
    return {name for name, _ in found}


def test_the_policy_allows_what_the_nodes_do_and_no_more():
    overrides = {'use_sim_time': True}
    # a plant in lockstep listens to the estimate when an answer is late
    with Run(overrides=overrides, only={'plant': {'wait_for_estimate': True}}) as run:
        wanted = allowed()
        assert {node for node, _ in wanted} == set(run.processes)
        for (node, way), names in wanted.items():
            said = partial(of_node, run.node, way, node)
            run.wait(
                lambda s=said, n=names: s() == n,
                60.0,
                lambda s=said, n=names, of=(node, way): f'{of}: {s() ^ n}',
            )


def test_the_policy_is_installed():
    path = executables.prefix() / 'share' / executables.PACKAGE / 'config' / POLICY.name
    assert path.read_text() == POLICY.read_text()


@pytest.mark.parametrize('key', ['rate', 'model', 'position.noise'])
@pytest.mark.parametrize(
    'program', mostly_thorough(['plant', 'estimator', 'demo', 'design'], 'estimator')
)
def test_a_parameter_file_runs_nothing(tmp_path, program, key):
    made, path = tmp_path / 'made', tmp_path / 'evil.yaml'
    call = f'!!python/object/apply:os.system ["touch {made}"]'
    path.write_text(f'/**:\n  ros__parameters:\n    {key}: {call}\n')
    arguments = ['--ros-args', '--params-file', str(path)]
    if program in ('demo', 'design'):
        arguments = [str(path), '--out', str(tmp_path)]
    done = subprocess.run(
        [str(executables.executable(program)), *arguments],
        env=isolated(0),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode in (1, 2)
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert done.stderr.startswith(f'{program}: ')
    assert not made.exists()


#: Runs a node and prints every file that it opens with "evil" in its name.
_AUDITED = """
import sys
def tell(event, arguments):
    if event in ('open', 'import', 'os.listdir', 'os.mkdir') and 'evil' in str(arguments[:1]):
        print('touched', event, arguments[0], flush=True)
sys.addaudithook(tell)
try:
    open('/evil/control')
except OSError:
    pass
from kalman_ros.nodes.estimator import node as estimator
estimator.main()
"""


def test_names_in_messages_are_never_paths(tmp_path):
    """Readings, an initial pose and ticks, full of paths, are just read."""
    evil = '../../../tmp/evil'
    fields = {
        'position.topic': 'named',
        'position.type': 'sensor_msgs/JointState',
        'position.fields': ['position[a]', 'position[b]'],
    }
    fields['lockstep'] = True
    with Run(nodes=('plant',)) as run:
        command = [sys.executable, '-c', _AUDITED, '--ros-args']
        for key, value in fields.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ['-p', f'{key}:={text}']
        process = NodeProcess('audited', command, isolated(run.domain), tmp_path / 'log')
        try:
            create = run.node.create_publisher
            position = create(JointState, 'named', 10)
            pose = create(PoseWithCovarianceStamped, 'initialpose', 10)
            tick = create(TimeReference, 'tick', 10)
            for publisher in (position, pose, tick):
                heard = lambda: publisher.get_subscription_count()  # noqa: B023, E731
                run.wait(heard, 20.0, process.output)
            reading = JointState(name=[evil, 'a', 'b', f'{evil}/b'], position=[1.0, 2.0, 3.0, 4.0])
            start = PoseWithCovarianceStamped()
            start.pose.covariance[0] = start.pose.covariance[7] = 1.0
            turn = TimeReference(source=f'{evil},named,{evil}.py')
            for message, publisher in ((reading, position), (start, pose), (turn, tick)):
                message.header.frame_id = evil
                message.header.stamp.sec = 5
                publisher.publish(message)
            said = "initialpose: expected frame 'map', or one with a transform, got"
            run.wait(lambda: said in process.output(), 60.0, process.output)
            run.spin(0.5)
            assert process.exit_code is None
            touched = [line for line in process.output().splitlines() if 'touched' in line]
            assert touched == ['touched open /evil/control']
        finally:
            process.stop()


def addresses(pid):
    """Return the local addresses of the UDP sockets of a process, as Linux writes them."""
    links = [os.readlink(fd) for fd in Path(f'/proc/{pid}/fd').iterdir() if fd.exists()]
    rows = [row.split() for row in Path(f'/proc/{pid}/net/udp').read_text().splitlines()[1:]]
    return {row[1].partition(':')[0] for row in rows if f'socket:[{row[9]}]' in links}


@pytest.mark.parametrize('lockstep', [True, False])
def test_what_the_harness_starts_stays_on_this_machine(lockstep):
    with Run(nodes=('estimator',), lockstep=lockstep) as run:
        pid = run.processes['estimator'].pid
        environment = Path(f'/proc/{pid}/environ').read_bytes().split(b'\0')
        if lockstep:
            assert b'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST' in environment
        else:
            assert addresses(pid) == {'0100007F'}
        assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
