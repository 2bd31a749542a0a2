# SPDX-License-Identifier: Apache-2.0
"""What package.xml names is enough: a workspace with no other library builds and runs."""

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from kalman_ros import entry

ROOT = Path(__file__).parents[1]
#: What a key of rosdep is as a wheel; one wheel has all messages. Some need none.
WHEELS = {
    'rclpy': 'ros-jazzy-rclpy[fastrtps]', 'python3-yaml': 'PyYAML',
    **dict.fromkeys(['ament_index_python', 'rosidl_generator_py', 'tf2_msgs'], ''),
}  # fmt: skip
MESSAGES = 'ros-jazzy-common-interfaces'
BUILD = ['colcon-common-extensions', 'setuptools']
#: Libraries that the tests use, and no robot needs.
FOREIGN = ['hypothesis', 'filterpy', 'control', 'casadi', 'rosbags', 'foxglove']

pytestmark = [pytest.mark.thorough, pytest.mark.slow, pytest.mark.executables]


def wheels():
    """Return the requirements of the keys that package.xml names for running."""
    tree = ElementTree.parse(ROOT / 'package.xml')
    names = {*BUILD}
    for each in tree.iter('exec_depend'):
        key = each.text
        python = key.removeprefix('python3-') if key.startswith('python3-') else MESSAGES
        names.add(WHEELS.get(key, python))
    lines = [
        line for line in (ROOT / '.ci' / 'requirements.txt').read_text().splitlines()
        if re.split(r'[=;]', line)[0] in names
    ]  # fmt: skip
    assert {re.split(r'[=;]', line)[0] for line in lines} == names - {''}
    return lines


@pytest.fixture(scope='module')
def ran(tmp_path_factory):
    """Return a function that runs a command in a workspace with those wheels alone."""
    folder = tmp_path_factory.mktemp('workspace')
    source = folder / 'src' / 'kalman_ros'
    made = shutil.ignore_patterns('.git', '.venv*', 'build', 'install', 'log', 'out', '*cache*')
    shutil.copytree(ROOT, source, ignore=made)
    subprocess.run([sys.executable, '-m', 'venv', folder / 'venv'], check=True, timeout=120)
    (folder / 'wheels.txt').write_text('\n'.join(wheels()) + '\n')
    install = [folder / 'venv' / 'bin' / 'pip', 'install', '-q', '--prefer-binary']
    subprocess.run([*install, '-r', 'wheels.txt'], cwd=folder, check=True, timeout=600)

    def run(command, seconds=60):
        line = f'. venv/bin/activate; [ ! -d install ] || . install/setup.bash; {command}'
        return subprocess.run(
            ['env', '-i', f'HOME={folder}', 'PATH=/usr/bin:/bin', 'bash', '-c', line],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=seconds,
        )

    built = run('python -m colcon build --base-paths src', 300)
    assert built.returncode == 0, built.stderr
    return run


def test_only_what_is_named_is_there(ran):
    looked = f'[name for name in {FOREIGN} if find_spec(name)]'
    found = ran(f'python -c "from importlib.util import find_spec; print({looked})"')
    assert found.stdout.strip() == '[]', found.stderr


@pytest.mark.parametrize('name', sorted({*entry.names()} - {'view'}))
def test_each_executable_has_its_help(ran, name):
    found = ran(f'install/kalman_ros/lib/kalman_ros/{name} --help')
    assert found.returncode == 0, found.stderr
    assert 'usage' in found.stdout.lower()


def test_the_demo_passes(ran):
    found = ran('ROS_DOMAIN_ID=97 install/kalman_ros/lib/kalman_ros/demo --out out', 300)
    assert found.returncode == 0, found.stdout[-2000:] + found.stderr[-2000:]
    assert 'PASS' in found.stdout
