# SPDX-License-Identifier: Apache-2.0
"""Poles, margins and the least cost of the loop on a live page, for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import LqgTheory, schedule
from kalman_ros.analysis.input_loops import Loop, even_estimator, input_loops
from kalman_ros.analysis.observability import observability
from kalman_ros.control.feedback import Feedback
from kalman_ros.control.margins import Margin
from kalman_ros.control.separation import LqgLoop
from kalman_ros.core import Array, DesignError, OperatingPoint, linearize
from kalman_ros.estimators import build_filter, filter_class
from kalman_ros.linear.periodic import Phase, periodic_filter
from kalman_ros.linear.structure import continuous_poles, eigenvalues
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback, price, regulator

#: The number of frequencies of a response.
_POINTS = 160


def theory(
    believed: Scenario, actual: Scenario, filter_options: dict[str, Any], delay: float
) -> dict[str, Any]:
    """Return the theory of a loop, whatever of it exists; the reasons for the rest are notes.

    Parameters
    ----------
    believed
        The scenario of the controller, with that of the estimator's noise.
    actual
        The scenario of the plant.
    filter_options
        Of the estimator's filter.
    delay
        Of the plant's input, in seconds.
    """
    found: dict[str, Any] = {'notes': []}
    steps = (
        ('open', lambda: _open(actual)),
        ('estimator', lambda: _estimator(believed, filter_options)),
        *((('regulator', lambda: _regulator(believed)),) if believed.law else ()),
        *((('loops', lambda: _loops(believed, delay)),) if believed.law else ()),
        *((('optimum', lambda: _optimum(actual, believed)),) if believed.law else ()),
    )
    for name, compute in steps:
        try:
            found[name] = compute()
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            found[name] = None
            found['notes'].append(f'{name}: {error}')
    return found


def _point(scenario: Scenario) -> OperatingPoint:
    """Return where a scenario is linearised; DesignError if one place does not represent it."""
    equilibrium = scenario.model.equilibrium
    if scenario.model.input.size:
        return equilibrium
    if not scenario.plan.linear:
        raise DesignError('no steady state: the linearisation changes with the estimate')
    return OperatingPoint(scenario.initial_belief.mean, equilibrium.input)


def _check_seen(scenario: Scenario, point: OperatingPoint) -> None:
    """Raise DesignError if the error has no steady state; to look for one takes a minute."""
    found = observability(scenario, point)
    if not found.detectable:
        raise DesignError(f'no steady state: {found}')


def _open(actual: Scenario) -> list[list[float]]:
    return _pairs(eigenvalues(linearize(actual.model, *_point(actual)).A))


def _regulator(believed: Scenario) -> dict[str, Any]:
    law, dt = feedback(believed), 1.0 / believed.rate
    return {'poles': _pairs(continuous_poles(law.poles, dt)), 'gain': law.gain.tolist()}


def _estimator(believed: Scenario, filter_options: dict[str, Any]) -> dict[str, Any]:
    """Return the poles of the sampled error.

    With them the gains (n, k) of each sensor, row by row, if they are fixed; and for a
    Luenberger observer the ``placed`` poles of its continuous gain.
    """
    dt, point, plan = 1.0 / believed.rate, _point(believed), believed.plan
    _check_seen(believed, point)
    step, phases = believed.model.transition(*point, dt), schedule(believed, point.state)
    n = len(step.F)
    found: dict[str, Any] = {}
    kind = filter_class(believed.filter)
    if kind.fixed_gain:
        fixed: Any = build_filter(believed.filter, plan, filter_options)
        none = np.empty((n, 0))
        gains = [
            np.hstack([none, *(fixed.gains[name] for name in plan.due(phase))])
            for phase in range(plan.period)
        ]
        found['gains'] = {name: _rounded(L.ravel()) for name, L in fixed.gains.items()}
    else:
        gains = periodic_filter([Phase(step.F, step.Q, readings) for readings in phases]).gains
    placed = kind.placed_poles(n, **filter_options)
    if placed:
        found['placed'] = _pairs(placed)
    over = np.eye(n)
    for readings, L in zip(phases, gains):
        over = (np.eye(n) - L @ readings.C) @ step.F @ over
    poles = eigenvalues(over) ** (1.0 / len(phases))
    return {**found, 'poles': _pairs(continuous_poles(poles, dt))}


def _loops(believed: Scenario, delay: float) -> list[dict[str, Any]]:
    """Return the loop broken at each input, with the state known and with the estimate."""
    law = feedback(believed)
    estimator = None
    point = believed.model.equilibrium
    optimal = filter_class(believed.filter).optimal
    if optimal and observability(believed, point).detectable:
        estimator = even_estimator(believed, point)
    found = []
    for at in input_loops(believed, law, estimator, min(delay, 100.0 / believed.rate)):
        loops = {'known': at.known, 'estimated': at.estimated}
        w = _frequencies([loop for loop in loops.values() if loop], believed.rate)
        found.append({
            'input': at.input,
            'w': _rounded(w),
            **{name: loop and _loop(loop, w) for name, loop in loops.items()},
        })  # fmt: skip
    return found


def _frequencies(loops: Sequence[Loop], rate: float) -> Array:
    margins = [loop.margins or loop.prompt for loop in loops]
    marks = [each.frequency for m in margins for each in (m.lower_gain, m.upper_gain, m.lag)]
    low = min((mark for mark in marks if 0.0 < mark < inf), default=0.01 * pi * rate)
    return np.asarray(np.geomspace(0.1 * low, 0.97 * pi * rate, _POINTS), dtype=float)


def _loop(loop: Loop, w: Array) -> dict[str, Any]:
    L = loop.broken.response(w)[:, 0, 0]
    found: dict[str, Any] = {'re': _rounded(L.real), 'im': _rounded(L.imag), 'margins': None}
    if loop.margins is not None:
        m = loop.margins
        found['margins'] = {
            'lower_gain': _margin(m.lower_gain),
            'upper_gain': _margin(m.upper_gain),
            'lag': _margin(m.lag),
            'delay': _margin(m.delay),
            'disk': m.disk.alpha,
        }
    return found


def _margin(margin: Margin) -> list[float | None]:
    """Return value and frequency; None for infinite or missing ones."""
    return [each if isfinite(each) else None for each in (margin.value, margin.frequency)]


def _optimum(actual: Scenario, believed: Scenario) -> float:
    """Return the least mean cost a second of any controller of the actual plant."""
    dt, point = 1.0 / actual.rate, actual.model.equilibrium
    _check_seen(actual, point)
    weighed = replace(actual, state_cost=believed.state_cost, input_cost=believed.input_cost)
    design, _ = regulator(weighed)
    law = Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)
    step = actual.model.transition(*point, dt)
    loop = LqgLoop(step, schedule(actual, point.state), law.system(dt))
    return LqgTheory(law, price(weighed), loop, dt).expected_cost


def _pairs(poles: Any) -> list[list[float]]:
    """Return finite poles as pairs, the slowest first."""
    finite = [pole for pole in np.atleast_1d(poles).tolist() if np.isfinite(pole)]
    ordered = sorted(finite, key=lambda pole: (-pole.real, abs(pole.imag), pole.imag))
    return [[float(f'{p.real:.6g}'), float(f'{p.imag:.6g}')] for p in ordered]


def _rounded(values: Any) -> list[float]:
    return [float(f'{value:.5g}') for value in np.asarray(values).tolist()]
