# SPDX-License-Identifier: Apache-2.0
"""Arrays of numbers that are not known yet: numpy computes with them, and formulas result.

An element is a `Symbol`, which holds an expression of CasADi (J. Andersson et al., CasADi: a
software framework for nonlinear optimization and optimal control, Mathematical Programming
Computation 11, 2019). `Symbols` are arrays of them, so that code written for numbers, with any
leading axes, takes them as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from .branches import decide, every_way
from .untraceable import UntraceableError

#: The least number under a root: its derivative at zero is then finite.
_LEAST = 1e-300


class Symbol:
    """A number that is not known yet."""

    __slots__ = ('formula',)
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, formula: Any) -> None:
        self.formula = formula

    def __float__(self) -> float:
        if self.formula.is_constant():
            return float(self.formula)
        raise UntraceableError('it stores what depends on the state in an array of plain numbers')

    def __bool__(self) -> bool:
        return decide(self.formula)

    def __neg__(self) -> Symbol:
        return Symbol(-self.formula)

    def __pos__(self) -> Symbol:
        return self

    def __round__(self) -> Symbol:
        return Symbol(_rounded(self.formula))

    def __abs__(self) -> Symbol:
        return Symbol(casadi.fabs(self.formula))

    def __mod__(self, other: Any) -> Symbol:
        """Return the remainder that has the sign of the divisor, as Python's does."""
        divisor = formula(other)
        remainder = casadi.fmod(self.formula, divisor)  # exact, however large the number
        opposite = remainder * divisor < 0
        return Symbol(remainder + casadi.if_else(opposite, divisor, 0))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return getattr(ufunc, method)(*map(_array, inputs), **options)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        return function(*map(_array, inputs), **options)


def formula(value: Any) -> Any:
    """Return the expression of a symbol, or of a number."""
    if isinstance(value, Symbols):
        value = value.item()
    return value.formula if isinstance(value, Symbol) else casadi.SX(float(value))


def _array(value: Any) -> Any:
    """Return the symbols in a value, or in a list of values, as arrays."""
    if isinstance(value, Symbol):
        whole = np.empty((), dtype=object)
        whole[()] = value
        return whole.view(Symbols)
    if isinstance(value, (list, tuple)):
        return type(value)(map(_array, value))
    return value


def _arithmetic(name: str) -> Callable[[Symbol, Any], Any]:
    def apply(self: Symbol, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        kind = Symbol if name in _COUNTING else Truth
        if kind is Symbol and isinstance(self, Truth) and isinstance(other, (Truth, bool)):
            raise UntraceableError('it computes with truths as if they were numbers')
        return kind(getattr(self.formula, name)(formula(other)))

    return apply


class Truth(Symbol):
    """Whether something holds, as 1 or 0; of several, numpy has other sums than of numbers."""

    __slots__ = ()

    def __and__(self, other: Any) -> Truth:
        return Truth(casadi.logic_and(self.formula, formula(other)))

    def __or__(self, other: Any) -> Truth:
        return Truth(casadi.logic_or(self.formula, formula(other)))

    def __invert__(self) -> Truth:
        return Truth(casadi.logic_not(self.formula))

    __rand__, __ror__ = __and__, __or__


_COUNTING = {
    f'__{r}{name}__' for name in ('add', 'sub', 'mul', 'truediv', 'pow') for r in ('', 'r')
}
for _name in ('add', 'sub', 'mul', 'truediv', 'pow', 'lt', 'le', 'gt', 'ge', 'eq', 'ne'):
    setattr(Symbol, f'__{_name}__', _arithmetic(f'__{_name}__'))
    if _name in ('add', 'sub', 'mul', 'truediv', 'pow'):
        setattr(Symbol, f'__r{_name}__', _arithmetic(f'__r{_name}__'))


def _sinc(x: Any) -> Any:
    y = casadi.pi * x
    return casadi.if_else(y == 0, 1.0, casadi.sin(y) / casadi.if_else(y == 0, 1.0, y))


def _sqrt(x: Any) -> Any:
    """Return the root, exact and NaN as numpy's, with the derivative 0 at 0."""
    at_most_zero = casadi.if_else(x >= 0.0, 0.0, casadi.SX.nan())
    return casadi.if_else(x > 0.0, casadi.sqrt(casadi.fmax(x, _LEAST)), at_most_zero)


def _rounded(x: Any) -> Any:
    """Return the nearest whole number, of two the even one."""
    below = casadi.floor(x)
    over, half = x - below, 0.5 * below
    tie = below + casadi.if_else(half == casadi.floor(half), 0.0, 1.0)
    return casadi.if_else(over == 0.5, tie, below + casadi.if_else(over > 0.5, 1.0, 0.0))


def _refused(what: str) -> Callable[..., Any]:
    def refuse(*_: Any, **__: Any) -> Any:
        raise UntraceableError(f'{what} has no formula here')

    return refuse


#: What CasADi has under another name than numpy, or not at all.
_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.sqrt: _sqrt,
    np.hypot: lambda x, y: _sqrt(x * x + y * y),
    np.absolute: casadi.fabs,
    np.maximum: casadi.fmax,
    np.minimum: casadi.fmin,
    np.square: lambda x: x * x,
    np.reciprocal: lambda x: 1.0 / x,
    np.deg2rad: lambda x: x * (np.pi / 180.0),
    np.radians: lambda x: x * (np.pi / 180.0),
    np.rad2deg: lambda x: x * (180.0 / np.pi),
    np.degrees: lambda x: x * (180.0 / np.pi),
    np.where: casadi.if_else,
    np.logical_and: casadi.logic_and,
    np.logical_or: casadi.logic_or,
    np.logical_not: casadi.logic_not,
    np.sinc: _sinc,
    np.rint: _rounded,
    np.round: _rounded,
    np.nan_to_num: _refused('np.nan_to_num'),
    np.clip: lambda x, low, high: casadi.fmin(casadi.fmax(x, low), high),
    **{
        getattr(np, name): getattr(casadi, name)
        for name in ('sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'arctan2', 'sinh', 'cosh',
                     'tanh', 'arcsinh', 'arccosh', 'arctanh', 'exp', 'expm1', 'log', 'log1p',
                     'log10', 'floor', 'ceil', 'fabs', 'sign')
    },
}  # fmt: skip
_COMPARISONS = (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)


def _elementwise(function: Callable[..., Any], inputs: Any) -> Symbols:
    """Apply a function of expressions to each element of arrays that broadcast."""
    plain = [np.asarray(operand, dtype=object) for operand in inputs]
    broadcast = np.broadcast_arrays(*plain)
    whole = np.empty(broadcast[0].shape, dtype=object)
    for at in np.ndindex(whole.shape):
        whole[at] = Symbol(function(*(formula(operand[at]) for operand in broadcast)))
    return whole.view(Symbols)


def _numbers(value: Any) -> Any:
    """Return an array of symbols with known values as numbers; else the value."""
    if not isinstance(value, Symbols):
        return value
    every = [formula(part) for part in value.flat]
    if not all(part.is_constant() for part in every):
        return value
    return np.array([float(part) for part in every]).reshape(value.shape)


def _norm(x: Any, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    if ord is not None:
        raise UntraceableError('of the norms, only the Euclidean one is known')
    return np.sqrt(np.sum(x * x, axis=axis, keepdims=keepdims))


def _interp(x: Any, points: Any, values: Any) -> Any:
    """Return the line through known points, level outside of them."""
    known, heights = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
    height = heights[0]
    for start, length, rise in zip(known, np.diff(known), np.diff(heights)):
        height = height + rise / length * np.clip(x - start, 0.0, length)
    return height


#: Functions of whole arrays that numpy computes in a way that symbols do not allow.
_WHOLE: dict[Any, Callable[..., Any]] = {np.linalg.norm: _norm, np.interp: _interp}
_EXTREMES = (np.maximum, np.minimum)


class Symbols(np.ndarray[Any, Any]):
    """An array with ``dtype=object``, of symbols and numbers, which stays one in every formula."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        where, out = options.pop('where', True), options.pop('out', (None,))
        if method == '__call__' and ufunc in _FUNCTIONS:
            result: Any = _elementwise(_FUNCTIONS[ufunc], inputs)
        elif method == 'reduce' and ufunc in _EXTREMES:
            result = _extreme(ufunc, inputs[0], **options)
        else:
            if ufunc in _COMPARISONS:
                options['dtype'] = object
            result = getattr(ufunc, method)(*map(np.asarray, inputs), **options)
        if where is not True:
            if out[0] is None:
                raise UntraceableError('it leaves numbers open: where= without out=')
            result = _elementwise(casadi.if_else, (where, result, out[0]))
        result = np.asarray(result, dtype=object).view(Symbols)
        if out[0] is not None:
            out[0][...] = result
        return result

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        if function in _FUNCTIONS:
            if options:
                raise UntraceableError(f'np.{function.__name__} with {", ".join(options)}')
            return _elementwise(_FUNCTIONS[function], inputs)
        if function in _WHOLE:
            return _WHOLE[function](*inputs, **options)
        if function.__module__ == 'numpy.linalg':
            inputs = (*map(_numbers, inputs),)
        result = super().__array_function__(function, (), inputs, options)
        plain = type(result) is np.ndarray and result.dtype == object
        return result.view(Symbols) if plain else result


def _method(function: np.ufunc) -> Callable[..., Any]:
    """Return what numpy calls for an element of a plain array of objects."""

    def apply(self: Any, *others: Any) -> Any:
        return _elementwise(_FUNCTIONS[function], (self, *others))[()]

    return apply


for _function in _FUNCTIONS:
    if isinstance(_function, np.ufunc) and not hasattr(np.ndarray, _function.__name__):
        setattr(Symbols, _function.__name__, _method(_function))
        setattr(Symbol, _function.__name__, _method(_function))


def _extreme(
    ufunc: Any,
    x: Any,
    axis: Any = 0,
    dtype: Any = None,
    keepdims: bool = False,
    initial: Any = np._NoValue,
) -> Any:
    """Return the maxima or minima of an array along an axis, or of all of it."""
    if initial not in (np._NoValue, None):
        raise UntraceableError('a maximum or minimum with initial=')
    rows = np.asarray(x).reshape(-1) if axis is None else np.moveaxis(np.asarray(x), axis, 0)
    extreme = rows[0]
    for row in rows[1:]:
        extreme = ufunc(_array(row) if isinstance(row, Symbol) else row.view(Symbols), extreme)
    if not keepdims:
        return extreme
    return (
        np.reshape(extreme, (1,) * np.ndim(x)) if axis is None else np.expand_dims(extreme, axis)
    )


def by_ways(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns, with all that it decides by the values of symbols.

    Each way has its arguments, which a function may change.
    """

    def run() -> Any:
        return function(*(np.array(value, subok=True) for value in arguments))

    result = every_way(run, _either)
    # broadcast_arrays and asarray return plain arrays of objects, whose numbers have no functions
    objects = isinstance(result, np.ndarray) and result.dtype == object
    return result.view(Symbols) if objects else result


def _either(condition: Any, results: Any, others: Any) -> Any:
    """Return results (...) where a condition holds, and others (...) where it does not."""
    some, rest = (np.asarray(values, dtype=object) for values in (results, others))
    if some.shape != rest.shape:
        raise UntraceableError('the size of its result depends on the state')
    return _elementwise(
        lambda x, y: x if casadi.is_equal(x, y, 1) else casadi.if_else(condition, x, y),
        (some, rest),
    )


def symbols(count: int) -> tuple[Any, Symbols]:
    """Return a vector of variables of CasADi, and the same as an array (count,)."""
    variables = casadi.SX.sym('v', count)
    whole = np.empty(count, dtype=object)
    whole[:] = [Symbol(variable) for variable in variables.elements()]
    return variables, whole.view(Symbols)
