# SPDX-License-Identifier: Apache-2.0
"""Refusal of parameters that no node has, before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kalman_ros import scenario
from kalman_ros.pipeline import names


def refuse_unknown_parameters(values: Mapping[str, Any]) -> None:
    """Raise ValueError for the first parameter that neither the scenario nor a node has."""
    known = scenario.options(values)
    listed = known['sensors']
    sensors = scenario.sensor_names(listed.check(values.get('sensors', listed.default)))
    driven = 'input.topic' in known
    accepted = {*known, *names.known(sensors, values, known, driven=driven)}
    names.refuse(values, accepted, sensors)
