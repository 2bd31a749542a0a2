# SPDX-License-Identifier: Apache-2.0
"""The C of a model: a step and its linearisation, by formulas or by matrices."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from kalman_ros.compiled.formulas import of_discrete_model, of_model
from kalman_ros.compiled.free_parameters import Parameters
from kalman_ros.compiled.native_model import FLOW
from kalman_ros.compiled.source import not_zero, places
from kalman_ros.compiled.tracing import Trace, trace
from kalman_ros.core.discrete_model import MOST_PERIODS
from kalman_ros.core.model import MOST_SUBSTEPS

from .expressions import function, number, numbers
from .texts import constant, probes, shared, text


def model_texts(model: Any, *, points: bool) -> list[str]:
    """Return the texts of a model, with a step of `points` alone for filters that need it."""
    if not model.is_linear:
        texts = _nonlinear_discrete(model) if model.is_discrete else _nonlinear(model)
        return [*texts, *([text('nonlinear_points.c')] if points else ())]
    wrap = trace(model.state.wrap, *((probe,) for probe in probes(model.state.size)))
    linear = _discrete(model) if model.is_discrete else _continuous(model)
    return [function('wrap', wrap, ['x']), *linear, text('linear_model.c')]


def _discrete(model: Any) -> list[str]:
    step = model.transition(np.zeros(model.state.size), np.zeros(model.input.size), model.period)
    return [
        'enum { DONE = 0, OVERFLOW_WITHIN = 2 };\n',
        _periods(model),
        numbers('STATE_MATRIX', step.F),
        numbers('INPUT_MATRIX', step.G),
        numbers('NOISE_COVARIANCE', step.Q),
        text('periods.c'),
    ]


def _periods(model: Any) -> str:
    return (
        f'#define PERIOD {number(model.period)}\n#define PERIOD_NS {model.period * 1e9!r}\n'
        f'#define MOST_PERIODS {MOST_PERIODS}\n'
    )


def _continuous(model: Any) -> list[str]:
    """Return the flow of the state with its input behind it."""
    n, m = model.state.size, model.input.size
    zeros = np.zeros(n), np.zeros(m)
    whole, density = np.zeros((n + m, n + m)), np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = model.state_jacobian(*zeros), model.input_jacobian(*zeros)
    density[:n, :n] = model.noise_density(zeros[0])
    return [
        '#define ORDER (N + M)\n',
        constant('jacobian', whole, 'xup'),
        constant('density', density, 'xp'),
        places('A', zip(*np.nonzero(whole))),
        places('W', zip(*np.nonzero(density))),
        *map(shared, FLOW),
        text('sample.c'),
    ]


def _nonlinear(model: Any) -> list[str]:
    parameters = Parameters(model)
    formulas = of_model(model, parameters)
    texts = [
        f'#define ORDER N\n#define MOST_SUBSTEPS {min(formulas.most, MOST_SUBSTEPS)}\n'
        f'#define MAX_STEP {number(model.max_step)}\n',
        numbers('NUMBERS', parameters.values),
        function('substep', formulas.substep, ['x', 'u', 'h', 'p']),
        function('wrap', formulas.wrap, ['x']),
    ]
    sparse = [
        ('A', 'jacobian', formulas.jacobian, 'xup'),
        ('W', 'density', formulas.density, 'xp'),
    ]
    if formulas.slope is not None:
        texts.append('#define SLOPE\n')
        sparse.append(('F', 'slope', formulas.slope, 'xuhp'))
    shared_texts = map(shared, (*FLOW, 'step.c'))
    return [*texts, *_sparse(sparse), *shared_texts, text('nonlinear_model.c')]


def _nonlinear_discrete(model: Any) -> list[str]:
    parameters = Parameters(model)
    formulas = of_discrete_model(model, parameters)
    sparse = [('F', 'slope', formulas.slope, 'xup'), ('W', 'density', formulas.density, 'xp')]
    return [
        '#define ORDER N\n#define MAX_STEP INFINITY\n#define MOST_SUBSTEPS 1\n',
        _periods(model),
        '#define TOLERANCE R(0.5)\n',  # the estimator rounds to whole periods
        numbers('NUMBERS', parameters.values),
        function('substep', formulas.substep, ['x', 'u', 'p']),
        function('wrap', formulas.wrap, ['x']),
        function('period', formulas.period, ['p']),
        *_sparse(sparse),
        *map(shared, ('matrices.c', 'sampled.c')),
        text('nonlinear_model.c'),
    ]


def _sparse(formulas: Iterable[tuple[str, str, Trace, str]]) -> Iterator[str]:
    """Yield functions of matrices, each with where its numbers are."""
    for key, name, formula, arguments in formulas:
        yield function(name, formula, [*arguments], by_rows=True, dense=False)
        yield places(key, not_zero(formula.result))
