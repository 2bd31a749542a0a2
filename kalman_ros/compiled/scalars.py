# SPDX-License-Identifier: Apache-2.0
"""Functions of a user that compute with `math`, ``float`` and arrays of zeros, for symbols.

While formulas are recorded, they have other global names: the same mathematics, which takes
symbols, and arrays that hold them.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable, Mapping
from functools import partial, reduce
from types import CellType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from .symbols import Symbol, Symbols

_PACKAGE = f'{__name__.partition(".")[0]}.'


def _hypot(*numbers: Any) -> Any:
    return np.sqrt(sum(number * number for number in numbers))


def _extreme(of_two: Callable[..., Any], *numbers: Any) -> Any:
    return reduce(of_two, numbers if len(numbers) > 1 else numbers[0])


def _log(x: Any, *base: Any) -> Any:
    return np.log(x) / np.log(*base) if base else np.log(x)


def _taking_symbols(plain: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that does with symbols what another one does with numbers."""

    def function(*arguments: Any, **options: Any) -> Any:
        if options or not any(isinstance(value, (Symbol, Symbols)) for value in arguments):
            return plain(*arguments, **options)
        return symbolic(*arguments)

    return function


def _holding_symbols(plain: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that makes an array of numbers which symbols may replace."""

    def function(*arguments: Any, **options: Any) -> Any:
        whole = plain(*arguments, **options)
        return whole.astype(object).view(Symbols) if whole.dtype in (float, object) else whole

    return function


def _of_values(plain: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that makes an array of values, some of which may be symbols."""

    def function(values: Any, *arguments: Any, **options: Any) -> Any:
        whole = np.array(values, dtype=object)
        if any(isinstance(value, (Symbol, Symbols)) for value in whole.flat):
            return whole.view(Symbols)
        return _holding_symbols(plain)(values, *arguments, **options)

    return function


class _OfFloat(type):
    def __call__(cls, value: Any = 0.0) -> Any:
        return value if isinstance(value, (Symbol, Symbols)) else float(value)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, float)


class _Float(float, metaclass=_OfFloat):
    """``float``, which leaves symbols as they are; as a type of arrays, that of objects."""


class _Instead:
    """A module with other functions."""

    def __init__(self, module: ModuleType, functions: Mapping[str, Any]) -> None:
        self.__dict__.update(functions)
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


#: Functions of `math` that have another name in numpy, or none.
_OTHERS: dict[str, Callable[..., Any]] = {
    'asin': np.arcsin, 'acos': np.arccos, 'atan': np.arctan, 'atan2': np.arctan2,
    'asinh': np.arcsinh, 'acosh': np.arccosh, 'atanh': np.arctanh,
    'hypot': _hypot, 'log': _log, 'pow': lambda x, y: x**y,
}  # fmt: skip
_ALIKE = (
    'sin', 'cos', 'tan', 'sinh', 'cosh', 'tanh', 'exp', 'expm1', 'log1p', 'log10', 'sqrt', 'fabs',
    'floor', 'ceil', 'degrees', 'radians',
)  # fmt: skip
_OF_MATH = {
    name: _taking_symbols(getattr(math, name), function)
    for name, function in ({name: getattr(np, name) for name in _ALIKE} | _OTHERS).items()
}
_OF_NUMPY = {
    name: _holding_symbols(getattr(np, name))
    for name in ('zeros', 'ones', 'empty', 'full', 'eye', 'identity', 'diag', 'zeros_like',
                 'ones_like', 'empty_like', 'full_like')
} | {name: _of_values(getattr(np, name)) for name in ('array', 'asarray')}  # fmt: skip
_MODULES = {'math': _Instead(math, _OF_MATH), 'numpy': _Instead(np, _OF_NUMPY)}
_BY_ORIGINAL = {
    getattr(module, name): function
    for module, functions in ((math, _OF_MATH), (np, _OF_NUMPY))
    for name, function in functions.items()
}


def _imported(name: str, *details: Any) -> Any:
    """Return a module that a function imports."""
    return _MODULES.get(name) or builtins.__import__(name, *details)


#: Names that Python always has.
_BUILTINS = vars(builtins) | {
    '__import__': _imported,
    'float': _Float,
    'max': _taking_symbols(max, partial(_extreme, np.maximum)),
    'min': _taking_symbols(min, partial(_extreme, np.minimum)),
}


def scope(names: dict[str, Any]) -> dict[str, Any]:
    """Return the global names of a function, with mathematics and functions that take symbols."""
    whole = {**names, '__builtins__': _BUILTINS}
    for name, value in [*whole.items()]:
        if isinstance(value, FunctionType) and value.__globals__ is names:
            known = value.__defaults__, value.__kwdefaults__, value.__closure__
            whole[name] = rebound(value, whole, *known)
        else:
            whole[name] = _counterpart(value)
    return whole


def _counterpart(value: Any) -> Any:
    """Return what takes symbols in the place of a module, or of one of its functions."""
    if value is math or value is np:
        return _MODULES[value.__name__]
    module = getattr(value, '__module__', None) if callable(value) else None
    return _BY_ORIGINAL.get(value, value) if module in _MODULES else value


def of_symbols(value: Any, inside: tuple[Any, ...] = ()) -> Any:
    """Return what takes symbols in the place of a function or a module; else the value.

    A function ``inside`` itself stays as it is.
    """
    counterpart = _counterpart(value)
    if counterpart is not value:
        return counterpart
    if isinstance(value, FunctionType):
        return _function(value, inside)
    if isinstance(value, MethodType):
        return MethodType(of_symbols(value.__func__, inside), value.__self__)
    if isinstance(value, partial):
        return partial(of_symbols(value.func, inside), *value.args, **value.keywords)
    called = vars(type(value)).get('__call__')
    if isinstance(called, FunctionType):
        return MethodType(of_symbols(called, inside), value)
    return value


def _function(function: FunctionType, inside: tuple[Any, ...]) -> FunctionType:
    """Return a function, with what is in its closure and its defaults, for symbols."""
    if any(function is outer for outer in inside):
        return function
    inside = (*inside, function)
    try:
        cells = [of_symbols(cell.cell_contents, inside) for cell in function.__closure__ or ()]
    except ValueError:  # a cell that is not set yet
        return function
    defaults = tuple(of_symbols(value, inside) for value in function.__defaults__ or ())
    named = {
        name: of_symbols(value, inside) for name, value in (function.__kwdefaults__ or {}).items()
    }
    names = scope(function.__globals__)
    return rebound(function, names, defaults or None, named, tuple(map(CellType, cells)))


def rebound(
    function: FunctionType,
    names: dict[str, Any],
    defaults: tuple[Any, ...] | None,
    named_defaults: dict[str, Any] | None,
    closure: tuple[CellType, ...] | None,
) -> FunctionType:
    """Return a function with other global names, defaults and cells."""
    other = FunctionType(function.__code__, names, function.__name__, defaults, closure)
    other.__kwdefaults__ = named_defaults
    return other


def methods(value: Any) -> dict[str, MethodType]:
    """Return the methods of the class of a user, for symbols, by name."""
    kinds = [kind for kind in type(value).__mro__ if not kind.__module__.startswith(_PACKAGE)]
    return {
        name: MethodType(of_symbols(function), value)
        for kind in reversed(kinds)
        for name, function in vars(kind).items()
        if isinstance(function, FunctionType) and not name.startswith('__')
    }
