# SPDX-License-Identifier: Apache-2.0
"""The tests of topics and services whose packages have no wheel, with packages built here."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from interfaces import ENVIRONMENT, PACKAGES, build, lacking, variables

pytest.importorskip('rclpy')

HERE = Path(__file__).parent
TESTS = (
    'test_transforms_node.py', 'test_mounts_node.py', '../scenarios/test_two_estimators.py',
    'test_bond_node.py', 'test_geographic_services.py',
)  # fmt: skip


def reason_to_skip():
    installed = [name for name in PACKAGES if importlib.util.find_spec(name) is not None]
    if installed:
        return f'{", ".join(installed)} installed: the tests run as they are'
    if not (ENVIRONMENT / 'share' / 'rosidl_default_generators' / 'cmake').is_dir():
        return 'the generators are not installed: pip install -r .ci/tf2.txt'
    return f'{", ".join(lacking())} missing' if lacking() else ''


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.skipif(bool(reason_to_skip()), reason=reason_to_skip())
def test_what_needs_the_real_interfaces(tmp_path):
    package = tmp_path / 'install'
    build(package, PACKAGES)
    environment = dict(os.environ)
    for name, first in variables(package).items():
        environment[name] = f'{first}:{environment.get(name, "")}'
    run = subprocess.run(
        [
            sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-p', 'no:xdist',
            '-k', 'not without_tf2_msgs', *TESTS,
        ],
        cwd=HERE, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert ' passed' in run.stdout and 'skipped' not in run.stdout, run.stdout
