# SPDX-License-Identifier: Apache-2.0
"""The loops of a scenario, broken at one input at a time or at all inputs, and their margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.control.compensator import current_compensator
from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.feedback import Feedback
from kalman_ros.control.guarantee import Guarantee, sampled_guarantees
from kalman_ros.control.laws import OPTIMAL
from kalman_ros.control.lqe import LqeDesign, dlqe
from kalman_ros.control.margins import DiskMargin, Margins, loop_at_a_time, margins
from kalman_ros.control.simultaneous import simultaneous_disk
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array, DesignError, OperatingPoint, linearize
from kalman_ros.linear.periodic import Phase, Readings, periodic_filter
from kalman_ros.linear.structure import eigenvalues
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import fixed_gain_observer
from kalman_ros.scenario.regulator import regulator

from .observability import stacked

#: The longest delay in samples: with longer delays the matrices take minutes.
_MOST_SAMPLES = 100


@dataclass(frozen=True)
class Loop:
    """A scalar loop that is closed by u = -L u, with all other inputs closed as designed.

    Parameters
    ----------
    broken
        Open loop L with the requested delay.
    margins
        Margins in addition to the requested delay; None if the loop is unstable with it.
    prompt
        Margins of the loop without the requested delay.
    """

    broken: StateSpace
    margins: Margins | None
    prompt: Margins


@dataclass(frozen=True)
class InputLoops:
    """The loops that are broken at one input.

    Parameters
    ----------
    input
        Name of the input.
    known
        Loop with all states known, which is the LQR loop for an LQR law.
    estimated
        Loop with the estimate, which is the LQG loop for an LQR law; None without a steady-state
        estimator.
    guarantee
        Guaranteed margins of an LQR without delay; None for other laws.
    """

    input: str
    known: Loop
    estimated: Loop | None
    guarantee: Guarantee | None


@dataclass(frozen=True)
class Together:
    """The disk margins of simultaneous changes of all inputs; None for an unstable loop.

    Parameters
    ----------
    known, estimated
        Margin with all states known, and margin with the estimate, both with the requested delay.
        ``estimated`` is also None without an estimator.
    """

    known: DiskMargin | None
    estimated: DiskMargin | None


#: A loop as a function of the delay of its inputs.
Broken = Callable[[float], StateSpace]


def even_noise(scenario: Scenario) -> Array:
    """Return the covariance (p, p) of all readings as if each sensor read at every step.

    That of a sensor that measures in a share of the steps is divided by that share, so that the
    information per second stays the same.
    """
    return np.asarray(
        block_diag(*(
            source.sensor.covariance * scenario.rate / source.timed.rate
            for source in scenario.enabled.values()
        )),
        dtype=float,
    )  # fmt: skip


def even_estimator(scenario: Scenario, point: OperatingPoint) -> LqeDesign:
    """Return the steady-state Kalman filter as if each sensor read at every step.

    A filter with fixed gains has its own, each in the share of the steps in which its sensor
    reads. The loop is then time-invariant and has frequency responses. The result is exact if
    every sensor measures at every step.

    Raises
    ------
    DesignError
        If the error has no steady state.
    """
    step = scenario.model.transition(*point, 1.0 / scenario.rate)
    C, R = stacked(scenario, point.state), even_noise(scenario)
    fixed = fixed_gain_observer(scenario)
    if fixed is None:
        return dlqe(step.F, C, step.Q, R)
    shares = {name: source.timed.rate / scenario.rate for name, source in scenario.enabled.items()}
    even = replace(fixed, gains={name: shares[name] * L for name, L in fixed.gains.items()})
    L = even.joint_gain(source.sensor for source in scenario.enabled.values())
    steady = periodic_filter([Phase(step.F, step.Q, Readings(C, R, L))])
    poles = eigenvalues(step.F - step.F @ L @ C)
    return LqeDesign(L, step.F @ L, steady.posterior[0], steady.prior[0], poles)


def input_loops(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None, delay: float
) -> tuple[InputLoops, ...]:
    """Return the loops that are broken at each input.

    Parameters
    ----------
    scenario
        Scenario, which is linearised about its equilibrium.
    feedback
        Gains of the control law.
    estimator
        Result of `even_estimator`, if there is one.
    delay
        Delay of the input in seconds, unknown to the estimator.

    Raises
    ------
    ValueError
        If the delay is negative, or longer than 100 samples.
    """
    dt = 1.0 / scenario.rate
    if not 0.0 <= delay <= _MOST_SAMPLES * dt:
        raise ValueError(f'delay: expected 0 to {_MOST_SAMPLES * dt:g} s, got {delay:g}')
    state, estimate = _open_loops(scenario, feedback, estimator)
    known = _analyse_loops(state, delay)
    estimated = [None] * len(known) if estimate is None else _analyse_loops(estimate, delay)
    names = scenario.model.input.names
    return tuple(
        InputLoops(*loops) for loops in zip(names, known, estimated, _guarantees(scenario))
    )


def together(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None, delay: float
) -> Together:
    """Return the margins of simultaneous changes of all inputs, as for `input_loops`."""
    state, estimate = _open_loops(scenario, feedback, estimator)
    return Together(
        _disk_or_none(state(delay)), None if estimate is None else _disk_or_none(estimate(delay))
    )


def _open_loops(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None
) -> tuple[Broken, Broken | None]:
    """Return the open loops of the state and of the estimate as functions of the delay."""
    dt = 1.0 / scenario.rate
    system = linearize(scenario.model, *scenario.model.equilibrium)
    law, states = feedback.system(dt), np.eye(system.state.size)

    def known(delay: float) -> StateSpace:
        return law @ sampled_plant(system, states, dt, delay)

    if estimator is None:
        return known, None
    C = stacked(scenario, scenario.model.equilibrium.state)
    H = current_compensator(sampled_plant(system, C, dt), law, estimator)
    return known, lambda delay: H @ sampled_plant(system, C, dt, delay)


def _disk_or_none(loop: StateSpace) -> DiskMargin | None:
    try:
        return simultaneous_disk(loop)
    except DesignError:
        return None


def _guarantees(scenario: Scenario) -> Sequence[Guarantee | None]:
    """Return the guaranteed margins of each input."""
    if scenario.law not in OPTIMAL:
        return [None] * scenario.model.input.size
    design, weights = regulator(scenario)
    dt = 1.0 / scenario.rate
    G = scenario.model.transition(*scenario.model.equilibrium, dt).G
    return sampled_guarantees(design, G, weights, scenario.input_cost * dt)


def _analyse_loops(loop: Broken, delay: float) -> list[Loop]:
    """Return the loop at each input with a delay of ``delay`` seconds, and its margins."""
    prompt = loop(0.0)
    designed = loop_at_a_time(prompt)
    if not delay:
        broken = (prompt.channel(index) for index in range(len(designed)))
        return [
            Loop(channel, design_margins, design_margins)
            for channel, design_margins in zip(broken, designed)
        ]
    delayed = loop(delay)
    broken = (delayed.channel(index) for index in range(len(designed)))
    return [
        Loop(channel, margins_or_none(channel), design_margins)
        for channel, design_margins in zip(broken, designed)
    ]


def margins_or_none(loop: StateSpace) -> Margins | None:
    """Return the margins of a broken loop; None if it is unstable once closed."""
    try:
        return margins(loop)
    except DesignError:
        return None
