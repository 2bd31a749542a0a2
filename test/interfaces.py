# SPDX-License-Identifier: Apache-2.0
"""Interface packages that have no wheel, built from their definitions beside the wheels of ROS.

python test/interfaces.py FOLDER PACKAGE ...
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy as np

ENVIRONMENT = Path(sys.prefix)
#: By package: what it needs, and its interfaces, as they are in the packages of these names.
PACKAGES = {
    'tf2_msgs': (
        'geometry_msgs',
        {'msg/TFMessage': 'geometry_msgs/TransformStamped[] transforms'},
    ),
    'bond': (
        'std_msgs',
        {
            'msg/Status': 'std_msgs/Header header\nstring id\nstring instance_id\nbool active\n'
            'float32 heartbeat_timeout\nfloat32 heartbeat_period'
        },
    ),
    'geographic_msgs': (
        'std_msgs',
        {
            'msg/GeoPoint': 'float64 latitude\nfloat64 longitude\nfloat64 altitude',
            'msg/GeoPointStamped': 'std_msgs/Header header\nGeoPoint position',
        },
    ),
    'robot_localization': (
        'geometry_msgs geographic_msgs',
        {
            'srv/ToLL': 'geometry_msgs/Point map_point\n---\ngeographic_msgs/GeoPoint ll_point',
            'srv/FromLL': 'geographic_msgs/GeoPoint ll_point\n---\ngeometry_msgs/Point map_point',
            'srv/SetPose': 'geometry_msgs/PoseWithCovarianceStamped pose\n---',
            'srv/ToggleFilterProcessing': 'bool on\n---\nbool status',
            'srv/ToLLArray': 'geometry_msgs/Point[] map_points\n---\n'
            'geographic_msgs/GeoPoint[] ll_points',
            'srv/FromLLArray': 'geographic_msgs/GeoPoint[] ll_points\n---\n'
            'geometry_msgs/Point[] map_points',
        },
    ),
}


def write_package(folder, name, needs, interfaces):
    """Write the source of a package that has nothing but interfaces."""
    listed = ' '.join(f'"{path}.{path[:3]}"' for path in interfaces)
    found = '\n'.join(f'find_package({each} REQUIRED)' for each in needs.split())
    depends = '\n'.join(f'  <depend>{each}</depend>' for each in needs.split())
    files = {
        **{f'{path}.{path[:3]}': f'{text}\n' for path, text in interfaces.items()},
        'CMakeLists.txt': f"""\
cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
{found}
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}} {listed} DEPENDENCIES {needs})
ament_export_dependencies(rosidl_default_runtime)
ament_package()
""",
        'package.xml': f"""\
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>Interfaces for tests</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
{depends}
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
""",
    }
    for path, text in files.items():
        file = folder / name / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)


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


def lacking():
    """Return the tools that a build takes and this machine lacks."""
    return [tool for tool in ('cmake', 'gcc', 'g++', 'make') if shutil.which(tool) is None]


def build(prefix, names):
    """Build packages into ``prefix``; RuntimeError with the output if that fails."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name in names:
            write_package(work / 'src', name, *PACKAGES[name])
        ros = here(work / 'prefix')
        clean = {
            'HOME': os.environ.get('HOME', folder),
            'PATH': f'{ENVIRONMENT / "bin"}:{os.environ["PATH"]}',
            'AMENT_PREFIX_PATH': str(ros),
            'CMAKE_PREFIX_PATH': str(ros),
        }
        done = subprocess.run(
            [
                sys.executable, '-m', 'colcon', 'build', '--merge-install', '--base-paths', 'src',
                '--install-base', str(prefix),
                '--cmake-args', f'-DPython3_EXECUTABLE={sys.executable}', '-DBUILD_TESTING=OFF',
            ],
            cwd=work, env=clean, capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)


def variables(prefix):
    """Return the variables of the environment in which the packages are found, by their names."""
    (modules,) = Path(prefix).glob('lib/python*/site-packages')
    libraries = Path(prefix) / 'lib'
    return {'PYTHONPATH': modules, 'LD_LIBRARY_PATH': libraries, 'AMENT_PREFIX_PATH': prefix}


if __name__ == '__main__':
    missing = lacking()
    if missing:
        sys.exit(f'{", ".join(missing)} missing')
    target = Path(sys.argv[1]).resolve()
    shutil.rmtree(target, ignore_errors=True)
    build(target, sys.argv[2:])
