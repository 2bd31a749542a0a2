# SPDX-License-Identifier: Apache-2.0
"""Search for the stability boundary of a running loop in one parameter of its plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from std_srvs.srv import Trigger

from kalman_ros.core import Array
from kalman_ros.harness import Run

#: Relative accuracy of the boundary.
PRECISION = 3e-3
#: Largest number of steps: a loop that is stable beyond has no boundary in practice.
_MOST_RUNGS = 20


@dataclass(frozen=True)
class Trial:
    """The behaviour of a loop with one value of the parameter, from the plant's initial state.

    Parameters
    ----------
    value
        Value of the parameter.
    time, size
        Seconds since the start (N,), and norm of the state (N,).
    rate
        Growth of the slowest mode, in 1/s.
    """

    value: float
    time: Array
    size: Array
    rate: float


def trial(run: Run, parameter: str, value: float, seconds: float) -> Trial:
    """Reset the plant of a nearly noise-free run and measure its growth."""
    run.set_parameter(parameter, [value] if parameter == 'actuator_gain' else value)
    for node in ('plant', 'estimator'):
        _reset(run, node)
    dt, start = 1.0 / run.scenario.rate, run.elapsed
    run.advance(seconds)
    trajectory = run.trajectory()
    new = trajectory.time > start + 0.5 * dt
    time, states = trajectory.time[new] - start, trajectory.truth[new]
    return Trial(
        value, time, np.linalg.norm(states, axis=1), growth_rate(states[len(states) // 2 :], dt)
    )


def stability_boundary(
    run: Run, parameter: str, start: float, factor: float, seconds: float
) -> tuple[float, list[Trial]]:
    """Return the value at which a loop, stable at ``start``, becomes unstable, and all trials.

    The value changes by ``factor`` until a trial grows, and is then refined between the last two
    to a rate of zero.

    Raises
    ------
    RuntimeError
        If the loop grows from the start, or at no value.
    """
    trials: list[Trial] = []

    def rate(value: float) -> float:
        trials.append(trial(run, parameter, value, seconds))
        return trials[-1].rate

    ladder = [start * factor**rung for rung in range(_MOST_RUNGS)]
    rung = next((index for index, value in enumerate(ladder) if rate(value) >= 0.0), 0)
    if not rung:
        raise RuntimeError(f'{parameter}: no boundary from {start:g} to {trials[-1].value:g}')
    known = {result.value: result.rate for result in trials}
    low, high = ladder[rung - 1], ladder[rung]
    return root(lambda value: known.get(value) or rate(value), low, high), trials


def root(rate: Callable[[float], float], low: float, high: float) -> float:
    """Return the value with rate zero, to `PRECISION`."""
    return float(brentq(rate, low, high, xtol=PRECISION * min(low, high), rtol=PRECISION))


def _reset(run: Run, node: str) -> None:
    client = run.node.create_client(Trigger, f'{node}/reset')
    run.wait(client.service_is_ready, 10.0, lambda: f'the {node} was not reached')
    future = client.call_async(Trigger.Request())
    run.wait(future.done, 10.0, lambda: f'the {node} was not reset')
    run.node.destroy_client(client)


def growth_rate(states: Array, dt: float) -> float:
    """Return the growth of the slowest pair of modes, once it is all that is left.

    Every coordinate then obeys x'' = a x' + b x from step to step with the same a and b. Every
    step counts equally, whatever its size.
    """
    first, second, third = states[:-2], states[1:-1], states[2:]
    weight = 1.0 / np.linalg.norm(second, axis=1, keepdims=True)
    before = np.stack([(weight * x).ravel() for x in (second, first)], axis=1)
    a, b = np.linalg.lstsq(before, (weight * third).ravel(), rcond=None)[0]
    return float(np.log(np.max(np.abs(np.roots([1.0, -a, -b])))) / dt)
