# SPDX-License-Identifier: Apache-2.0
"""The formulas of a function, recorded while it computes with symbols."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi
import numpy as np

from kalman_ros.core import Array

from .symbols import by_ways, formula, symbols
from .untraceable import UntraceableError

#: Formulas and numpy round differently: a relative and an absolute difference this small agree.
_CLOSE = 1e-9


class Trace(NamedTuple):
    """The vectors that a function takes, as variables of CasADi, and what it returns of them."""

    variables: list[Any]
    result: Any

    def function(self, name: str) -> Any:
        """Return the function of CasADi, without formulas that repeat."""
        return casadi.Function(name, self.variables, [casadi.cse(self.result)])

    def slope(self, by: int, at: Any) -> Trace:
        """Return the exact derivative by one of the vectors where that has a value."""
        variables = [*self.variables]
        variable = variables.pop(by)
        derivative = casadi.jacobian(casadi.densify(self.result), variable)
        return Trace(variables, self._substituted(derivative, variable, at))

    def at(self, index: int, value: Any) -> Trace:
        """Return the same with a value in the place of one of the vectors."""
        variables = [*self.variables]
        variable = variables.pop(index)
        return Trace(variables, self._substituted(self.result, variable, value))

    @staticmethod
    def _substituted(result: Any, variable: Any, value: Any) -> Any:
        (expression,) = casadi.substitute([result], [variable], [casadi.densify(casadi.SX(value))])
        return casadi.sparsify(casadi.simplify(expression))


def trace(function: Callable[..., Any], *probes: Sequence[Array]) -> Trace:
    """Return the formulas of a function of vectors, each (n,), with a result of up to two axes.

    Parameters
    ----------
    function
        To be recorded.
    probes
        Arguments for which it must return what its formulas do.

    Raises
    ------
    UntraceableError
        If it decides by values in too many ways, calls what is not numpy, or does not agree with
        its formulas.
    """
    variables, vectors = zip(*(symbols(len(argument)) for argument in probes[0]))
    try:
        formulas = _matrix(by_ways(function, *vectors))
    except UntraceableError:
        raise
    except Exception as error:  # a function of a user may fail on symbols in any way
        first = str(error).partition('\n')[0]
        raise UntraceableError(f'{type(error).__name__}: {first}') from None
    recording = Trace([*variables], formulas)
    agree(recording, function, probes, _CLOSE, 'its formulas are not what it returns')
    return recording


def _matrix(result: Any) -> Any:
    """Return the formulas in an array of up to two axes as a matrix."""
    whole = np.asarray(result)
    columns = whole[:, np.newaxis] if whole.ndim == 1 else whole
    formulas = casadi.SX(*columns.shape)
    for at, value in np.ndenumerate(columns):
        known = formula(value)
        if not known.is_zero():
            formulas[at] = known
    return formulas


def agree(
    formulas: Trace,
    function: Callable[..., Any],
    probes: Sequence[Sequence[Array]],
    tolerance: float,
    otherwise: str,
) -> None:
    """Raise UntraceableError where formulas are not what a function returns."""
    evaluated = formulas.function('f')
    for probe in probes:
        with np.errstate(all='ignore'):
            expected = np.asarray(function(*probe), dtype=float).reshape(formulas.result.shape)
        values = np.array(evaluated(*probe))
        if not np.allclose(values, expected, rtol=tolerance, atol=tolerance, equal_nan=True):
            raise UntraceableError(otherwise)
