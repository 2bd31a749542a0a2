# SPDX-License-Identifier: Apache-2.0
"""The loops of a scenario, broken at one input at a time or at all, and their margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.control.compensator import current_compensator
from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.feedback import Feedback
from kalman_ros.control.guarantee import Guarantee, sampled_guarantees
from kalman_ros.control.lqe import LqeDesign, dlqe
from kalman_ros.control.margins import DiskMargin, Margins, margins
from kalman_ros.control.simultaneous import simultaneous_disk
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import DesignError, OperatingPoint, linearize
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import regulator

from .observability import stacked

#: More samples of delay give matrices that take minutes.
_MOST_SAMPLES = 100


@dataclass(frozen=True)
class Loop:
    """A scalar loop that is closed by u = -L u, all other inputs closed as designed.

    Parameters
    ----------
    broken
        L, with the requested delay.
    margins
        Beyond that delay; None if the loop is unstable with it.
    prompt
        Without that delay.
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
        Its name.
    known
        With all states known: LQR, if that is the law.
    estimated
        With the estimate: LQG for an LQR law. None if there is no estimator in steady state.
    guarantee
        The guarantee of an LQR without delay; None for other laws.
    """

    input: str
    known: Loop
    estimated: Loop | None
    guarantee: Guarantee | None


@dataclass(frozen=True)
class Together:
    """The largest simultaneous changes of all inputs; None if that loop is unstable.

    Parameters
    ----------
    known, estimated
        With all states known, and with the estimate, with the requested delay.
        ``estimated`` is None without an estimator, too.
    """

    known: DiskMargin | None
    estimated: DiskMargin | None


#: A loop as a function of the delay of its inputs.
Broken = Callable[[float], StateSpace]


def even_estimator(scenario: Scenario, point: OperatingPoint) -> LqeDesign:
    """Return the steady-state Kalman filter as if each sensor read at every step.

    A sensor that measures in a share of the steps then has 1 / share of its covariance, which
    is as much information per second. So the loop is time-invariant and has frequency
    responses. Where every sensor measures at every step, it is exact.

    Raises
    ------
    DesignError
        If the error has no steady state.
    """
    step = scenario.model.transition(*point, 1.0 / scenario.rate)
    covariances = [
        source.sensor.covariance * scenario.rate / source.timed.rate
        for source in scenario.enabled.values()
    ]
    R = np.asarray(block_diag(*covariances), dtype=float)
    return dlqe(step.F, stacked(scenario, point.state), step.Q, R)


def input_loops(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None, delay: float
) -> tuple[InputLoops, ...]:
    """Return the loops at each input, with the input delayed by ``delay`` seconds.

    Parameters
    ----------
    scenario
        Linearised about its equilibrium.
    feedback
        The gains of its law.
    estimator
        The `even_estimator`, if there is one.
    delay
        Unknown to the estimator.

    Raises
    ------
    ValueError
        If the delay is negative, or many samples long.
    """
    dt = 1.0 / scenario.rate
    if not 0.0 <= delay <= _MOST_SAMPLES * dt:
        raise ValueError(f'delay: expected 0 to {_MOST_SAMPLES * dt:g} s, got {delay:g}')
    state, estimate = _broken(scenario, feedback, estimator)
    known = _loops(state, delay)
    estimated = [None] * len(known) if estimate is None else _loops(estimate, delay)
    names = scenario.model.input.names
    return tuple(InputLoops(*each) for each in zip(names, known, estimated, _guarantees(scenario)))


def together(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None, delay: float
) -> Together:
    """Return the margins of simultaneous changes of all inputs; see `input_loops`."""
    state, estimate = _broken(scenario, feedback, estimator)
    return Together(
        _simultaneous(state(delay)), None if estimate is None else _simultaneous(estimate(delay))
    )


def _broken(
    scenario: Scenario, feedback: Feedback, estimator: LqeDesign | None
) -> tuple[Broken, Broken | None]:
    """Return the loop of all inputs as a function of its delay: of the state, of the estimate."""
    dt = 1.0 / scenario.rate
    system = linearize(scenario.model, *scenario.model.equilibrium)
    law, states = feedback.system(dt), np.eye(system.state.size)

    def known(late: float) -> StateSpace:
        return law @ sampled_plant(system, states, dt, late)

    if estimator is None:
        return known, None
    C = stacked(scenario, scenario.model.equilibrium.state)
    H = current_compensator(sampled_plant(system, C, dt), law, estimator)
    return known, lambda late: H @ sampled_plant(system, C, dt, late)


def _simultaneous(loop: StateSpace) -> DiskMargin | None:
    try:
        return simultaneous_disk(loop)
    except DesignError:
        return None


def _guarantees(scenario: Scenario) -> Sequence[Guarantee | None]:
    """Return the guaranteed margins of each input."""
    if scenario.law != 'lqr':
        return [None] * scenario.model.input.size
    design, weights = regulator(scenario)
    dt = 1.0 / scenario.rate
    G = scenario.model.transition(*scenario.model.equilibrium, dt).G
    return sampled_guarantees(design, G, weights, scenario.input_cost * dt)


def _loops(loop: Broken, delay: float) -> list[Loop]:
    """Return, for each input, the loop delayed by ``delay`` and its margins."""
    prompt, late = loop(0.0), loop(delay)
    found = []
    for index in range(len(prompt.D)):
        broken = late.channel(index)
        found.append(Loop(broken, _margins(broken), margins(prompt.channel(index))))
    return found


def _margins(loop: StateSpace) -> Margins | None:
    try:
        return margins(loop)
    except DesignError:
        return None
