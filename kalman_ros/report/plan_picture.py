# SPDX-License-Identifier: Apache-2.0
"""Picture of a plan of predictive control: states and inputs ahead, and their limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space

from .style import BOUND, ESTIMATE, TRUTH, legend_below, picture


def plan_picture(
    plan: Any,
    space: Space,
    inputs: Sequence[str],
    states: tuple[Array, Array],
    limits: tuple[Array, Array],
    path: Path | None,
) -> Any:
    """Draw what is planned, and the limits (n,), (n,) of the states and (m,), (m,) of the inputs.

    Returns
    -------
    Axes (n + m, 1).
    """
    rows = space.size + len(inputs)
    with picture(path, rows, 1, (8.0, 1.4 * rows + 0.9)) as (figure, axes):
        for index, name in enumerate(space.names):
            axis = axes[index, 0]
            axis.plot(plan.time, plan.states[:, index], color=ESTIMATE, lw=1.2, label='planned')
            axis.set_ylabel(space.label(name))
            _draw_limits(axis, states, index)
        for index, name in enumerate(inputs):
            axis = axes[space.size + index, 0]
            held = np.append(plan.inputs[:, index], plan.inputs[-1, index])
            axis.step(plan.time, held, where='post', color=TRUTH, lw=1.2, label='input')
            axis.set_ylabel(name)
            _draw_limits(axis, limits, index)
        axes[-1, 0].set_xlabel('seconds from now')
        axes[0, 0].set_title('The plan, and the limits that it keeps')
        legend_below(figure, axes[0, 0])
    return axes


def _draw_limits(axis: Any, limits: tuple[Array, Array], index: int) -> None:
    for limit in limits:
        if np.isfinite(limit[index]):
            axis.axhline(limit[index], color=BOUND, lw=1.2, ls='--')
