# SPDX-License-Identifier: Apache-2.0
"""The header of an exported loop, its check and its Makefile."""

from __future__ import annotations

import re
from math import ceil, inf, isfinite

import numpy as np

from kalman_ros.core import Space
from kalman_ros.core.model import MOST_SUBSTEPS
from kalman_ros.scenario.lever_arm import LeverArm

from . import law_text
from .identifiers import Names, comment
from .loop import Loop
from .texts import PRECISIONS, named, text

#: Note of a header on the law after an input by hand.
_HANDED_OVER = """. It may
 * be beyond the limits: the law goes on within them, as after NAME_idle"""


def header_texts(loop: Loop, names: Names, precision: str, source: str) -> dict[str, str]:
    """Return the files beside the source, by name.

    Parameters
    ----------
    loop, names
        What is exported, and as what.
    precision
        One of `PRECISIONS`.
    source
        Where the loop is from.
    """
    fields = {k: named(v, names.name) for k, v in _fields(loop, names, precision).items()}
    fields |= _descriptions(loop, names, source)

    def filled(file: str) -> str:
        whole = named(text(file), names.name)
        return re.sub(r'\{\{(\w+)\}\}', lambda field: fields[field[1]], whole)

    return {
        f'{names.name}.h': filled('loop.h'),
        'check.c': filled('check.c'),
        'Makefile': filled('Makefile'),
    }


def _fields(loop: Loop, names: Names, precision: str) -> dict[str, str]:
    n, m, law = loop.space.size, loop.idle.size, loop.law
    allowed = {key: entry.allowed for key, entry in PRECISIONS.items()}
    whole = {
        'summary': f'Precision: {precision}. Rate: {loop.rate:g} steps a second.',
        'real': PRECISIONS[precision].type,
        'STATES': str(n),
        'INPUTS': str(m),
        'SENSORS': str(len(loop.sensors)),
        'states_in_words': _count(n),
        'inputs_in_words': _count(m),
        'most_inputs': str(max(m, 1)),
        'readings': str(loop.longest_reading),
        'calls': _calls(loop),
        'state_places': _places(f'{names.name.upper()}_X', names.states),
        'input_places': '',
        'model_fields': _model_fields(loop),
        'corrections': '\n'.join(
            f'NAME_outcome NAME_correct_{suffix}(NAME_loop *loop, const NAME_real *y, '
            'const NAME_real *R);'
            for suffix in names.sensors.values()
        ),
        'cases': '\n'.join(
            f'    case {k}: return NAME_correct_{suffix}(loop, y, R);'
            for k, suffix in enumerate(names.sensors.values())
        ),
        'sizes': ', '.join(str(sensor.output.size) for sensor in loop.sensors.values()),
        'dt': repr(1.0 / loop.rate),
        'allowed': allowed['float64'],
        'allowed_float': allowed['float32'],
        'law_fields': '' if law is None else law_text.fields(law),
        'law_functions': '' if law is None else law_text.functions(law),
        'law_cases': '' if law is None else law_text.cases(law),
        'control': '' if law is None else law_text.timed(loop.rate),
        'worth': (
            'PREFIX_RESTARTED of NAME_predict and\n * PREFIX_NOT_FINITE of NAME_control are'
            if law is not None
            else 'PREFIX_RESTARTED of\n * NAME_predict is'
        ),
        'long': _longest(loop),
        'init': '' if law is None else '; the state at rest is held',
        'handed_over': '' if law is None else _HANDED_OVER,
    }
    if m:
        places = _places(f'{names.name.upper()}_U', names.inputs)
        whole['input_places'] = f'\n/* Places in u. */\nenum {{\n{places}\n}};\n'
    return whole


def _count(size: int) -> str:
    return f'{size} number{"" if size == 1 else "s"}'


def _descriptions(loop: Loop, names: Names, source: str) -> dict[str, str]:
    """Return what a person wrote, in which no name is replaced."""
    return {
        'title': comment(f'{names.name}: {_summary(loop)}'),
        'source': comment(source),
        'states': _listed(loop.space),
        'inputs': '\n'.join([_listed(loop.scenario.model.input), *_limit_lines(loop)]),
        'sensors': '\n'.join(_sensor_lines(loop, names)),
    }


def _limit_lines(loop: Loop) -> list[str]:
    if loop.law is None:
        return []
    limits = loop.law.limits
    pairs = (
        ('at least', limits.lower), ('at most', limits.upper), ('a second at most', limits.rate)
    )  # fmt: skip
    return [
        f' *     {what}: {", ".join(f"{value:g}" for value in values)}'
        for what, values in pairs
        if np.isfinite(values).any()
    ]


def _summary(loop: Loop) -> str:
    control = f' and its law ({loop.scenario.law})' if loop.law else ''
    return f'an estimator ({loop.scenario.filter}){control} in C99, without heap'


def _calls(loop: Loop) -> str:
    """Return what is called last in a step."""
    if loop.law is not None:
        return ' *     NAME_control(&loop, dt, u);              what to send to the actuators'
    if loop.idle.size:
        return ' *     NAME_input(&loop, u);                    the input that acts from now on'
    return ' *'


def _places(prefix: str, names: dict[str, str]) -> str:
    return ',\n'.join(f'    {prefix}_{suffix} = {k}' for k, suffix in enumerate(names.values()))


def _longest(loop: Loop) -> str:
    """Return what a long step is, and what it takes."""
    model, gap = loop.scenario.believed.model, loop.estimation.policy.max_gap
    lines = [f'After more than {gap:g} s the first belief is taken again.'] if gap else []
    if model.is_discrete:
        lines.append(
            f'The model has steps of {model.period:g} s: the one nearest to the time counts.'
        )
    elif not model.is_linear and isfinite(model.max_step):
        parts = min(ceil((gap or inf) / model.max_step) if gap else MOST_SUBSTEPS, MOST_SUBSTEPS)
        lines.append(
            f'A step is integrated in parts of at most {model.max_step:g} s, up to {parts}: one'
        )
        lines.append('after a pause takes longer by as much.')
    return '\n'.join(f' * {line.strip()}' for line in lines) or ' *'


def _model_fields(loop: Loop) -> str:
    n, m = loop.space.size, loop.idle.size
    if not loop.scenario.believed.model.is_linear:
        return ''
    return (
        f'    NAME_real dt, F[{n} * {n}], G[{max(n * m, 1)}], Q[{n} * {n}]; '
        '/* of the last length of a step */\n'
    )


def _sensor_lines(loop: Loop, names: Names) -> list[str]:
    lines = []
    for name, sensor in loop.sensors.items():
        signal = loop.scenario.sensors[name].signal
        turned = ', in the axes of the body' if signal.mounting.turned else ''
        if isinstance(sensor, LeverArm):
            place = ', '.join(f'{value:g}' for value in sensor.arm)
            turned += f', at its place, ({place}) m forward, left and up of the centre'
        std = ', '.join(f'{value:g}' for value in np.sqrt(sensor.covariance.diagonal()))
        lines.append(
            f' *     {names.sensors[name]}: {comment(str(sensor.output))}{turned}; '
            f'standard deviation {std}'
        )
    return lines


def _listed(space: Space) -> str:
    lines = [f' *     {k}: {comment(space.label(name))}' for k, name in enumerate(space.names)]
    for rotation in space.rotations:
        lines.append(f' *     ({comment(", ".join(rotation))}) is a rotation vector')
    return '\n'.join(lines) or ' *     none'
