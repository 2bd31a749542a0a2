# SPDX-License-Identifier: Apache-2.0
"""Imports run downward only, and what is slow is loaded only by those who use it."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from thorough import mostly_thorough

ROOT = Path(__file__).parents[1] / 'kalman_ros'
BELOW = {
    'linear': set(),
    'core': {'linear'},
    **{
        library: {'linear', 'core'}
        for library in (
            'models',
            'acoustics',
            'sensors',
            'compiled',
            'estimators',
            'control',
            'codecs',
        )
    },
}
BELOW['scenario'] = {'linear', 'core', 'models', 'sensors', 'compiled', 'estimators', 'control'}
BELOW['simulation'] = {*BELOW['scenario'], 'scenario', 'acoustics'}
BELOW['embedded'] = {*BELOW['simulation'], 'simulation'}
BELOW['analysis'] = {*BELOW['simulation'], 'simulation'}
BELOW['report'] = {*BELOW['analysis'], 'analysis'}
BELOW['arrays'] = {*BELOW['report'], 'report', 'embedded'}
BELOW['pipeline'] = {*BELOW['analysis'], 'analysis', 'codecs', 'embedded'}
BELOW['bags'] = {*BELOW['pipeline'], 'pipeline'}
BELOW['nodes'] = {*BELOW['pipeline'], 'pipeline'}
BELOW['harness'] = {*BELOW['nodes'], 'nodes', 'bags'}
BELOW['live'] = {*BELOW['harness'], 'harness'}
BELOW['programs'] = {*BELOW['live'], 'live', 'report', 'embedded'}
ROS = ('rclpy', '_msgs', 'std_srvs', 'builtin_interfaces', 'ament_index_python')
WITH_ROS = {'codecs', 'bags', 'nodes', 'harness', 'live', 'programs'}
FILES = sorted(ROOT.rglob('*.py'))


def imports(path):
    """Yield the full name of everything that a file imports."""
    package = ('kalman_ros', *path.relative_to(ROOT).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = '.'.join((*base, *filter(None, [node.module])))
            yield module
            if module == 'kalman_ros':
                yield from (f'kalman_ros.{alias.name}' for alias in node.names)


def upward(layer, name):
    """Return whether a file of a layer must not import this name."""
    top, *parts = name.split('.')
    if top == 'kalman_ros' and parts:
        return parts[0] != layer and parts[0] not in BELOW[layer]
    if any(word in top for word in ROS):
        return layer not in WITH_ROS
    return layer == 'core' and top in ('scipy', 'matplotlib')


@pytest.mark.slow
def test_imports_run_downward():
    wrong = []
    for path in FILES:
        layer = path.relative_to(ROOT).parts[0]
        if not layer.endswith('.py'):
            wrong += [f'{path}: {name}' for name in imports(path) if upward(layer, name)]
    assert wrong == []


@pytest.mark.parametrize(
    ('layer', 'name', 'expected'),
    [
        ('core', 'kalman_ros.linear.kernels', False),
        ('linear', 'kalman_ros.core', True),
        ('models', 'kalman_ros.sensors', True),
        ('core', 'scipy.linalg', True),
        ('linear', 'scipy.linalg', False),
        ('simulation', 'rclpy.node', True),
        ('simulation', 'std_msgs.msg', True),
        ('codecs', 'std_msgs.msg', False),
    ],
)
def test_an_import_that_runs_upward_is_seen(layer, name, expected):
    assert upward(layer, name) is expected


#: What rclpy does not document; one module alone touches it.
PRIVATE = re.compile(
    r'rclpy\.impl|\b_rclpy\b|\.handle\b|\._service_change_state|\._state_machine|_callback_type'
)


def test_one_module_touches_what_rclpy_does_not_document():
    found = {
        path.relative_to(ROOT).as_posix() for path in FILES if PRIVATE.search(path.read_text())
    }
    assert found == {'nodes/middleware/private.py'}


def test_every_layer_is_known():
    folders = {path.name for path in ROOT.iterdir() if (path / '__init__.py').exists()}
    assert folders == set(BELOW)


@pytest.mark.slow
@pytest.mark.parametrize(
    'node',
    mostly_thorough(
        ['plant', 'estimator', 'controller', 'monitor', 'markers', 'microphone_array'],
        'estimator', 'controller',
    ),
)  # fmt: skip
def test_a_node_loads_nothing_slow(node):
    pytest.importorskip('rclpy')
    slow = ['matplotlib', 'scipy.signal', 'scipy.stats', 'filterpy', 'control', 'rich', 'rosbags']
    code = (
        f'import sys, kalman_ros.nodes.{node}.node; '
        f'print([name for name in {slow} if name in sys.modules])'
    )
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert out.stdout.strip() == '[]', out.stdout + out.stderr
