# SPDX-License-Identifier: Apache-2.0
"""Filters, and the online estimator that gives them time, order and gates."""

from __future__ import annotations

from importlib import import_module

from kalman_ros.core import Model, refuse_unknown

from .filter import Filter

#: The filters that there are, each a module with ``build(model)``; imported when asked for.
FILTERS = ('kf',)


def build_filter(name: str, model: Model) -> Filter:
    """Return the filter ``name`` for a model.

    Raises
    ------
    ValueError
        If there is no such filter, or it cannot serve this model.
    """
    refuse_unknown([name], FILTERS, 'filter')
    built: Filter = import_module(f'{__name__}.{name}').build(model)
    return built
