# SPDX-License-Identifier: Apache-2.0
"""The loop that is exported: an estimator and the law of a controller, if there is one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.control.tracking import FeedForward
from kalman_ros.core import Array, OperatingPoint, Sensor, Space
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.scenario.estimation import Estimation, estimation

#: The window for late readings, which C does not have: they come in the order of their stamps.
_IN_ORDER = 0.0
#: The largest gap in seconds and the most rejections that integers of C hold, with room.
_LONGEST_GAP, _MOST_REJECTIONS = 1e9, 1_000_000_000
_LAWS = 'lqr', 'lqi', 'placement'


#: The most seconds of one step that integral and motion count, as the controller does.
LONGEST_PASSED = 0.5


@dataclass(frozen=True)
class Law:
    """A law about a point at rest, with its limits.

    Parameters
    ----------
    space
        The state (n,) that it regulates, the first of the estimator's.
    feedback, limits
        Gains and limits.
    rest
        The state and the input at rest.
    equilibria
        Where else it rests, for references.
    motion
        What it can follow; None without a motion.
    blend
        Seconds in which the jump after a change, or an idle time, decays; 0: at once.
    """

    space: Space
    feedback: Feedback
    limits: Limits
    rest: OperatingPoint
    equilibria: FeedForward
    motion: Motion | None = None
    blend: float = 0.0


@dataclass(frozen=True)
class Loop:
    """A loop that C can run.

    Parameters
    ----------
    scenario
        Whose it is.
    estimation
        The filter, with the enabled sensors, the first belief and the policy.
    idle
        The input (m,) while no controller acts.
    law
        None without a controller.
    """

    scenario: Scenario
    estimation: Estimation
    idle: Array
    law: Law | None

    @property
    def rate(self) -> float:
        """Steps a second."""
        return self.scenario.rate

    @property
    def space(self) -> Space:
        """The state of the estimator, with the biases of sensors."""
        return self.scenario.believed.model.state

    @property
    def longest_reading(self) -> int:
        """The most numbers of a reading."""
        return max(sensor.output.size for sensor in self.sensors.values())

    @property
    def sensors(self) -> dict[str, Sensor]:
        """The sensors, as they were declared."""
        return dict(self.scenario.believed.sensors)


def loop(
    scenario: Scenario,
    policy: Policy | None = None,
    limits: Limits | None = None,
    idle: Array | None = None,
    *,
    control: bool = True,
    motion: Motion | None = None,
    blend: float = 0.0,
) -> Loop:
    """Return the loop of a scenario.

    Parameters
    ----------
    scenario
        Model, sensors, filter and law.
    policy
        Policy of the estimator, whose recovery and longest gap are used.
    limits, idle
        Of the input; without limits, and zero, by default.
    control
        Whether the law is exported, if there is an input.
    motion
        What the law can follow, with its gains.
    blend
        Seconds in which the jump of the input after an idle time decays.

    Raises
    ------
    ValueError
        If something is not supported; the message says what, and why.
    """
    scenario = _enabled(scenario)
    policy = replace(policy or Policy(), window=_IN_ORDER)
    if not 0.0 <= policy.max_gap <= _LONGEST_GAP:
        raise ValueError(
            f'max_gap: expected 0 to {_LONGEST_GAP:g} s for C, got {policy.max_gap:g}'
        )
    if not 0 <= policy.recover_after <= _MOST_REJECTIONS:
        raise ValueError(f'gate_recover_after: expected at most {_MOST_REJECTIONS} for C')
    if policy.from_reading or policy.from_rest:
        start = 'reading' if policy.from_reading else 'rest'
        raise ValueError(f'initialize: expected belief, got {start}, which C does not have')
    if policy.rest_until_input:
        raise ValueError('rest_until_input: expected false, which is all that C has')
    for name, source in scenario.sensors.items():
        for option in source.weights:
            raise ValueError(f'{name}.{option}: expected none, since C has no such thing')
    estimator = estimation(scenario, policy)
    check_estimator(scenario, estimator)
    m = scenario.model.input.size
    at_rest = np.zeros(m) if idle is None else idle
    law = None
    if control and m:
        law = replace(_law(scenario, limits or Limits.none(m), at_rest, motion), blend=blend)
    elif motion is not None:
        raise ValueError('motion: expected none without a law that follows it')
    return Loop(scenario, estimator, at_rest, law)


def _enabled(scenario: Scenario) -> Scenario:
    """Return a scenario with its enabled sensors alone."""
    if not scenario.enabled:
        raise ValueError('sensors: expected one that is enabled, got none')
    return replace(scenario, sensors=scenario.enabled)


def check_estimator(scenario: Scenario, estimator: Estimation) -> None:
    """Raise ValueError if an estimation cannot be one in C."""
    model, kind = scenario.believed.model, type(estimator.filter)
    supported = kind in (KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter)
    if not supported and not issubclass(kind, FixedGainObserver):
        raise ValueError(
            f'filter: expected kf, ekf, ukf, steady_state or luenberger for C, '
            f'got {scenario.filter}'
        )
    if np.isinf(estimator.initial.covariance).any():
        raise ValueError('initial_std: expected finite ones for C, got an infinite one')
    if kind is UnscentedKalmanFilter:
        spaces = {'the state': model.state}
        spaces |= {name: sensor.output for name, sensor in estimator.sensors.items()}
        for name, space in spaces.items():
            if space.rotations:
                raise ValueError(
                    f'filter: ukf is exported for states and readings without rotations, and '
                    f'{name} has ({", ".join(space.rotations[0])}); ekf takes it'
                )


def _law(scenario: Scenario, limits: Limits, idle: Array, motion: Motion | None) -> Law:
    alone = '; the estimator alone can be exported'
    if scenario.law not in _LAWS:
        raise ValueError(f'law: expected {", ".join(_LAWS)} for C, got {scenario.law}{alone}')
    if motion is None and regulators.steered(scenario):
        raise ValueError(
            'law: at rest no input moves some of the states: expected a motion to follow' + alone
        )
    limits.check('the idle input', idle)
    model = scenario.model
    if motion is not None and motion.space != model.state:
        raise ValueError(
            f'motion: expected one of ({", ".join(model.state.names)}), '
            f'got ({", ".join(motion.space.names)})'
        )
    return Law(
        model.state,
        regulators.feedback(scenario),
        limits,
        model.equilibrium,
        regulators.tracking(scenario),
        None if motion is None else replace(motion, rest=None),
    )
