# SPDX-License-Identifier: Apache-2.0
"""Functions of a user that compute with `math` and ``float``, such that they take symbols."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import CellType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from .symbols import Symbol, Symbols


def _hypot(*numbers: Any) -> Any:
    return np.sqrt(sum(each * each for each in numbers))


def _log(x: Any, *base: Any) -> Any:
    return np.log(x) / np.log(*base) if base else np.log(x)


#: What has another name in numpy, or none.
_OTHERS: dict[str, Callable[..., Any]] = {
    'asin': np.arcsin, 'acos': np.arccos, 'atan': np.arctan, 'atan2': np.arctan2,
    'asinh': np.arcsinh, 'acosh': np.arccosh, 'atanh': np.arctanh,
    'hypot': _hypot, 'log': _log, 'pow': lambda x, y: x**y,
}  # fmt: skip
_ALIKE = (
    'sin', 'cos', 'tan', 'sinh', 'cosh', 'tanh', 'exp', 'expm1', 'log1p', 'log10', 'sqrt', 'fabs',
    'floor', 'ceil', 'degrees', 'radians',
)  # fmt: skip


def _taking_symbols(plain: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that does with symbols what another one does with numbers."""

    def function(*arguments: Any) -> Any:
        known = not any(isinstance(each, (Symbol, Symbols)) for each in arguments)
        return plain(*arguments) if known else symbolic(*arguments)

    return function


_OF_SYMBOLS = {name: getattr(np, name) for name in _ALIKE} | _OTHERS
_FUNCTIONS: dict[str, Any] = vars(math) | {
    name: _taking_symbols(getattr(math, name), each) for name, each in _OF_SYMBOLS.items()
}
_MATH = SimpleNamespace(**_FUNCTIONS)
_BY_ORIGINAL = {getattr(math, name): _FUNCTIONS[name] for name in _OF_SYMBOLS}
_FLOAT = _taking_symbols(float, lambda x: x)


def scope(names: dict[str, Any]) -> dict[str, Any]:
    """Return the global names of a function, with mathematics and functions that take symbols."""
    whole = {'float': _FLOAT, **names}
    for name, value in names.items():
        if isinstance(value, FunctionType) and value.__globals__ is names:
            known = value.__defaults__, value.__kwdefaults__, value.__closure__
            whole[name] = rebound(value, whole, *known)
        else:
            whole[name] = of_symbols(value)
    return whole


def of_symbols(value: Any) -> Any:
    """Return what takes symbols in the place of `math` or one of its functions; else the value."""
    if value is math:
        return _MATH
    of_math = getattr(value, '__module__', None) == math.__name__
    return _BY_ORIGINAL.get(value, value) if of_math else value


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
