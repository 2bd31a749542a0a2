# SPDX-License-Identifier: Apache-2.0
"""From a scenario and the options of the estimator to what fuses its readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kalman_ros.core import Sensor, Value
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.filter import Filter
from kalman_ros.estimators.policy import Policy
from kalman_ros.simulation.scenario import Scenario

from .options import EstimatorOptions


@dataclass(frozen=True)
class Fusion:
    """A filter, its sensors by name, and how to treat what is late, doubtful or missing."""

    filter: Filter
    sensors: Mapping[str, Sensor]
    policy: Policy


def fusion(scenario: Scenario, options: EstimatorOptions, extra: Mapping[str, Value]) -> Fusion:
    """Return what the ``options``, and the ``extra`` ones of the filter, ask for.

    Raises
    ------
    ValueError
        If there is no such filter, or it cannot serve the scenario.
    """
    if options.initialize not in ('belief', 'reading'):
        raise ValueError(f"initialize: expected belief or reading, got '{options.initialize}'")
    gates = {
        name: chi_square_gate(source.gate, source.sensor.output.size)
        for name, source in scenario.sensors.items()
        if source.gate < 1.0
    }
    rests = options.rest_until_input and not options.lockstep and bool(scenario.input.fields)
    policy = Policy(
        window=options.window,
        gates=gates,
        recover_after=options.gate_recover_after,
        restart_after=options.restart_after,
        max_gap=options.max_gap,
        future_tolerance=options.future_tolerance,
        from_reading=options.initialize == 'reading',
        rest_until_input=rests,
    )
    sensors = {name: source.sensor for name, source in scenario.sensors.items()}
    filter = build_filter(scenario.filter, scenario.plan, extra, options.implementation)
    return Fusion(filter, sensors, policy)
