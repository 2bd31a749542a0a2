# SPDX-License-Identifier: Apache-2.0
"""Formulas as plain C99, in single or double precision: one operation a line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isinf, isnan

import casadi

from kalman_ros.compiled.tracing import Trace
from kalman_ros.core import Array

#: Functions of the C library of one number and of two.
OF_ONE = (
    'acos', 'acosh', 'asin', 'asinh', 'atan', 'atanh', 'ceil', 'cos', 'cosh', 'erf', 'exp',
    'expm1', 'floor', 'log', 'log1p', 'sin', 'sinh', 'sqrt', 'tan', 'tanh',
)  # fmt: skip
OF_TWO = ('atan2', 'copysign', 'fmax', 'fmin', 'fmod', 'hypot', 'pow')
#: Those that the texts in c/ call, too.
FUNCTIONS = (*OF_ONE, *OF_TWO, 'fabs', 'ldexp', 'llround', 'log2')
#: How C writes an operation of one or two numbers.
_OPERATIONS: dict[int, str] = {
    **{getattr(casadi, f'OP_{name.upper()}'): f'{name}({{0}})' for name in OF_ONE},
    **{getattr(casadi, f'OP_{name.upper()}'): f'{name}({{0}}, {{1}})' for name in OF_TWO},
    casadi.OP_ASSIGN: '{0}',
    casadi.OP_ADD: '{0} + {1}',
    casadi.OP_SUB: '{0} - {1}',
    casadi.OP_MUL: '{0} * {1}',
    casadi.OP_DIV: '{0} / {1}',
    casadi.OP_NEG: '-{0}',
    casadi.OP_SQ: '{0} * {0}',
    casadi.OP_TWICE: '2 * {0}',
    casadi.OP_INV: '1 / {0}',
    casadi.OP_FABS: 'fabs({0})',
    casadi.OP_SIGN: '(real)(({0} > 0) - ({0} < 0))',
    casadi.OP_IF_ELSE_ZERO: '{0} != 0 ? {1} : 0',
    casadi.OP_LT: '(real)({0} < {1})',
    casadi.OP_LE: '(real)({0} <= {1})',
    casadi.OP_EQ: '(real)({0} == {1})',
    casadi.OP_NE: '(real)({0} != {1})',
    casadi.OP_NOT: '(real)({0} == 0)',
    casadi.OP_AND: '(real)({0} != 0 && {1} != 0)',
    casadi.OP_OR: '(real)({0} != 0 || {1} != 0)',
    casadi.OP_CONSTPOW: 'pow({0}, {1})',
}


#: Operations whose result may be infinite, or not a number, for finite ones.
_POLES = {getattr(casadi, f'OP_{name}') for name in ('DIV', 'INV', 'POW', 'CONSTPOW', 'LOG')}


def has_poles(trace: Trace) -> bool:
    """Return whether a traced function may be infinite, or no number, at finite arguments."""
    computed = trace.function('f')
    operations = (computed.instruction_id(k) for k in range(computed.n_instructions()))
    return not _POLES.isdisjoint(operations)


def number(value: float) -> str:
    """Return a number as C."""
    if isnan(value):
        return 'NAN'
    if isinf(value):
        return 'INFINITY' if value > 0 else '-INFINITY'
    text = repr(float(value))
    return f'R({text})' if '.' in text or 'e' in text else f'R({text}.0)'


def numbers(name: str, values: Array) -> str:
    """Return constants as C; one of them at least, which C demands."""
    listed = ', '.join(map(number, values.ravel().tolist())) or '0'
    return f'static const real {name}[] = {{{listed}}};\n'


def function(
    name: str, trace: Trace, arguments: Sequence[str], *, by_rows: bool = False, dense: bool = True
) -> str:
    """Return a traced function as C: ``static void name(const real *..., real *result)``.

    Parameters
    ----------
    name
        That of the function.
    trace
        Its formulas.
    arguments
        The names of its vectors.
    by_rows
        Whether a matrix is stored row by row.
    dense
        Whether numbers that are always zero are stored.

    Raises
    ------
    ValueError
        If C lacks an operation.
    """
    stored = casadi.densify(trace.result) if dense else trace.result
    computed = Trace(trace.variables, stored.T if by_rows else stored).function('f')
    known: dict[int, Callable[[int], str]] = {
        casadi.OP_CONST: lambda k: number(computed.instruction_constant(k)),
        casadi.OP_INPUT: lambda k: (
            f'{arguments[computed.instruction_input(k)[0]]}[{computed.instruction_input(k)[1]}]'
        ),
    }
    lines, used = [], set()
    for k in range(computed.n_instructions()):
        operation, to = computed.instruction_id(k), computed.instruction_output(k)
        operands = computed.instruction_input(k)
        if operation == casadi.OP_OUTPUT:
            lines.append(f'result[{to[1]}] = w{operands[0]};')
            continue
        if operation == casadi.OP_INPUT:
            used.add(operands[0])
        if operation in known:
            value = known[operation](k)
        elif operation in _OPERATIONS:
            value = _OPERATIONS[operation].format(*(f'w{operand}' for operand in operands))
        else:
            raise ValueError(f'{name}: C has no function for an operation of its formulas')
        lines.append(f'w{to[0]} = {value};')
    size = computed.sz_w()
    variables = [f'real {", ".join(f"w{k}" for k in range(size))};'] if size else []
    unused = [f'(void){argument};' for k, argument in enumerate(arguments) if k not in used]
    if not any(line.startswith('result') for line in lines):
        unused.append('(void)result;')
    parameters = ', '.join(f'const real *{argument}' for argument in arguments)
    body = ''.join(f'    {line}\n' for line in (*variables, *unused, *lines))
    return f'static void {name}({parameters}, real *result)\n{{\n{body}}}\n'
