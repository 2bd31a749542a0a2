# SPDX-License-Identifier: Apache-2.0
"""package.xml names every ROS package whose modules or messages are used."""

import ast
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: Found where they are installed, and named in one line where they are not.
OPTIONAL = {'foxglove_msgs', 'geographic_msgs'}
_MESSAGE = re.compile(r"'([a-z][a-z0-9_]*_msgs)/[A-Z]")
_MODULE = re.compile(
    r'rclpy|ament_index_python|rosidl_generator_py|\w+_msgs|rcl_interfaces|std_srvs'
)


def used():
    """Yield the ROS packages that a file imports, or names the messages of."""
    for path in (ROOT / 'kalman_ros').rglob('*.py'):
        text = path.read_text()
        yield from _MESSAGE.findall(text)
        for node in ast.walk(ast.parse(text)):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or '']
            tops = [name.partition('.')[0] for name in names]
            yield from (top for top in tops if _MODULE.fullmatch(top))


@pytest.mark.slow
def test_every_package_that_is_used_is_a_dependency():
    tree = ElementTree.parse(ROOT / 'package.xml')
    named = {each.text for each in tree.iter('exec_depend')}
    assert {*used()} - OPTIONAL - named == set()
    assert {'tf2_msgs', 'visualization_msgs', 'rosidl_generator_py'} <= named


def test_the_container_installs_what_package_xml_names_and_builds_the_checkout():
    lines = (ROOT / 'Dockerfile').read_text().splitlines()
    copied = [line.split()[1] for line in lines if line.startswith('COPY')]
    assert copied == ['package.xml', '.'] and lines[4].startswith('FROM ros:jazzy')
    assert any('rosdep install' in line for line in lines)
    settings = json.loads((ROOT / '.devcontainer' / 'devcontainer.json').read_text())
    assert (ROOT / '.devcontainer' / settings['build']['dockerfile']).resolve().is_file()
    assert {'.venv', 'install', 'out'} <= {*(ROOT / '.dockerignore').read_text().split()}
