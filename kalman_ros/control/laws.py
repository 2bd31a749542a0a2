# SPDX-License-Identifier: Apache-2.0
"""The control laws by name, each with its options, for an input held over steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import (
    About,
    DesignError,
    LinearSystem,
    Option,
    Value,
    build_with,
    options_of,
    refuse_unknown,
)

from .feedback import Feedback
from .lqr import Cost, sampled_lqr


def _lqr(system: LinearSystem, weights: Cost, dt: float) -> Feedback:
    """Return the regulator with the least cost."""
    design = sampled_lqr(system, weights, dt)
    return Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)


def _placement(
    system: LinearSystem,
    weights: Cost,
    dt: float,
    regulator_poles: Annotated[
        Sequence[float],
        About(
            'real parts of the poles of the loop, up to one per state',
            '1/s',
            maximum=-1e-9,
            live=True,
        ),
    ] = (-1.0,),
    regulator_frequencies: Annotated[
        Sequence[float],
        About('their imaginary parts, in pairs of both signs; zero where not given', live=True),
    ] = (0.0,),
) -> Feedback:
    """Return the regulator with the given poles; the weights do not matter.

    Fewer poles than states are completed by `spread_poles`.
    """
    from kalman_ros.linear.placement import pole_pairs, sampled_place

    names = 'regulator_poles', 'regulator_frequencies'
    poles = pole_pairs(names, regulator_poles, regulator_frequencies, system.state.size)
    design = sampled_place(system.A, system.B, poles, dt)
    return Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)


def _lqi(
    system: LinearSystem,
    weights: Cost,
    dt: float,
    tracked: Annotated[
        Sequence[str],
        About("names of the states that shall reach their reference; '' for all that can"),
    ] = ('',),
    integral_cost: Annotated[
        Sequence[float],
        About('weights of the integrals of their errors; one for all', minimum=0.0, live=True),
    ] = (1.0,),
) -> Feedback:
    """Return the regulator with the least cost and no steady-state error."""
    from .integral import sampled_lqi
    from .tracking import holdable

    names = [name for name in tracked if name] or holdable(system)
    if not names:
        raise DesignError('tracked: there is no state that a steady input holds at a reference')
    cost = [*integral_cost] if len(integral_cost) > 1 else [integral_cost[0]] * len(names)
    design = sampled_lqi(system, names, weights, cost, dt)
    places = tuple(system.state.indices(names))
    return Feedback(design.gain, design.integral_gain, places, design.poles)


LAWS: Mapping[str, Callable[..., Feedback]] = {
    'lqr': _lqr,
    'placement': _placement,
    'lqi': _lqi,
}


def law_options(law: str) -> tuple[Option, ...]:
    """Return the options of a law; ValueError if there is no such law."""
    refuse_unknown([law], LAWS, 'law')
    return options_of(LAWS[law])


def build_law(
    law: str, system: LinearSystem, weights: Cost, dt: float, options: Mapping[str, Value]
) -> Feedback:
    """Return the gains of a law for a system and the continuous weights of its cost.

    Raises
    ------
    ValueError
        If an option is wrong; DesignError if there is no such feedback.
    """
    refuse_unknown([law], LAWS, 'law')
    found: Feedback = build_with(LAWS[law], options, system, weights, dt)
    return found
