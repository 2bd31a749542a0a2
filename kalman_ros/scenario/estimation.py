# SPDX-License-Identifier: Apache-2.0
"""The one way from a scenario to its filter, with the sensors and the policy of an estimator.

Node, replay, simulation, Monte Carlo, doctor and tune take it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from kalman_ros.compiled.parts import COMPILED, NUMPY, parts
from kalman_ros.core import Array, Gaussian, Sensor, Value
from kalman_ros.estimators import NATIVE, build_filter, filter_class, filter_options
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.diffuse import check_start
from kalman_ros.estimators.filter import Filter
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.policy import Policy

from .scenario import Scenario


@dataclass(frozen=True)
class Estimation:
    """A filter with its sensors, its first belief and the policy of an estimator.

    Parameters
    ----------
    filter, sensors, initial, policy
        What an `OnlineEstimator` takes.
    arithmetic
        What computes the model and the sensors, in words.
    pending
        What is still to be compiled, for `compiled.library.load`.
    """

    filter: Filter
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    policy: Policy
    arithmetic: str
    pending: Sequence[str] = ()

    def online(self, input: Array) -> OnlineEstimator:
        """Return a new estimator, with this ``input`` (m,) until the first one arrives."""
        return OnlineEstimator(self.filter, self.sensors, self.initial, input, self.policy)


def estimation(
    scenario: Scenario,
    policy: Policy | None = None,
    *,
    filter: str = '',
    options: Mapping[str, Value] | None = None,
    implementation: str = NATIVE,
    arithmetic: str = COMPILED,
    wait: bool = True,
    biases: bool = True,
) -> Estimation:
    """Return the filter of a scenario with its sensors, first belief and policy.

    Parameters
    ----------
    scenario
        The model, the sensors, their gates, and the name of the filter.
    policy
        How to treat imperfect data; its gates are those of the scenario.
    filter
        The name of another filter.
    options
        Those of the filter; by default the scenario's, if the filter is.
    implementation, arithmetic
        Whose filter it is, and what computes model and sensors.
    wait
        Whether to wait for a C compiler; else what was not compiled before is
        `Estimation.pending`.
    biases
        Whether the biases of sensors are states, as the scenario has them.

    Raises
    ------
    ValueError
        If the filter is unknown, or does not support the scenario.
    """
    believed = scenario.believed if biases else scenario.without_biases.believed
    chosen = arithmetic if implementation == NATIVE else NUMPY
    fast = parts(believed.model, believed.sensors, chosen, wait=wait)
    plan = scenario.plan.computed_by(fast.model, fast.sensors)
    kind = filter or scenario.filter
    if options is None and kind == scenario.filter:
        options = scenario.filter_options
    built = build_filter(kind, plan, options, implementation)
    weighed = by_innovation(scenario, policy or Policy())
    check_start(built, believed.initial, fast.sensors)
    if built.fixed_gain:
        _check_fixed(scenario, kind)
    return Estimation(
        built, fast.sensors, believed.initial, weighed, fast.arithmetic, fast.pending
    )


def fixed_gain_observer(scenario: Scenario) -> FixedGainObserver | None:
    """Return the filter of a scenario if its gains are fixed, else None.

    Raises
    ------
    ValueError
        If it does not support the scenario; DesignError if it has no solution.
    """
    if not filter_class(scenario.filter).fixed_gain:
        return None
    built = build_filter(scenario.filter, scenario.plan, scenario.filter_options)
    assert isinstance(built, FixedGainObserver)
    return built


def placed_poles(scenario: Scenario) -> list[complex]:
    """Return the poles in 1/s that the gain of the filter is designed for; empty for others."""
    options = {option.name: option.default for option in filter_options(scenario.filter)}
    chosen: dict[str, Any] = {**options, **scenario.filter_options}
    return filter_class(scenario.filter).placed_poles(scenario.model.state.size, **chosen)


def by_innovation(scenario: Scenario, policy: Policy) -> Policy:
    """Return a policy with the gates of the scenario, and its sensors that adapt."""
    sources = scenario.sensors.items()

    def limits(option: str) -> dict[str, float]:
        return {
            name: chi_square_gate(getattr(source, option), source.sensor.output.size)
            for name, source in sources
            if getattr(source, option) < 1.0
        }

    adaptive = tuple(name for name, source in sources if source.adapt)
    return replace(policy, gates=limits('gate'), soft_gates=limits('soft_gate'), adaptive=adaptive)


def _check_fixed(scenario: Scenario, kind: str) -> None:
    """Raise ValueError if the noise of a reading is to change a gain that is fixed."""
    for name, source in scenario.sensors.items():
        for option in source.weights:
            raise ValueError(
                f'{name}.{option}: the gain of {kind} is fixed, whatever the noise; '
                'expected another filter, such as kf or ekf'
            )
