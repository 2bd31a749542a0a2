# SPDX-License-Identifier: Apache-2.0
"""The theory of a scenario's loop, computed before anything runs.

A model with inputs is linearised about its equilibrium, where the regulator holds it, and a model
without inputs about the initial belief. Nonlinear sensors are analysed along a simulated path; see
`path`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.limiter import Limits
from kalman_ros.control.lqe import LqeDesign
from kalman_ros.control.separation import LqgLoop
from kalman_ros.control.stability import Mode, modes
from kalman_ros.control.state_space import static
from kalman_ros.core import Array, DesignError, OperatingPoint, Transition, linearize, symmetric
from kalman_ros.linear.periodic import Readings, updated
from kalman_ros.linear.structure import Controllability, Observability, controllability
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback, price, steered

from . import path as paths
from .checks import LqgTheory, schedule
from .design_report import ClosedLoop, DesignReport, Estimator, Prediction, Regulator
from .input_loops import even_estimator, input_loops, together
from .observability import observability, stacked
from .path import Path
from .unlimited import unlimited_starts

#: The largest number of steps for which the error is predicted.
_MOST_STEPS = 6000


def settling_time(modes: Sequence[Mode]) -> float:
    """Return the time in seconds after which a thousandth of the initial error is left, or inf."""
    return log(1e3) * max(mode.time_constant for mode in modes)


def report(
    scenario: Scenario,
    delay: float = 0.0,
    duration: float | None = None,
    followed: Scenario | None = None,
    limits: Limits | None = None,
) -> DesignReport:
    """Return the theory of a scenario whose input is delayed.

    Parameters
    ----------
    scenario
        Scenario to analyse.
    delay
        Delay of the input, in seconds.
    duration
        Duration in seconds of the simulated path of a scenario that is not linear; None for a path
        with enough readings of every sensor.
    followed
        Scenario that the path simulates, if its rate or its law differs from ``scenario`` for a
        long run; None for ``scenario``.
    limits
        Limits of the inputs; None for none.

    Raises
    ------
    ValueError
        If no sensor is enabled, or if the delay or the duration is invalid.
    DesignError
        If the input cannot stabilise the model, or if no sensor observes a growing mode.
    """
    if not scenario.enabled:
        raise ValueError('sensors: expected at least one that is enabled')
    if scenario.model.is_discrete:
        raise ValueError(
            'model: the theory of a loop needs one in continuous time; for one in discrete time '
            'there are kr.dlqr, kr.dlqe, kr.margins and kr.simulate'
        )
    model, linear = scenario.model, scenario.plan.linear
    point, held = model.equilibrium, bool(model.input.size) and not steered(scenario)
    if not held:
        point = OperatingPoint(scenario.initial_belief.mean, point.input)
    reach = _check_controllability(scenario) if held else None
    law = None if reach is None else feedback(scenario)
    path = None
    if not linear:
        path_scenario = followed or scenario
        seconds = paths.default_seconds(path_scenario) if duration is None else duration
        path = paths.follow(
            path_scenario, None if law is None else feedback(path_scenario), seconds
        )
    seen = _assess_observability(scenario, point, path)
    # one operating point suffices if a regulator holds the plant there, or if all is linear
    steady = linear or law is not None
    time_invariant = _time_invariant_estimator(scenario, point) if steady else None
    dt = 1.0 / scenario.rate
    step = model.transition(*point, dt)
    no_law = static(np.zeros((model.input.size, model.state.size)), dt)
    readings = schedule(scenario, point.state)
    system_of_law = no_law if law is None else law.system(dt)
    loop = None if time_invariant is None else LqgLoop(step, readings, system_of_law)
    estimator = None if loop is None else _design_estimator(scenario, loop)
    return DesignReport(
        scenario=scenario,
        point=point,
        delay=delay,
        modes=modes(linearize(model, *point).A),
        controllability=reach,
        observability=seen,
        regulator=None if law is None else _design_regulator(scenario, law, time_invariant, delay),
        estimator=estimator,
        closed_loop=None
        if law is None or loop is None
        else _analyse_closed_loop(scenario, law, loop),
        prediction=(
            _predict_errors(scenario, step, readings, estimator)
            if path is None
            else _predict_along_path(scenario, path)
        ),
        path=path,
        unlimited=None
        if law is None
        else unlimited_starts(scenario, law, limits or Limits.none(model.input.size)),
    )


def _assess_observability(
    scenario: Scenario, point: OperatingPoint, path: Path | None
) -> Observability:
    """Return the observability along the path, or about a point if there is no path."""
    if path is None:
        return observability(scenario, point)
    observed = path.observed(throughout=False)
    unobserved = tuple(name for name in path.names if name not in observed)
    return Observability(observed, unobserved, (), not set(unobserved).intersection(path.growing))


def _predict_along_path(scenario: Scenario, path: Path) -> Prediction:
    first = np.sqrt(scenario.initial_belief.covariance.diagonal())
    return Prediction(np.append(0.0, path.time), np.vstack((first, path.std)))


def _check_controllability(scenario: Scenario) -> Controllability:
    """Return the controllability; raise DesignError if the model cannot be stabilised."""
    model = scenario.model
    system = linearize(model, *model.equilibrium)
    result = controllability(system.A, system.B, model.state.names)
    if not result.stabilizable:
        unstable = dict.fromkeys(str(mode) for mode in result.hidden if mode.pole.real >= -1e-12)
        raise DesignError(f'input: it does not move the modes at {", ".join(unstable)}; {result}')
    return result


def _time_invariant_estimator(scenario: Scenario, point: OperatingPoint) -> LqeDesign | None:
    """Return the filter as if every sensor read at every step; None without a steady state."""
    try:
        if not np.all(np.isfinite(stacked(scenario, point.state))):
            return None
        if not observability(scenario, point).detectable:
            return None
        return even_estimator(scenario, point)
    except DesignError:
        return None


def _design_regulator(
    scenario: Scenario, law: Feedback, time_invariant: LqeDesign | None, delay: float
) -> Regulator:
    dt = 1.0 / scenario.rate
    step = scenario.model.transition(*scenario.model.equilibrium, dt)
    closed = LqgLoop(step, (), law.system(dt)).closed_matrix
    loops = input_loops(scenario, law, time_invariant, delay)
    joint = together(scenario, law, time_invariant, delay) if len(loops) > 1 else None
    return Regulator(law, modes(closed, dt), loops, joint)


def _design_estimator(scenario: Scenario, loop: LqgLoop) -> Estimator:
    plan, p = scenario.plan, len(loop.schedule)
    gains: dict[str, list[Array]] = {name: [] for name in plan.sensors}
    for phase, L in enumerate(loop.estimator_gains):
        column = 0
        for name in plan.due(phase):
            k = plan.sensors[name].sensor.output.size
            gains[name].append(L[:, column : column + k])
            column += k
    return Estimator(
        {name: np.mean(phases, axis=0) for name, phases in gains.items()},
        modes(loop.error_matrix, p * plan.dt),
        _root_mean_variance(loop.posterior),
        loop.posterior.mean(axis=0),
    )


def _root_mean_variance(covariances: Array) -> Array:
    """Return the square roots (n,) of the mean variances of a period (p, n, n)."""
    variances = covariances.diagonal(axis1=1, axis2=2).mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))  # rounding may make a variance negative


def _analyse_closed_loop(scenario: Scenario, law: Feedback, loop: LqgLoop) -> ClosedLoop:
    expected = LqgTheory(law, price(scenario), loop, 1.0 / scenario.rate)
    n, answer = len(loop.step.F), loop.answer
    sigma = loop.covariance
    return ClosedLoop(
        expected.settling_time,
        expected.expected_cost,
        _root_mean_variance(sigma[:, :n, :n]),
        _root_mean_variance(answer @ sigma @ answer.T),
    )


def _predict_errors(
    scenario: Scenario, step: Transition, readings: Sequence[Readings], estimator: Estimator | None
) -> Prediction:
    """Return the errors until they have settled, or until the last step."""
    settling_steps = (
        ceil(settling_time(estimator.modes) * scenario.rate) if estimator else _MOST_STEPS
    )
    P = scenario.initial_belief.covariance
    rows = [np.sqrt(P.diagonal())]
    count = min(settling_steps, _MOST_STEPS) + 1
    for k in range(count):
        if k:
            P = symmetric(step.F @ P @ step.F.T + step.Q)
        _, P = updated(P, readings[k % len(readings)])
        rows.append(np.sqrt(P.diagonal()))
    return Prediction(np.append(0, np.arange(count)) / scenario.rate, np.array(rows))
