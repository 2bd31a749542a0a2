# SPDX-License-Identifier: Apache-2.0
"""The C of a loop: a header and one source, of generated formulas, numbers and the texts in c/."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kalman_ros.compiled.library import FAST
from kalman_ros.compiled.untraceable import UntraceableError
from kalman_ros.core import Gaussian, Sensor
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter
from kalman_ros.estimators.policy import Policy

from .expressions import OF_ONE, OF_TWO, numbers
from .header import header_texts
from .identifiers import Names
from .law_text import law_texts
from .loop import Loop
from .model_text import model_texts
from .sensor_text import point_texts, sensor_texts
from .texts import PRECISIONS, named, text

#: The variances that single precision computes with.
_VARIANCES = 1e12, 1e-15
#: For any processor.
_PLAIN = '#define FAST\n#define INLINE static\n#define UNROLLED\n#define WIDE 0\n'


def loop_files(loop: Loop, name: str, precision: str, source: str) -> dict[str, str]:
    """Return the files of a loop, by name.

    Parameters
    ----------
    loop
        What is exported.
    name
        The beginning of every public name.
    precision
        One of `PRECISIONS`.
    source
        Where the loop is from, for the header.

    Raises
    ------
    ValueError
        If C does not accept a name, or a function cannot be traced.
    """
    if precision not in PRECISIONS:
        raise ValueError(f"precision: expected {' or '.join(PRECISIONS)}, got '{precision}'")
    names = Names.of(loop, name)
    law = () if loop.law is None else law_texts(loop.law, loop.rate)
    parts = [*_filter(loop, names, precision, _PLAIN), text('gate.c'), *law, text('estimator.c')]
    for k, suffix in enumerate(names.sensors.values()):
        parts.append(
            f'NAME_outcome NAME_correct_{suffix}(NAME_loop *s, const real *y, const real *R_y)\n'
            f'{{\n    return correct(s, {k}, y, R_y);\n}}\n'
        )
    whole = {f'{name}.c': named('\n'.join(parts), name)}
    files = header_texts(loop, names, precision, source)
    return {file: (whole | files)[file] for file in (f'{name}.h', *whole, *files)}


def counting_files(files: Mapping[str, str], name: str) -> dict[str, str]:
    """Return files of a loop as C++ whose numbers count the operations on them, by name."""
    functions = ''.join(
        f'{kind}({operation}) '
        for kind, names in (('OF_ONE', (*OF_ONE, 'fabs', 'log2')), ('OF_TWO', OF_TWO))
        for operation in names
    )
    counted = text('counted.hpp').replace('{{functions}}', functions)
    plain = files[f'{name}.c'].replace(PRECISIONS['float32'].functions, '')
    number = re.compile(rf'^typedef \w+ {name}_real;$', re.MULTILINE)
    header = number.sub(f'typedef counted {name}_real;', files[f'{name}.h'])
    return {
        'counted.hpp': counted,
        f'{name}.h': f'#include "counted.hpp"\n{header}',
        f'{name}.cpp': plain,
        'check.cpp': files['check.c'],
        'vectors.txt': files['vectors.txt'],
    }


def filter_source(loop: Loop) -> str:
    """Return one file with the filter alone, for this machine.

    Raises
    ------
    ValueError
        As `loop_files`.
    """
    name = 'loop'
    names = Names.by_number(loop, name)
    loop = _without_numbers(loop)
    header = header_texts(loop, names, 'float64', '')[f'{name}.h']
    size = 'unsigned long filter_size(void) { return sizeof(NAME_loop); }\n'
    body = '\n'.join([*_filter(loop, names, 'float64', FAST), text('filter.c')])
    return '\n'.join((header, named(f'{size}\n{body}'.replace('#include "NAME.h"', ''), name)))


def _without_numbers(loop: Loop) -> Loop:
    """Return a loop without what is given with each call, so that a change compiles nothing.

    Those are the noise of sensors, the gates and the first belief.
    """
    estimator = loop.estimation
    first = Gaussian(
        np.zeros_like(estimator.initial.mean), np.zeros_like(estimator.initial.covariance)
    )
    plain = replace(estimator, initial=first, policy=Policy())
    sources = {
        name: replace(source, timed=replace(source.timed, sensor=_noiseless(source.sensor)))
        for name, source in loop.scenario.sensors.items()
    }
    return replace(loop, scenario=replace(loop.scenario, sensors=sources), estimation=plain)


def _noiseless(sensor: Sensor) -> Sensor:
    return sensor.with_covariance(np.eye(len(sensor.covariance)))


def _filter(loop: Loop, names: Names, precision: str, fast: str) -> list[str]:
    """Return the texts up to the update, for a processor that ``fast`` is about."""
    try:
        return _parts(loop, names, precision, fast)
    except UntraceableError as error:
        raise ValueError(f'{error}, so that there is no C of it') from None


def _check_range(loop: Loop) -> None:
    """Raise ValueError where single precision cannot hold the square of a variance."""
    noise = {name: sensor.covariance for name, sensor in loop.sensors.items()}
    for name, covariance in {'initial_std': loop.estimation.initial.covariance, **noise}.items():
        variances = covariance.diagonal()
        largest, least = _VARIANCES
        if np.any(variances > largest) or np.any((variances > 0.0) & (variances < least)):
            raise ValueError(
                f'precision: float32 computes with variances from {least:g} to {largest:g}, and '
                f'one of {name} is {variances.max():g}'
            )


def _parts(loop: Loop, names: Names, precision: str, fast: str) -> list[str]:
    chosen, policy = PRECISIONS[precision], loop.estimation.policy
    if precision == 'float32':
        _check_range(loop)
    filter, first = loop.estimation.filter, loop.estimation.initial
    defined = {
        'N': loop.space.size,
        'M': loop.idle.size,
        'SENSORS': len(loop.sensors),
        'K_MOST': loop.longest_reading,
        'REPAIRS': chosen.repairs,
        'DIFFERENCE': chosen.difference,
        'REACHED': chosen.reached,
        'AT_A_STEP': chosen.at_a_step,
        'MAX_GAP': f'INT64_C({round(policy.max_gap * 1e9)})',
        'RECOVER_AFTER': policy.recover_after,
    }
    unscented = isinstance(filter, UnscentedKalmanFilter)
    return [
        text('head.c'),
        fast,
        chosen.functions,
        ''.join(f'#define {key} {value}\n' for key, value in defined.items()),
        numbers('FIRST_MEAN', first.mean),
        numbers('FIRST_COVARIANCE', first.covariance),
        numbers('IDLE', loop.idle),
        *model_texts(loop.scenario.believed.model, points=unscented),
        text('matrices.c'),
        *sensor_texts(loop, names),
        *(point_texts(filter, loop.space) if unscented else ()),
        text('update.c'),
        text('unscented_update.c' if unscented else 'linear_update.c'),
    ]
