# SPDX-License-Identifier: Apache-2.0
"""Builds the objects of a scenario from named values, as in parameter files."""

from .building import assemble, build, complete, rebuild
from .declarations import options, sensor_names
from .scenario import Scenario, SensorSource

__all__ = [
    'Scenario',
    'SensorSource',
    'assemble',
    'build',
    'complete',
    'options',
    'rebuild',
    'sensor_names',
]
