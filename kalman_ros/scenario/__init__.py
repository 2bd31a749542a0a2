# SPDX-License-Identifier: Apache-2.0
"""From named values, as parameter files have them, to the objects of one scenario."""

from .building import build, complete
from .declarations import options, sensor_names
from .scenario import Scenario, SensorSource

__all__ = ['Scenario', 'SensorSource', 'build', 'complete', 'options', 'sensor_names']
