# SPDX-License-Identifier: Apache-2.0
"""The texts in c/, and what they are filled with: constants, places and small functions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from kalman_ros.compiled.tracing import trace
from kalman_ros.core import Array, Space

from .expressions import FUNCTIONS, function, number


class Precision(NamedTuple):
    """A precision: its type in C, what is defined for it, and how near a result has to be.

    ``repairs`` of a covariance are relative to its largest variance, a reference is ``reached``
    within a share of its size, a time is that of a step within a share of it (``at_a_step``),
    differences are taken at a share (``difference``) of a number, and test vectors may differ by
    a share ``allowed``.
    """

    type: str
    repairs: str
    reached: str
    at_a_step: str
    difference: str
    allowed: str
    functions: str = ''


PRECISIONS: Mapping[str, Precision] = {
    'float64': Precision(
        'double',
        '{1e-14, 1e-12, 1e-10, 1e-8}',
        '1e-9',
        '1e-6',
        repr(float(np.finfo(float).eps) ** (1 / 3)),
        '1e-9',
    ),
    'float32': Precision(
        'float',
        '{1e-6f, 1e-5f, 1e-4f, 1e-3f}',
        '1e-4f',
        '1e-3',
        '5e-3f',
        '1e-2',
        # no number is promoted
        ''.join(f'#undef {symbol}\n#define {symbol} {symbol}f\n' for symbol in FUNCTIONS),
    ),
}


def text(name: str) -> str:
    """Return a text of this package."""
    return files(__package__).joinpath(f'c/{name}').read_text()


def named(contents: str, name: str) -> str:
    """Return a text with the name of a loop in the place of NAME and PREFIX, where these begin."""
    upper = f'{name.upper()}_'
    return re.sub(
        r'\bPREFIX_|(?<![A-Za-z0-9_])NAME(?=[_.]|\b)|(?<=lib)NAME(?=[.])',
        lambda match: upper if match[0] == 'PREFIX_' else name,
        contents,
    )


def shared(name: str) -> str:
    """Return a text that models are compiled with, too."""
    return files('kalman_ros.compiled').joinpath(name).read_text()


def probes(n: int) -> Array:
    """Return vectors (3, n) at which formulas are compared with functions."""
    return 2.0 * np.random.default_rng(0).standard_normal((3, n))


def addition(name: str, space: Space) -> str:
    """Return the function that moves a vector a of a space by a difference b."""
    points = 0.3 * probes(space.size)
    return function(name, trace(space.add, *zip(points, 0.1 * points[::-1])), ['a', 'b'])


def difference(name: str, space: Space) -> str:
    """Return the function a - b of vectors of a space."""
    points = 0.3 * probes(space.size)
    formula = trace(space.subtract, *zip(points, points[::-1] + 0.1))
    return function(name, formula, ['a', 'b'])


def angles(name: str, space: Space) -> str:
    """Return the marks of the angles among the coordinates of a space."""
    marks = ', '.join('1' if coordinate in space.angles else '0' for coordinate in space.names)
    return f'static const signed char {name}[] = {{{marks}}};\n'


def constant(name: str, matrix: Array, arguments: Sequence[str]) -> str:
    """Return a function that writes the numbers of a matrix that are not zero, row by row."""
    entries = matrix[np.nonzero(matrix)].tolist()
    body = ''.join(f'    result[{k}] = {number(value)};\n' for k, value in enumerate(entries))
    unused = ''.join(f'    (void){argument};\n' for argument in arguments)
    listed = ', '.join(f'const real *{argument}' for argument in arguments)
    silent = '' if entries else '    (void)result;\n'
    return f'static void {name}({listed}, real *result)\n{{\n{unused}{silent}{body}}}\n'
