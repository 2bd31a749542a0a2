# SPDX-License-Identifier: Apache-2.0
"""A scenario whose model and sensors are compiled, for runs that compute with it many times."""

from __future__ import annotations

from dataclasses import replace

from kalman_ros.compiled.parts import parts
from kalman_ros.scenario import Scenario


def computed(scenario: Scenario) -> Scenario:
    """Return the same scenario with compiled functions, or itself where there are none."""
    sensors = {name: source.sensor for name, source in scenario.sensors.items()}
    fast = parts(scenario.model, sensors)
    if not fast.outcomes:
        return scenario
    return replace(
        scenario,
        model=fast.model,
        sensors={
            name: replace(source, timed=replace(source.timed, sensor=fast.sensors[name]))
            for name, source in scenario.sensors.items()
        },
    )
