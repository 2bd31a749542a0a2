# SPDX-License-Identifier: Apache-2.0
"""A plant as a computer sees it: its input is held over samples and delayed."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import ArrayLike, LinearSystem, matrix, zero_order_hold

from .state_space import StateSpace


def sampled_plant(system: LinearSystem, C: ArrayLike, dt: float, delay: float = 0.0) -> StateSpace:
    """Return a plant with its input held over samples of ``dt`` and delayed by ``delay`` seconds.

    The delay may be any number of samples, whole or not, and is exact: with tau = d dt + r the
    input that acts from k dt on is u(k - d - 1) for r seconds and u(k - d) for the rest, so the
    last d + 1 inputs join the state (Astrom and Wittenmark, Computer-Controlled Systems, 1997,
    section 2.3). With C the gain of a state feedback this is its loop.

    Parameters
    ----------
    system
        The plant, in continuous time.
    C
        Outputs (p, n).
    dt, delay
        In seconds.

    Raises
    ------
    ValueError
        If sizes do not fit, ``dt`` is not positive or ``delay`` is negative.
    """
    n, m = system.B.shape
    C = matrix('C', C, (len(np.atleast_2d(C)), n))
    if not dt > 0.0 or not delay >= 0.0:
        raise ValueError(f'dt, delay: expected dt > 0 and delay >= 0, got {dt} and {delay}')
    whole, part = divmod(delay / dt, 1.0)
    late = int(whole) + (part > 0.0)
    F, before = zero_order_hold(system.A, system.B, part * dt)
    rest, after = zero_order_hold(system.A, system.B, (1.0 - part) * dt)
    # columns: the state, then the inputs from the oldest to the newest
    inputs = np.zeros((n, (late + 1) * m))
    inputs[:, :m] += rest @ before if part else after
    if part:
        inputs[:, m : 2 * m] += after
    shift = np.eye(late * m, (late + 1) * m, m)
    whole_step = np.vstack((
        np.hstack((rest @ F, inputs)),
        np.hstack((np.zeros((late * m, n)), shift)),
    ))  # fmt: skip
    size = n + late * m
    outputs = np.hstack((C, np.zeros((len(C), late * m))))
    return StateSpace(
        whole_step[:, :size], whole_step[:, size:], outputs, np.zeros((len(C), m)), dt
    )
