# SPDX-License-Identifier: Apache-2.0
"""Formulas as C: each traced function as one that takes vectors and returns numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import casadi

from .library import HEAD
from .tracing import Trace


def places(name: str, result: Any) -> str:
    """Return the rows and columns of the numbers of a matrix that are not zero, as C.

    CasADi has them column by column; here they are row by row, as those of the transpose.
    """
    columns, rows = result.T.sparsity().get_triplet()
    text = f'enum {{ {name}_COUNT = {len(rows)} }};\n'
    for kind, values in (('ROW', rows), ('COLUMN', columns)):
        listed = ', '.join(map(str, values)) or '0'
        text += f'static const int {name}_{kind}[] = {{{listed}}};\n'
    return text


def source(
    endings: Sequence[str],
    constants: Mapping[str, float],
    traces: Mapping[str, Trace],
    sparse: Mapping[str, Trace],
) -> str:
    """Return a whole file of C.

    Parameters
    ----------
    endings
        The names of the files of this package that use all that is before them.
    constants
        Numbers by name.
    traces
        Functions by name; each becomes ``name(v0, v1, ..., result)``.
    sparse
        Those of which the `places` are defined, by the name of the matrix.
    """
    generator = casadi.CodeGenerator('generated.c', {'with_header': False})
    wrappers = []
    for name, trace in traces.items():
        by_rows = any(trace is matrix for matrix in sparse.values())
        # a number that is always zero is left out by CasADi, but has its place in a vector
        stored = trace.result.T if by_rows else casadi.densify(trace.result)
        function = Trace(trace.variables, stored).function(f'generated_{name}')
        generator.add(function)
        arguments = ', '.join(f'v{k}' for k in range(function.n_in()))
        parameters = ', '.join(f'const double *v{k}' for k in range(function.n_in()))
        wrappers.append(
            f'static void {name}({parameters}, double *result)\n{{\n'
            f'    const double *arg[{function.sz_arg()}] = {{{arguments}}};\n'
            f'    double *res[{function.sz_res()}] = {{result}}, w[{function.sz_w() + 1}];\n'
            f'    casadi_int iw[{function.sz_iw() + 1}];\n'
            f'    generated_{name}(arg, res, iw, w, 0);\n}}\n'
        )
    defined = [f'#define {name} {value}\n' for name, value in constants.items()]
    defined += [places(name, trace.result) for name, trace in sparse.items()]
    texts = (files(__package__).joinpath(ending).read_text() for ending in endings)
    return '\n'.join((HEAD, generator.dump(), ''.join(defined), *wrappers, *texts))
