# SPDX-License-Identifier: Apache-2.0
"""The C of sensors: what they read, how that changes, and how a belief arrives at its new mean."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.compiled.formulas import of_sensor, of_space
from kalman_ros.compiled.free_parameters import Parameters
from kalman_ros.core import Sensor, Space
from kalman_ros.estimators.fixed_gain import FixedGainObserver

from .expressions import function, has_poles, number, numbers
from .identifiers import Names
from .loop import Loop
from .texts import angles, difference, text

#: Function of ``differences.c``.
_DIFFERENCED = 'differenced'


def sensor_texts(loop: Loop, names: Names) -> list[str]:
    """Return the texts of the sensors of a loop, and their table."""
    texts: list[str] = []
    rows = []
    gates = loop.estimation.policy.gates or {}
    filter: Any = loop.estimation.filter
    for k, (name, sensor) in enumerate(loop.sensors.items()):
        suffix, gain = str(k), '0'  # a name of a user may be that of another function
        texts += [f'/* {names.sensors[name]} */\n', *_of_sensor(suffix, sensor, loop.space)]
        if isinstance(filter, FixedGainObserver):
            gain = f'GAIN_{suffix}'
            texts.append(numbers(gain, np.asarray(filter.gains[name])))
        rows.append(
            f'    {{{sensor.output.size}, COVARIANCE_{suffix}, {number(gates.get(name, 0.0))}, '
            f'measure_{suffix}, jacobian_{suffix}, difference_{suffix}, {gain}, '
            f'ANGLES_{suffix}}},\n'
        )
    table = f'static const sensor SENSOR[] = {{\n{"".join(rows)}}};\n'
    differenced = any(f'{_DIFFERENCED}(' in part for part in texts)
    differences = [text('differences.c')] if differenced else []
    return [text('sensors.c'), *differences, *texts, table, _arrived(loop.space)]


def point_texts(filter: Any, space: Space) -> list[str]:
    """Return what an unscented filter needs."""
    weights = filter.covariance_weights
    return [
        f'enum {{ POINTS = {2 * space.size + 1} }};\n'
        f'#define SPREAD {number(float(filter.directions[0, 1]))}\n'
        f'#define CENTRE_OF_MEAN {float(filter.mean_weights[0])!r}\n'
        f'#define CENTRE {float(weights[0])!r}\n#define OTHERS {float(weights[1])!r}\n',
        angles('ANGLES', space),
        difference('state_difference', space),
    ]


def _of_sensor(suffix: str, sensor: Sensor, state: Space) -> list[str]:
    parameters = Parameters(sensor)
    formulas = of_sensor(sensor, state, parameters)
    texts = [
        numbers(f'NUMBERS_{suffix}', parameters.values),
        difference(f'difference_{suffix}', sensor.output),
    ]
    size = sensor.output.size
    # a Jacobian may have places without a finite value
    differenced = not state.rotations and has_poles(formulas.jacobian)
    elsewhere = (
        f'    if (!are_finite(result, {size} * N))\n'
        f'        {_DIFFERENCED}(x, {size}, measure_{suffix}, difference_{suffix}, result);\n'
    )
    for kind, formula in (('measure', formulas.measure), ('jacobian', formulas.jacobian)):
        called, by_rows = f'{kind}_{suffix}', kind == 'jacobian'
        texts.append(function(f'{called}_of', formula, ['x', 'p'], by_rows=by_rows))
        texts.append(
            f'static void {called}(const real *x, real *result)\n{{\n'
            f'    {called}_of(x, NUMBERS_{suffix}, result);\n'
            f'{elsewhere if by_rows and differenced else ""}}}\n'
        )
    return [
        *texts,
        numbers(f'COVARIANCE_{suffix}', sensor.covariance),
        angles(f'ANGLES_{suffix}', sensor.output),
    ]


def _arrived(state: Space) -> str:
    head = (
        'static void arrived(const real *total, const real *origin, const real *P, real *x,\n'
        '                    real *P_x)\n{\n'
    )
    if not state.rotations:
        plain = '    (void)origin;\n    wrap(total, x);\n    memcpy(P_x, P, N * N * sizeof *P);\n'
        return f'{head}{plain}}}\n'
    moved = function('arrive', of_space(state).arrived, ['total', 'origin', 'P'])
    return (
        f'{moved}\n{head}    real both[N + N * N];\n    arrive(total, origin, P, both);\n'
        '    memcpy(x, both, N * sizeof *x);\n'
        '    memcpy(P_x, both + N, N * N * sizeof *P);\n}\n'
    )
