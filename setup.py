# SPDX-License-Identifier: Apache-2.0
"""The one place of the package's metadata: colcon and pip both read it."""

import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'kalman_ros'
#: A node is a folder with node.py, a program a folder with program.py or a file with main().
FILES = [path for path in Path(PACKAGE).glob('programs/*.py') if '\ndef main(' in path.read_text()]
FOLDERS = *Path(PACKAGE).glob('nodes/*/node.py'), *Path(PACKAGE).glob('programs/*/program.py')
NAMES = sorted([path.stem for path in FILES] + [path.parent.name for path in FOLDERS])

# colcon installs an executable for each, where `ros2 run` looks; pip one command for the PATH
EXECUTABLES = [f'{name} = {PACKAGE}.entry:{name}' for name in NAMES]
BY_COLCON = not {'install', 'develop'}.isdisjoint(sys.argv)

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={
        PACKAGE: [
            'py.typed',
            'compiled/*.c',
            'embedded/c/*',
            'nodes/middleware/*.xml',
            'live/page/*',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml') + glob('config/*.xml'))),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy', 'scipy', 'pyyaml', 'rich', 'matplotlib'],
    extras_require={
        'test': ['pytest', 'pytest-timeout', 'pytest-xdist', 'hypothesis', 'filterpy', 'rosbags'],
        'docs': ['furo', 'latex2mathml', 'myst-parser', 'numpydoc', 'sphinx', 'sphinx-copybutton'],
        'bags': ['rosbags'],
        'compiled': ['casadi>=3.7'],
        'limits': ['daqp>=0.11'],
        'dask': ['distributed'],
        'live': ['websockets>=13'],
        'mujoco': ['mujoco>=4.0'],
        'view': ['foxglove-sdk>=0.30', 'websockets>=15'],
    },
    zip_safe=False,
    maintainer='The kalman_ros authors',
    maintainer_email='kalman_ros@users.noreply.github.com',
    description='State estimation and optimal control for ROS 2: any model, any topic.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': EXECUTABLES if BY_COLCON else [f'{PACKAGE} = {PACKAGE}.entry:main']
    },
)
