# SPDX-License-Identifier: Apache-2.0
"""Filters, and the online estimator that handles time, order and gates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from kalman_ros.core import Option, Value, build_with, options_of, refuse_unknown

from .filter import Filter, Plan

#: The filters, each a module with ``build(plan)``; imported on demand.
FILTERS = ('kf', 'ekf', 'ukf', 'gaussian_sum', 'steady_state', 'luenberger')
#: Implementations: our own code, or filterpy's for the filters that it has.
NATIVE, FILTERPY = IMPLEMENTATIONS = ('native', 'filterpy')


def _builder(name: str, implementation: str) -> Callable[..., Any]:
    refuse_unknown([name], FILTERS, 'filter')
    refuse_unknown([implementation], IMPLEMENTATIONS, 'implementation')
    builder: Callable[..., Any] = import_module(f'{__name__}.{name}').build
    if implementation == FILTERPY:
        try:
            peers = import_module(f'{__name__}.peers').BUILDERS
        except ModuleNotFoundError:
            raise ValueError('implementation: filterpy is not installed') from None
        refuse_unknown([name], peers, 'filter of filterpy')
        builder = peers[name]
    return builder


def filter_options(name: str, implementation: str = NATIVE) -> tuple[Option, ...]:
    """Return the options of a filter; ValueError if there is no such filter."""
    return options_of(_builder(name, implementation))


def build_filter(
    name: str,
    plan: Plan,
    options: Mapping[str, Value] | None = None,
    implementation: str = NATIVE,
) -> Filter:
    """Return the filter ``name`` for a plan.

    Raises
    ------
    ValueError
        If there is no such filter, or it does not support this model; DesignError if it has no
        solution.
    """
    built: Filter = build_with(_builder(name, implementation), options or {}, plan)
    return built
