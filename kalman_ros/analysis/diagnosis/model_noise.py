# SPDX-License-Identifier: Apache-2.0
"""Process noise that no parameter named for it scales, such as that in the class of a model."""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any

from kalman_ros.core import Array, Dynamics

#: Name of the whole density, as of a parameter.
WHOLE = 'noise_density'
_FACTOR = '_diagnosed_noise_factor'


def noisier(model: Dynamics, factor: float) -> Dynamics:
    """Return a model with a multiple of the process noise that its class has."""
    if factor == 1.0 and not hasattr(model, _FACTOR):
        return model
    kind: type[Dynamics] = type(model)
    changed = copy(model)
    if not hasattr(model, _FACTOR):
        object.__setattr__(changed, '__class__', _noisier(kind))
    object.__setattr__(changed, _FACTOR, factor)
    return changed


@cache
def _noisier(base: Any) -> type[Dynamics]:
    """Return a class of models that multiplies the process noise of another one."""
    method = 'noise' if hasattr(base, 'noise') else 'noise_density'  # of a period, or a second

    def noise(self: Any, x: Array) -> Any:
        return getattr(self, _FACTOR) * getattr(base, method)(self, x)

    return type(base.__name__, (base,), {method: noise})
