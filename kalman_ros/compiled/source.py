# SPDX-License-Identifier: Apache-2.0
"""Whole files of C: constants, functions, and the files of this package that use them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from .library import HEAD

if TYPE_CHECKING:
    from .tracing import Trace


def text(
    endings: Sequence[str], constants: Mapping[str, float], head: str = HEAD, *definitions: str
) -> str:
    """Return a whole file of C.

    Parameters
    ----------
    endings
        The names of the files of this package that use all that is before them.
    constants
        Numbers by name.
    head
        Its beginning.
    definitions
        What stands between constants and endings.
    """
    defined = ''.join(f'#define {name} {value}\n' for name, value in constants.items())
    texts = (files(__package__).joinpath(ending).read_text() for ending in endings)
    return '\n'.join((head, defined, *definitions, *texts))


def places(name: str, numbers: Iterable[tuple[int, int]]) -> str:
    """Return rows and columns of the numbers of a matrix, row by row, as C."""
    listed = [*zip(*numbers)] or [(), ()]
    count = len(listed[0])
    declared = f'enum {{ {name}_COUNT = {count} }};\n'
    for kind, values in zip(('ROW', 'COLUMN'), listed):
        initial = ', '.join(map(str, values)) or '0'
        declared += f'static const int {name}_{kind}[] = {{{initial}}};\n'
    return declared


def not_zero(matrix: Any) -> list[tuple[int, int]]:
    """Return the places of the numbers of a matrix of CasADi, row by row."""
    columns, rows = matrix.T.sparsity().get_triplet()  # CasADi has them column by column
    return [*zip(rows, columns)]


def source(
    endings: Sequence[str],
    constants: Mapping[str, float],
    traces: Mapping[str, Trace],
    sparse: Mapping[str, Trace],
) -> str:
    """Return a whole file of C of traced functions.

    Parameters
    ----------
    endings, constants
        As of `text`.
    traces
        Functions by name; each becomes ``name(v0, v1, ..., result)``.
    sparse
        Those of which the `places` are defined, by the name of the matrix.
    """
    import casadi  # which what needs no formulas does without

    generator = casadi.CodeGenerator('generated.c', {'with_header': False})
    wrappers = []
    for name, trace in traces.items():
        by_rows = any(trace is matrix for matrix in sparse.values())
        # a number that is always zero is left out by CasADi, but has its place in a vector
        stored = trace.result.T if by_rows else casadi.densify(trace.result)
        function = trace._replace(result=stored).function(f'generated_{name}')
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
    sparsity = ''.join(places(name, not_zero(trace.result)) for name, trace in sparse.items())
    return text(endings, constants, f'{HEAD}\n{generator.dump()}', sparsity, *wrappers)
