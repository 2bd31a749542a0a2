# SPDX-License-Identifier: Apache-2.0
"""Theory of the loop on a live page, for JSON: poles, margins and least cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import LqgTheory, schedule
from kalman_ros.analysis.input_loops import Loop, even_estimator, input_loops
from kalman_ros.analysis.observability import observability, stacked
from kalman_ros.control.feedback import Feedback
from kalman_ros.control.margins import Margin
from kalman_ros.control.separation import LqgLoop
from kalman_ros.core import Array, DesignError, OperatingPoint, linearize
from kalman_ros.linear.periodic import Phase, periodic_filter
from kalman_ros.linear.structure import continuous_poles, eigenvalues
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import fixed_gain_observer, placed_poles
from kalman_ros.scenario.regulator import feedback, price, regulator

#: Number of frequencies of a response.
_POINTS = 160


def theory(believed: Scenario, actual: Scenario, delay: float) -> dict[str, Any]:
    """Return the theory of a loop; a part that does not exist is None, and a note has the reason.

    Parameters
    ----------
    believed
        Scenario of the controller, with the noise and the filter of the estimator.
    actual
        Scenario of the plant.
    delay
        Delay of the input of the plant, in seconds.
    """
    results: dict[str, Any] = {'notes': []}
    steps = (
        ('unseen', lambda: _unseen(believed)),
        ('open', lambda: _open_loop_poles(actual)),
        ('estimator', lambda: _estimator_theory(believed)),
        *((('regulator', lambda: _regulator_theory(believed)),) if believed.law else ()),
        *((('loops', lambda: _loop_responses(believed, delay)),) if believed.law else ()),
        *((('optimum', lambda: _optimal_cost(actual, believed)),) if believed.law else ()),
    )
    for name, compute in steps:
        try:
            results[name] = compute()
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            results[name] = None
            results['notes'].append(f'{name}: {error}')
    return results


def _operating_point(scenario: Scenario) -> OperatingPoint:
    """Return the operating point; raise DesignError if one point does not suffice."""
    equilibrium = scenario.model.equilibrium
    if scenario.model.input.size:
        return equilibrium
    if not scenario.plan.linear:
        raise DesignError('no steady state: the linearisation changes with the estimate')
    return OperatingPoint(scenario.initial_belief.mean, equilibrium.input)


def _check_detectable(scenario: Scenario, point: OperatingPoint) -> None:
    """Raise DesignError without a steady state, since the search for one takes a minute."""
    result = observability(scenario, point)
    if not result.detectable:
        raise DesignError(f'no steady state: {result}')


def _unseen(believed: Scenario) -> list[str]:
    """Return the names of the states on which no reading depends, now or later."""
    model, x = believed.model, believed.initial_belief.mean
    u, dt = model.equilibrium.input, 1.0 / believed.rate
    A = model.transition(x, u, dt).F
    seen = np.abs(stacked(believed, x)).max(axis=0, initial=0.0) > 0.0
    for _ in model.state.names:
        seen = seen | (np.abs(A[seen]).max(axis=0, initial=0.0) > 0.0)
    return [name for name, there in zip(model.state.names, seen) if not there]


def _open_loop_poles(actual: Scenario) -> list[list[float]]:
    return _pole_pairs(eigenvalues(linearize(actual.model, *_operating_point(actual)).A))


def _regulator_theory(believed: Scenario) -> dict[str, Any]:
    law, dt = feedback(believed), 1.0 / believed.rate
    return {'poles': _pole_pairs(continuous_poles(law.poles, dt)), 'gain': law.gain.tolist()}


def _estimator_theory(believed: Scenario) -> dict[str, Any]:
    """Return the poles of the sampled error.

    The result also has the gains (n, k) of each sensor, row by row, if they are fixed, and the
    ``placed`` poles of the continuous gain of a Luenberger observer.
    """
    dt, point = 1.0 / believed.rate, _operating_point(believed)
    _check_detectable(believed, point)
    step, phases = believed.model.transition(*point, dt), schedule(believed, point.state)
    n = len(step.F)
    results: dict[str, Any] = {}
    fixed = fixed_gain_observer(believed)
    if fixed is not None:
        results['gains'] = {name: _round(L.ravel()) for name, L in fixed.gains.items()}
    gains = periodic_filter([Phase(step.F, step.Q, readings) for readings in phases]).gains
    placed = placed_poles(believed)
    if placed:
        results['placed'] = _pole_pairs(placed)
    transition = np.eye(n)
    for readings, L in zip(phases, gains):
        transition = (np.eye(n) - L @ readings.C) @ step.F @ transition
    poles = eigenvalues(transition) ** (1.0 / len(phases))
    return {**results, 'poles': _pole_pairs(continuous_poles(poles, dt))}


def _loop_responses(believed: Scenario, delay: float) -> list[dict[str, Any]]:
    """Return the loop that is broken at each input, with the known state and the estimate."""
    law = feedback(believed)
    estimator = None
    point = believed.model.equilibrium
    if observability(believed, point).detectable:
        estimator = even_estimator(believed, point)
    results = []
    for channel in input_loops(believed, law, estimator, min(delay, 100.0 / believed.rate)):
        loops = {'known': channel.known, 'estimated': channel.estimated}
        w = _frequencies([loop for loop in loops.values() if loop], believed.rate)
        results.append({
            'input': channel.input,
            'w': _round(w),
            **{name: loop and _loop_response(loop, w) for name, loop in loops.items()},
        })  # fmt: skip
    return results


def _frequencies(loops: Sequence[Loop], rate: float) -> Array:
    margins = [loop.margins or loop.prompt for loop in loops]
    marks = [mark.frequency for m in margins for mark in (m.lower_gain, m.upper_gain, m.lag)]
    low = min((mark for mark in marks if 0.0 < mark < inf), default=0.01 * pi * rate)
    return np.asarray(np.geomspace(0.1 * low, 0.97 * pi * rate, _POINTS), dtype=float)


def _loop_response(loop: Loop, w: Array) -> dict[str, Any]:
    L = loop.broken.response(w)[:, 0, 0]
    result: dict[str, Any] = {'re': _round(L.real), 'im': _round(L.imag), 'margins': None}
    if loop.margins is not None:
        m = loop.margins
        result['margins'] = {
            'lower_gain': _margin_pair(m.lower_gain),
            'upper_gain': _margin_pair(m.upper_gain),
            'lag': _margin_pair(m.lag),
            'delay': _margin_pair(m.delay),
            'disk': m.disk.alpha,
        }
    return result


def _margin_pair(margin: Margin) -> list[float | None]:
    """Return value and frequency of a margin; None for a number that is not finite."""
    return [number if isfinite(number) else None for number in (margin.value, margin.frequency)]


def _optimal_cost(actual: Scenario, believed: Scenario) -> float:
    """Return the least mean cost per second of any controller of the actual plant."""
    dt, point = 1.0 / actual.rate, actual.model.equilibrium
    _check_detectable(actual, point)
    weighted = replace(
        actual, filter='kf', state_cost=believed.state_cost, input_cost=believed.input_cost
    )
    design, _ = regulator(weighted)
    law = Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)
    step = actual.model.transition(*point, dt)
    loop = LqgLoop(step, schedule(weighted, point.state), law.system(dt))
    return LqgTheory(law, price(weighted), loop, dt).expected_cost


def _pole_pairs(poles: Any) -> list[list[float]]:
    """Return the finite poles as pairs of real and imaginary part, the slowest first."""
    finite = [pole for pole in np.atleast_1d(poles).tolist() if np.isfinite(pole)]
    ordered = sorted(finite, key=lambda pole: (-pole.real, abs(pole.imag), pole.imag))
    return [[float(f'{p.real:.6g}'), float(f'{p.imag:.6g}')] for p in ordered]


def _round(values: Any) -> list[float]:
    return [float(f'{value:.5g}') for value in np.asarray(values).tolist()]
