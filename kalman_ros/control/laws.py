# SPDX-License-Identifier: Apache-2.0
"""The control laws by name, each with its options, for an input held over steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Annotated, Any, NamedTuple

import numpy as np

from kalman_ros.core import (
    About,
    Array,
    DesignError,
    LinearSystem,
    Option,
    Space,
    brief,
    build_with,
    options_of,
    refuse_unknown,
)

from .feedback import Feedback
from .lqr import Cost, LqrDesign, dlqr, sampled_cost, sampled_lqr
from .predictive import STATE_PRICE, predicted


class Problem(NamedTuple):
    """A problem of design: a system, the weights of its cost, the length of a step.

    ``state_limits`` are [low, high] by the name of a state, ``regulator`` designs the sampled
    regulator.
    """

    system: LinearSystem
    weights: Cost
    dt: float
    state_limits: Mapping[str, Sequence[float]]
    regulator: Callable[[Array, Array, Cost], LqrDesign] = dlqr


def _lqr(problem: Problem) -> Feedback:
    """Return the regulator with the least cost."""
    design = sampled_lqr(problem.system, problem.weights, problem.dt)
    return Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)


def _placement(
    problem: Problem,
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

    system = problem.system
    names = 'regulator_poles', 'regulator_frequencies'
    poles = pole_pairs(names, regulator_poles, regulator_frequencies, system.state.size)
    design = sampled_place(system.A, system.B, poles, problem.dt)
    return Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles)


def _lqi(
    problem: Problem,
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

    system = problem.system
    names = [name for name in tracked if name] or holdable(system)
    if not names:
        raise DesignError('tracked: there is no state that a steady input holds at a reference')
    cost = [*integral_cost] if len(integral_cost) > 1 else [integral_cost[0]] * len(names)
    design = sampled_lqi(system, names, problem.weights, cost, problem.dt)
    places = tuple(system.state.indices(names))
    return Feedback(design.gain, design.integral_gain, places, design.poles)


def _mpc(
    problem: Problem,
    horizon: Annotated[
        float, About('how far ahead limits are predicted; 0: by the slowest pole', 's', 0.0)
    ] = 0.0,
    moves: Annotated[
        int, About('numbers of changes of the input that are planned', minimum=1, maximum=200)
    ] = 20,
    state_price: Annotated[
        Sequence[float],
        About(
            'cost a second of the square of the excess of a state; inf: never; one for all',
            minimum=1e-9,
            live=True,
        ),
    ] = (STATE_PRICE,),
) -> Feedback:
    """Return the regulator with the least cost within limits of inputs and states."""
    system, weights, dt = problem.system, problem.weights, problem.dt
    sampled, price = system.sampled(dt), sampled_cost(system, weights, dt)
    step = sampled.F, sampled.G
    design = problem.regulator(*step, price)
    prediction = predicted(
        step, price, design, dt, horizon=horizon, moves=moves, price_of_states=state_price,
        limits=bounds(system.state, problem.state_limits),
    )  # fmt: skip
    return Feedback(design.gain, np.empty((len(design.gain), 0)), (), design.poles, prediction)


def bounds(state: Space, limits: Mapping[str, Sequence[float]]) -> tuple[Array, Array]:
    """Return the lower and the upper limits of all states (n,)."""
    if not isinstance(limits, Mapping):
        raise ValueError(f'{STATE_LIMIT}: expected limits by name, got {brief(limits)}')
    low, high = np.full(state.size, -inf), np.full(state.size, inf)
    for index, (name, pair) in zip(state.indices(limits, STATE_LIMIT), limits.items()):
        if np.shape(pair) != (2,) or not pair[0] < pair[1]:
            raise ValueError(f'{STATE_LIMIT}.{name}: expected [low, high], got {brief(pair)}')
        low[index], high[index] = pair
    return low, high


LAWS: Mapping[str, Callable[..., Feedback]] = {
    'lqr': _lqr,
    'placement': _placement,
    'lqi': _lqi,
    'mpc': _mpc,
}
#: Laws that keep limits of states, and the section of these.
WITHIN_LIMITS, STATE_LIMIT = ('mpc',), 'state_limit'
#: Laws whose gain is that of the linear-quadratic regulator where no limit acts.
OPTIMAL = 'lqr', 'mpc'


def law_options(law: str) -> tuple[Option, ...]:
    """Return the options of a law; ValueError if there is no such law."""
    refuse_unknown([law], LAWS, 'law')
    return options_of(LAWS[law])


def build_law(
    law: str,
    system: LinearSystem,
    weights: Cost,
    dt: float,
    options: Mapping[str, Any],
    regulator: Callable[[Array, Array, Cost], LqrDesign] = dlqr,
) -> Feedback:
    """Return the gains of a law for a system and the continuous weights of its cost.

    Of the ``options``, ``state_limit.NAME`` are limits of states, [low, high]. A law that keeps
    limits takes its gain from the ``regulator``.

    Raises
    ------
    ValueError
        If an option is wrong; DesignError if there is no such feedback.
    """
    refuse_unknown([law], LAWS, 'law')
    prefix = f'{STATE_LIMIT}.'
    limits = {
        name.removeprefix(prefix): pair
        for name, pair in options.items()
        if name.startswith(prefix) and law in WITHIN_LIMITS
    }
    others = {name: value for name, value in options.items() if not name.startswith(prefix)}
    feedback: Feedback = build_with(
        LAWS[law], others, Problem(system, weights, dt, limits, regulator)
    )
    return feedback
