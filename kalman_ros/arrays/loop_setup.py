# SPDX-License-Identifier: Apache-2.0
"""What the arguments of `simulate` and `monte_carlo` make a loop of."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.control.feedback import Feedback
from kalman_ros.core import Array, ArrayLike, matrix
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.loop_law import Law, Reference

from .accept import numbers
from .scenarios import BELIEVED, load, values_of


class Given(NamedTuple):
    """The arguments that replace parts of a scenario's controller."""

    reference: Reference = None
    gain: ArrayLike | None = None
    limits: Mapping[str, Array] = MappingProxyType({})


def loop_of(
    scenario: Any, overrides: Mapping[str, Any] | None, given: Given, seconds: float
) -> tuple[Loop, Law | None]:
    """Return the loop of a scenario and its law; it is open without an input."""
    real, believed, values, faults = _parts(scenario, overrides)
    law = _law(real, believed, values, given)
    return Loop(real, believed, seconds, law, faults=faults), law


def law_of(scenario: Any, overrides: Mapping[str, Any] | None, given: Given) -> Law:
    """Return the law of a scenario; ValueError without an input."""
    real, believed, values, _ = _parts(scenario, overrides)
    law = _law(real, believed, values, given)
    if law is None:
        raise ValueError('model: it has no input, so there is nothing to regulate')
    return law


def _law(
    real: Scenario, believed: Scenario, values: Mapping[str, Any], given: Given
) -> Law | None:
    """Return the law of a loop; None without an input."""
    limits, idle = regulators.actuators(believed, {**values, **given.limits})
    if not real.model.input.size:
        for name, value in {'reference': given.reference, 'gain': given.gain}.items():
            if value is not None:
                raise ValueError(f'{name}: expected none, for the model has no input')
        return None
    gains, fixed = _feedback(believed, given.gain), given.gain is not None
    law = Law(believed, gains, limits, given.reference, idle, fixed)
    law()  # a reference that no input holds is refused
    return law


def _parts(
    given: Any, overrides: Mapping[str, Any] | None
) -> tuple[Scenario, Scenario, Mapping[str, Any], PlantFaults | None]:
    """Return the scenarios of plant and estimator, the controller's values, and the faults."""
    if isinstance(given, Scenario):
        # without a controller's file it begins at rest
        return load(given, overrides), given, {'idle_input': 'equilibrium'}, None
    typed = {} if overrides is None else overrides
    believed = values_of(given, typed, *BELIEVED, faults=True)
    values = values_of(given, typed, 'plant', faults=True)
    real = scenarios.build(values)
    faults = PlantFaults.from_values(real.timed, real.model.input.size, values)
    return real, scenarios.build(believed), believed, faults if faults.any else None


def _feedback(scenario: Scenario, gain: Any) -> Feedback:
    """Return the gains of the argument, else those of the scenario's law."""
    if gain is None:
        return regulators.feedback(scenario)
    n, m = scenario.model.state.size, scenario.model.input.size
    K = matrix('gain', numbers('gain', gain), (m, n))
    return Feedback(K, np.empty((m, 0)), (), np.empty(0, dtype=complex))
