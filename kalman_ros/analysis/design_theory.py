# SPDX-License-Identifier: Apache-2.0
"""The theory of a scenario's loop, computed before anything runs.

A model with inputs is linearised about its equilibrium, where the regulator holds it; one
without inputs, about the initial belief. Nonlinear sensors are analysed along a simulated path:
see `path`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.lqe import LqeDesign
from kalman_ros.control.separation import LqgLoop
from kalman_ros.control.stability import Mode, modes
from kalman_ros.control.state_space import static
from kalman_ros.core import Array, DesignError, OperatingPoint, Transition, linearize, symmetric
from kalman_ros.linear.periodic import Readings, updated
from kalman_ros.linear.structure import Controllability, Observability, controllability
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback, price

from . import path as paths
from .checks import LqgTheory, schedule
from .design_report import ClosedLoop, DesignReport, Estimator, Prediction, Regulator
from .input_loops import even_estimator, input_loops, together
from .observability import observability, stacked
from .path import Path

#: The most steps for which the error is predicted.
_MOST_STEPS = 6000


def settling_time(modes: Sequence[Mode]) -> float:
    """Return the seconds after which a thousandth of the start is left; inf if never."""
    return log(1e3) * max(mode.time_constant for mode in modes)


def report(
    scenario: Scenario,
    delay: float = 0.0,
    duration: float | None = None,
    followed: Scenario | None = None,
) -> DesignReport:
    """Return the theory of a scenario whose input is late by ``delay`` seconds.

    ``duration`` is that of the simulated path of a scenario that is not linear, in seconds; None
    for one with enough readings of every sensor. The path is that of ``followed``, where its
    rate or its law differ for a long run.

    Raises
    ------
    ValueError
        If no sensor is on, or the delay or the duration is wrong.
    DesignError
        If the input cannot stabilise the model, or a mode grows that no sensor sees.
    """
    if not scenario.enabled:
        raise ValueError('sensors: expected at least one that is enabled')
    model, linear = scenario.model, scenario.plan.linear
    point = model.equilibrium
    if not model.input.size:
        point = OperatingPoint(scenario.initial_belief.mean, point.input)
    reach = _reach(scenario) if model.input.size else None
    law = None if reach is None else feedback(scenario)
    path = None
    if not linear:
        longer = followed or scenario
        seconds = paths.default_seconds(longer) if duration is None else duration
        path = paths.follow(longer, None if law is None else feedback(longer), seconds)
    seen = _observability(scenario, point, path)
    # one operating point is enough where a regulator holds the plant, or nothing changes
    steady = linear or law is not None
    even = _even_estimator(scenario, point) if steady else None
    dt = 1.0 / scenario.rate
    step = model.transition(*point, dt)
    idle = static(np.zeros((model.input.size, model.state.size)), dt)
    readings = schedule(scenario, point.state)
    system_of_law = idle if law is None else law.system(dt)
    loop = None if even is None else LqgLoop(step, readings, system_of_law)
    estimator = None if loop is None else _estimator(scenario, loop)
    return DesignReport(
        scenario=scenario,
        point=point,
        delay=delay,
        modes=modes(linearize(model, *point).A),
        controllability=reach,
        observability=seen,
        regulator=None if law is None else _regulator(scenario, law, even, delay),
        estimator=estimator,
        closed_loop=None if law is None or loop is None else _closed_loop(scenario, law, loop),
        prediction=(
            _prediction(scenario, step, readings, estimator)
            if path is None
            else _prediction_along(scenario, path)
        ),
        path=path,
    )


def _observability(scenario: Scenario, point: OperatingPoint, path: Path | None) -> Observability:
    """Return the observability: along the path, if there is one."""
    if path is None:
        return observability(scenario, point)
    seen = path.observed(throughout=False)
    unseen = tuple(name for name in path.names if name not in seen)
    return Observability(seen, unseen, (), not set(unseen).intersection(path.growing))


def _prediction_along(scenario: Scenario, path: Path) -> Prediction:
    first = np.sqrt(scenario.initial_belief.covariance.diagonal())
    return Prediction(np.append(0.0, path.time), np.vstack((first, path.std)))


def _reach(scenario: Scenario) -> Controllability:
    """Return the controllability; DesignError if it is insufficient."""
    model = scenario.model
    system = linearize(model, *model.equilibrium)
    found = controllability(system.A, system.B, model.state.names)
    if not found.stabilizable:
        stuck = dict.fromkeys(str(mode) for mode in found.hidden if mode.pole.real >= -1e-12)
        raise DesignError(f'input: it does not move the modes at {", ".join(stuck)}; {found}')
    return found


def _even_estimator(scenario: Scenario, point: OperatingPoint) -> LqeDesign | None:
    """Return the estimator as if every sensor read at every step; None without a steady state."""
    try:
        if not np.all(np.isfinite(stacked(scenario, point.state))):
            return None
        if not observability(scenario, point).detectable:
            return None
        return even_estimator(scenario, point)
    except DesignError:
        return None


def _regulator(
    scenario: Scenario, law: Feedback, even: LqeDesign | None, delay: float
) -> Regulator:
    dt = 1.0 / scenario.rate
    step = scenario.model.transition(*scenario.model.equilibrium, dt)
    closed = LqgLoop(step, (), law.system(dt)).closed_matrix
    loops = input_loops(scenario, law, even, delay)
    joint = together(scenario, law, even, delay) if len(loops) > 1 else None
    return Regulator(law, modes(closed, dt), loops, joint)


def _estimator(scenario: Scenario, loop: LqgLoop) -> Estimator:
    plan, p = scenario.plan, len(loop.schedule)
    gains: dict[str, list[Array]] = {name: [] for name in plan.sensors}
    for phase, L in enumerate(loop.estimator_gains):
        at = 0
        for name in plan.due(phase):
            k = plan.sensors[name].sensor.output.size
            gains[name].append(L[:, at : at + k])
            at += k
    return Estimator(
        {name: np.mean(each, axis=0) for name, each in gains.items()},
        modes(loop.error_matrix, p * plan.dt),
        _root_mean(loop.posterior),
        loop.posterior.mean(axis=0),
    )


def _root_mean(covariances: Array) -> Array:
    """Return the roots (n,) of the mean variances of a period (p, n, n)."""
    variances = covariances.diagonal(axis1=1, axis2=2).mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))  # zero may be a rounding below


def _closed_loop(scenario: Scenario, law: Feedback, loop: LqgLoop) -> ClosedLoop:
    expected = LqgTheory(law, price(scenario), loop, 1.0 / scenario.rate)
    n, answer = len(loop.step.F), loop.answer
    sigma = loop.covariance
    return ClosedLoop(
        expected.settling_time,
        expected.expected_cost,
        _root_mean(sigma[:, :n, :n]),
        _root_mean(answer @ sigma @ answer.T),
    )


def _prediction(
    scenario: Scenario, step: Transition, readings: Sequence[Readings], estimator: Estimator | None
) -> Prediction:
    """Return the errors until they have settled, or the last step."""
    wanted = ceil(settling_time(estimator.modes) * scenario.rate) if estimator else _MOST_STEPS
    P = scenario.initial_belief.covariance
    rows = [np.sqrt(P.diagonal())]
    count = min(wanted, _MOST_STEPS) + 1
    for k in range(count):
        if k:
            P = symmetric(step.F @ P @ step.F.T + step.Q)
        _, P = updated(P, readings[k % len(readings)])
        rows.append(np.sqrt(P.diagonal()))
    return Prediction(np.append(0, np.arange(count)) / scenario.rate, np.array(rows))
