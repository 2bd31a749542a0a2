# SPDX-License-Identifier: Apache-2.0
"""Process noise that is written into the class of a model, with no parameter to change it."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cache
from typing import Any

from kalman_ros.core import Array, Dynamics

from .evidence import Evidence

#: Name of the whole density, as of a parameter.
WHOLE = 'noise_density'


def multiplied(evidence: Evidence, factor: float) -> Evidence:
    """Return the evidence with a model whose process noise is larger by a factor."""
    model: Any = copy(evidence.scenario.model)
    before = getattr(model, 'noise_factor', None)
    if before is None:
        kind: type[Dynamics] = type(model)
        model.__class__ = _noisier(kind)
    model.noise_factor = factor * (before or 1.0)
    return replace(evidence, scenario=replace(evidence.scenario, model=model))


@cache
def _noisier(base: Any) -> type[Dynamics]:
    """Return a class of models that multiplies the process noise of another one."""
    method = 'noise' if hasattr(base, 'noise') else 'noise_density'  # of a period, or a second

    class Noisier(base):  # type: ignore[misc]
        noise_factor: float

    def noise(self: Any, x: Array) -> Any:
        return self.noise_factor * getattr(base, method)(self, x)

    setattr(Noisier, method, noise)
    Noisier.__name__ = base.__name__
    return Noisier
