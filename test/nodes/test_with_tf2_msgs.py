# SPDX-License-Identifier: Apache-2.0
"""The tests of real /tf topics, with a tf2_msgs that is built here: it has no wheel."""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

HERE = Path(__file__).parent
ENVIRONMENT = Path(sys.prefix)
TESTS = ('test_transforms_node.py', 'test_mounts_node.py', '../scenarios/test_two_estimators.py')
FILES = {
    'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n',
    'CMakeLists.txt': """\
cmake_minimum_required(VERSION 3.8)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_export_dependencies(rosidl_default_runtime)
ament_package()
""",
    'package.xml': """\
<package format="3">
  <name>tf2_msgs</name>
  <version>0.0.0</version>
  <description>The message of /tf</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
  <depend>geometry_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
""",
}


def reason_to_skip():
    if importlib.util.find_spec('tf2_msgs') is not None:
        return 'tf2_msgs is installed: the tests run as they are'
    if not (ENVIRONMENT / 'share' / 'rosidl_default_generators' / 'cmake').is_dir():
        return 'the generators are not installed: pip install -r .ci/tf2.txt'
    lacking = [tool for tool in ('cmake', 'gcc', 'g++', 'make') if shutil.which(tool) is None]
    return f'{", ".join(lacking)} missing' if lacking else ''


def here(folder):
    """Return a copy of the environment's prefix whose CMake files name this machine's folders.

    The wheels have those of the machine on which they were built.
    """
    folder.mkdir()
    for each in ENVIRONMENT.iterdir():
        if each.name != 'share':
            (folder / each.name).symlink_to(each)
    shutil.copytree(ENVIRONMENT / 'share', folder / 'share', symlinks=True)
    major, minor = sys.version_info[:2]
    built, version = f'/opt/python/cp{major}{minor}-cp{major}{minor}', f'python{major}.{minor}'
    wrong = {
        f'{built}/include/{version}': sysconfig.get_paths()['include'],
        f'{built}/lib/{version}/site-packages/numpy/_core/include': np.get_include(),
    }
    for path in (folder / 'share').glob('*/cmake/*.cmake'):
        text = path.read_text()
        for old, new in wrong.items():
            text = text.replace(old, new)
        path.write_text(text)
    return folder


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.skipif(bool(reason_to_skip()), reason=reason_to_skip())
def test_transforms_and_mountings_with_the_real_message(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / 'src' / 'tf2_msgs' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    prefix = here(tmp_path / 'prefix')
    clean = {
        'HOME': os.environ.get('HOME', str(tmp_path)),
        'PATH': f'{ENVIRONMENT / "bin"}:{os.environ["PATH"]}',
        'AMENT_PREFIX_PATH': str(prefix),
        'CMAKE_PREFIX_PATH': str(prefix),
    }
    build = subprocess.run(
        [
            sys.executable, '-m', 'colcon', 'build', '--base-paths', 'src',
            '--cmake-args', f'-DPython3_EXECUTABLE={sys.executable}', '-DBUILD_TESTING=OFF',
        ],
        cwd=tmp_path, env=clean, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert build.returncode == 0, build.stdout + build.stderr
    package = tmp_path / 'install' / 'tf2_msgs'
    (modules,) = package.glob('lib/python*/site-packages')
    environment = dict(os.environ)
    for name, first in {
        'PYTHONPATH': modules, 'LD_LIBRARY_PATH': package / 'lib', 'AMENT_PREFIX_PATH': package,
    }.items():  # fmt: skip
        environment[name] = f'{first}:{environment.get(name, "")}'
    run = subprocess.run(
        [
            sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-p', 'no:xdist',
            '-k', 'not without_tf2_msgs', *TESTS,
        ],
        cwd=HERE, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert f'{len(TESTS)} passed' in run.stdout and 'skipped' not in run.stdout, run.stdout
