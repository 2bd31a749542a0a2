# SPDX-License-Identifier: Apache-2.0
"""A checkout in an awkward place: a folder with a space and an accent, or not to be written to."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

ROOT = Path(__file__).parents[2]
SOURCES = [
    '.ci',
    'config',
    'dev',
    'kalman_ros',
    'package.xml',
    'resource',
    'setup.cfg',
    'setup.py',
]

pytestmark = pytest.mark.skipif(
    not (ROOT / '.venv/ready').exists(), reason='a sourced ROS has no environment to link to'
)


@pytest.fixture
def checkout(tmp_path):
    """A copy of the sources, with the environment of this checkout."""
    folder = tmp_path / 'with a späce'
    folder.mkdir()
    for name in SOURCES:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy2
        copy(source, folder / name)
    (folder / '.venv').symlink_to((ROOT / '.venv').resolve())
    return folder


def dev(folder, *arguments, **environment):
    """Run ``./dev`` there as from a fresh shell."""
    ours = ('AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH', 'PYTHONPATH', 'ROS_DISTRO', 'VIRTUAL_ENV')
    fresh = {name: value for name, value in os.environ.items() if name not in ours}
    return subprocess.run(
        [str(folder / 'dev'), *arguments],
        env={**fresh, **environment},
        capture_output=True,
        text=True,
        timeout=110,
    )


@pytest.mark.thorough
def test_a_folder_with_a_space_and_an_accent(checkout):
    done = dev(checkout, 'plant', '--help')
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('usage: plant')
    sourced = subprocess.run(
        ['bash', '-ec', 'source install/setup.bash; echo "$AMENT_PREFIX_PATH"'],
        cwd=checkout,
        capture_output=True,
        text=True,
    )
    assert sourced.stdout.startswith(str(checkout / 'install/kalman_ros')), sourced.stderr


def test_a_folder_that_cannot_be_written_to_says_what_to_do(checkout, tmp_path):
    (checkout / 'install').symlink_to('/sys/kernel')  # nobody, not even root, writes there
    done = dev(checkout, 'build')
    lines = done.stderr.strip().splitlines()
    assert (done.returncode, len(lines)) == (1, 1), lines
    assert 'cannot be written to' in lines[0]
    assert 'copy the checkout' in lines[0]


def test_no_room_for_a_temporary_file_is_one_line(checkout):
    done = dev(checkout, 'build', TMPDIR='/sys/kernel')
    assert done.returncode == 1
    assert done.stderr.count('\n') == 1
    assert done.stderr.startswith('dev: cannot write to /sys/kernel: free some space')
