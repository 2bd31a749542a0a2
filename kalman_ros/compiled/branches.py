# SPDX-License-Identifier: Apache-2.0
"""The ways through a function that decides by the values of symbols: ``if``, ``max``, ``and``.

The function runs once for each way, with one more decision turned around each time (J. C. King,
Symbolic execution and program testing, Communications of the ACM 19(7), 1976).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import reduce
from typing import Any, NoReturn

import casadi

from .untraceable import UntraceableError

#: The most ways that are recorded, and decisions on one: a loop that ends by the state has no end.
MOST_WAYS = MOST_DECISIONS = 64
#: How deep formulas are compared.
_DEPTH = 10


class _Way:
    """Decisions in their order: those that are given, and behind them each as true."""

    def __init__(self, given: Sequence[bool]) -> None:
        self.taken, self.conditions = [*given], list[Any]()

    def decide(self, condition: Any) -> bool:
        for known, taken in zip(self.conditions, self.taken):
            if casadi.is_equal(known, condition, _DEPTH):
                return taken
        self.conditions.append(condition)
        if len(self.conditions) > len(self.taken):
            self.taken.append(True)
        if len(self.taken) > MOST_DECISIONS:
            _refuse()
        return self.taken[len(self.conditions) - 1]

    @property
    def condition(self) -> Any:
        """Whether a state leads this way."""
        every = zip(self.conditions, self.taken)
        return reduce(
            casadi.logic_and,
            (condition if taken else casadi.logic_not(condition) for condition, taken in every),
            casadi.SX(1),
        )


_current: ContextVar[_Way] = ContextVar('way')


def decide(condition: Any) -> bool:
    """Return the truth of a formula on the way that is being recorded.

    Raises
    ------
    UntraceableError
        If there are too many ways.
    """
    if condition.is_constant():
        return bool(float(condition))
    way = _current.get(None)
    if way is None:
        raise UntraceableError('it decides by the value of the state')
    return way.decide(condition)


def every_way(run: Callable[[], Any], merge: Callable[[Any, Any, Any], Any]) -> Any:
    """Return what a function without arguments returns, by its decisions.

    Parameters
    ----------
    run
        The function.
    merge
        Returns a result if a condition holds, and another one else.

    Raises
    ------
    UntraceableError
        If there are too many ways.
    """
    ways, open_ways = list[tuple[_Way, Any]](), [list[bool]()]
    while open_ways:
        given = open_ways.pop()
        way = _Way(given)
        token = _current.set(way)
        try:
            ways.append((way, run()))
        finally:
            _current.reset(token)
        open_ways += [[*way.taken[:k], False] for k in range(len(given), len(way.taken))]
        if len(ways) + len(open_ways) > MOST_WAYS:
            _refuse()
    (_, merged), *others = ways
    for way, result in others:
        merged = merge(way.condition, result, merged)
    return merged


def _refuse() -> NoReturn:
    raise UntraceableError(
        f'it decides by the value of the state in more than {MOST_WAYS} ways: if, max, while'
    )
