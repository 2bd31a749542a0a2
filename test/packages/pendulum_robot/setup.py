# SPDX-License-Identifier: Apache-2.0
from setuptools import setup

setup(
    name='pendulum_robot',
    version='0.0.0',
    packages=['pendulum_robot'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/pendulum_robot']),
        ('share/pendulum_robot', ['package.xml', 'pendulum.yaml']),
    ],
)
