# SPDX-License-Identifier: Apache-2.0
"""Functions of a user that compute with `math`, ``float`` and arrays of zeros, for symbols.

While formulas are recorded, they have other global names: the same mathematics, which takes
symbols, and arrays that hold them.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import suppress
from copy import copy
from functools import partial, reduce
from types import CellType, CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import numpy as np

from kalman_ros.core import Dynamics, Sensor

from .symbols import Symbol, Symbols
from .untraceable import UntraceableError

#: Of a function that is within no other one.
NOTHING: Mapping[int, Any] = MappingProxyType({})
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
        if not any(isinstance(value, (Symbol, Symbols)) for value in whole.flat):
            return _holding_symbols(plain)(values, *arguments, **options)
        kinds = {*arguments, *options.values()}
        if not {*options} <= {'dtype'} or not kinds <= {None, float, object, _Float}:
            raise UntraceableError(f'np.{plain.__name__} with options')
        return values if plain is np.asarray and type(values) is Symbols else whole.view(Symbols)

    return function


class _OfFloat(type):
    def __call__(cls, value: Any = 0.0) -> Any:
        return value if isinstance(value, (Symbol, Symbols)) else float(value)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, (float, Symbol))


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
#: By identity, since not all that is called has a hash.
_BY_ORIGINAL = {
    id(getattr(module, name)): function
    for module, functions in ((math, _OF_MATH), (np, _OF_NUMPY))
    for name, function in functions.items()
}


def _imported(
    name: str, names: Any = None, inner: Any = None, parts: Any = (), level: int = 0
) -> Any:
    """Return a module that a function imports; a ``level`` above 0 is that of its package."""
    if level == 0 and name in _MODULES:
        return _MODULES[name]
    return builtins.__import__(name, names, inner, parts, level)


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
            whole[name] = FunctionType(
                value.__code__, whole, value.__name__, value.__defaults__, value.__closure__
            )
            whole[name].__kwdefaults__ = value.__kwdefaults__
        else:
            whole[name] = _counterpart(value)
    return whole


def _counterpart(value: Any) -> Any:
    """Return what takes symbols in the place of a module, or of one of its functions."""
    if value is math or value is np:
        return _MODULES[value.__name__]
    module = getattr(value, '__module__', None) if callable(value) else None
    if module in _MODULES:
        return _BY_ORIGINAL.get(id(value), value)
    # what a function keeps there is no symbol afterwards
    return copy(value) if type(value) in (dict, list, set) else value


def of_symbols(value: Any, inside: Mapping[int, Any] = NOTHING) -> Any:
    """Return what takes symbols in the place of a function or a module; else the value.

    Within a function that calls itself, ``inside`` has what takes its place, by its identity.
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


def _function(function: FunctionType, inside: Mapping[int, Any]) -> Any:
    """Return a function, with what is in its closure and its defaults, for symbols."""
    if id(function) in inside:
        return inside[id(function)]
    other = rebound(function, scope(function.__globals__))
    inside = {**inside, id(function): other}
    for cell, original in zip(other.__closure__ or (), function.__closure__ or ()):
        with suppress(ValueError):  # a cell that is not set yet
            cell.cell_contents = of_symbols(original.cell_contents, inside)
    other.__defaults__ = tuple(of_symbols(v, inside) for v in function.__defaults__ or ()) or None
    named = (function.__kwdefaults__ or {}).items()
    other.__kwdefaults__ = {name: of_symbols(value, inside) for name, value in named}
    return other


def rebound(function: FunctionType, names: dict[str, Any]) -> FunctionType:
    """Return a function with other global names, and cells of its closure that are still empty."""
    cells = tuple(CellType() for _ in function.__closure__ or ())
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__, cells)


def _defined(value: Any) -> Iterator[tuple[str, FunctionType]]:
    """Yield the functions of the classes of a user, by name, the last class at the end."""
    for kind in reversed(type(value).__mro__):
        if not kind.__module__.startswith((_PACKAGE, 'builtins', 'numpy', 'abc')):
            for name, function in vars(kind).items():
                if isinstance(function, FunctionType):
                    yield name, function


def methods(value: Any) -> dict[str, MethodType]:
    """Return the methods of the class of a user, for symbols, by name."""
    return {
        name: MethodType(of_symbols(function), value)
        for name, function in _defined(value)
        if not name.startswith('__') and name not in vars(value)
    }


def read(value: Any, known: set[int] | None = None) -> Iterator[Hashable]:
    """Yield the global names that the functions of a user read in an object, and what they hold.

    Parameters
    ----------
    value
        A model, a sensor, a function, or what has functions.
    known
        Identities of objects that were looked at; none by default.
    """
    known = set() if known is None else known
    if id(value) in known:
        return
    known.add(id(value))
    if isinstance(value, FunctionType):
        for name in sorted(_names(value.__code__)):
            if name in value.__globals__:
                yield name
                yield from _held(value.__globals__[name], known)
        with suppress(ValueError):  # a cell that is not set yet
            for cell in value.__closure__ or ():
                yield from read(cell.cell_contents, known)
    elif isinstance(value, MethodType):
        yield from read(value.__func__, known)
    elif isinstance(value, partial):
        yield from read(value.func, known)
    elif (
        isinstance(value, (Dynamics, Sensor))
        or hasattr(value, 'HAS_FUNCTION')
        or ('__call__' in vars(type(value)) and not isinstance(value, type))
    ):
        for _, method in _defined(value):
            yield from read(method, known)
        for part in getattr(value, '__dict__', {}).values():
            yield from read(part, known)


def _held(value: Any, known: set[int]) -> Iterator[Hashable]:
    """Yield what a global name holds, as far as formulas may depend on it."""
    if isinstance(value, np.ndarray):
        yield value.dtype.str, value.shape, value.tobytes()
    elif isinstance(value, (int, float, complex, str, bytes, type(None))):
        yield value
    elif isinstance(value, (list, tuple, set)):
        for part in value:
            yield from _held(part, known)
    elif isinstance(value, dict):
        for pair in value.items():
            yield from _held(pair, known)
    elif isinstance(value, (FunctionType, MethodType, partial)):
        yield from read(value, known)


def _names(code: CodeType) -> set[str]:
    """Return the names that a function, and those within it, may look up."""
    inner = (part for part in code.co_consts if isinstance(part, CodeType))
    return {*code.co_names}.union(*map(_names, inner))
