# SPDX-License-Identifier: Apache-2.0
"""Filters, and the online estimator that handles time, order and gates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from kalman_ros.core import Option, Value, build_with, options_of, refuse_unknown
from kalman_ros.core.registry import names

from .filter import Filter
from .plan import Plan, check_linear

_FOLDER = f'{__name__}.filters'
#: Names of the filters: the modules that define a class ``FILTER``, imported on demand.
#: The shortest names come first, since they are the best known.
FILTERS = tuple(sorted(names(_FOLDER), key=len))
#: Implementations: this package, or filterpy for the filters that it has.
NATIVE, FILTERPY = IMPLEMENTATIONS = ('native', 'filterpy')


def filter_class(name: str) -> type[Filter]:
    """Return the class of a filter.

    Raises
    ------
    ValueError
        If there is no such filter; the message lists the known ones.
    """
    refuse_unknown([name], FILTERS, 'filter')
    loaded: type[Filter] = import_module(f'{_FOLDER}.{name}').FILTER
    return loaded


def default_filter(plan: Plan) -> str:
    """Return the simplest suitable filter for a plan: kf if everything is linear, else ekf."""
    return 'kf' if plan.linear else 'ekf'


def _check_needs(name: str, kind: type[Filter], plan: Plan) -> None:
    """Raise ValueError if a plan does not meet the needs of a kind of filter."""
    if kind.needs_linear:
        check_linear(name, plan.model)
        for sensor, timed in plan.sensors.items():
            if not timed.sensor.linear:
                raise ValueError(
                    f'filter: {name} needs linear sensors, and the {type(timed.sensor).__name__} '
                    f"'{sensor}' is not declared linear; ekf and ukf take any"
                )
    if kind.needs_continuous and plan.model.is_discrete:
        raise ValueError(f'filter: {name} needs a model in continuous time')


def _builder(name: str, implementation: str) -> Callable[..., Any]:
    kind = filter_class(name)
    refuse_unknown([implementation], IMPLEMENTATIONS, 'implementation')
    if implementation == FILTERPY:
        try:
            peers = import_module(f'{__name__}.peers').PEERS
        except ModuleNotFoundError:
            raise ValueError('implementation: filterpy is not installed') from None
        refuse_unknown([name], peers, 'filter of filterpy')
        kind = peers[name]
    return kind.build


def filter_options(name: str, implementation: str = NATIVE) -> tuple[Option, ...]:
    """Return the options of a filter; ValueError if there is no such filter."""
    return options_of(_builder(name, implementation))


def build_filter(
    name: str, plan: Plan, options: Mapping[str, Value] | None = None, implementation: str = NATIVE
) -> Filter:
    """Return the filter ``name`` for a plan.

    Raises
    ------
    ValueError
        If there is no such filter, or it does not support this model; DesignError if it has no
        solution.
    """
    build = _builder(name, implementation)
    _check_needs(name, filter_class(name), plan)
    built: Filter = build_with(build, options or {}, plan)
    return built
