# SPDX-License-Identifier: Apache-2.0
"""The most robust controller for a shape of the loop, from matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kalman_ros.control import loop_shaping as shaping
from kalman_ros.control.loop_shaping import BEYOND
from kalman_ros.control.state_space import state_space
from kalman_ros.core import Array, ArrayLike
from kalman_ros.core.known_names import KnownNames

from . import text
from .accept import number, plant, rows, weight
from .foreign import Labels, read_system
from .gain_results import Observer, StateFeedback
from .observers import observer_of


@dataclass(frozen=True, eq=False, repr=False)
class LoopShaping(KnownNames):
    """A controller that is most robust for a shape of the loop; it prints itself.

    Parameters
    ----------
    regulator
        K of u = -K x_hat; ``state_cost`` gives it as an `lqr`.
    estimator
        L; ``noise`` gives it as an `lqe`.
    state_cost
        Q (n, n) of the regulator.
    noise
        W (n, n) of the estimator, a spectral density.
    least, gamma
        The least gamma of any controller, and the one of this controller.
    """

    regulator: StateFeedback
    estimator: Observer
    state_cost: Array
    noise: Array
    least: float
    gamma: float

    @property
    def stability_margin(self) -> float:
        """The size of the changes of coprime factors that keep the loop stable, 1 / gamma."""
        return 1.0 / self.gamma

    def __repr__(self) -> str:
        lines = text.sentence(
            f'H-infinity loop shaping: stable for changes of the coprime factors below '
            f'{self.stability_margin:.4g}; no controller is above {1.0 / self.least:.4g}'
        )
        return '\n'.join([*lines, repr(self.regulator), repr(self.estimator)])


def loop_shaping(
    A: Any,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    R: ArrayLike = 1.0,
    V: ArrayLike = 1.0,
    *,
    beyond: float = BEYOND,
) -> LoopShaping:
    """Return the most robust controller for dx/dt = A x + B u, y = C x, shaped by R and V.

    It is that of K. Glover and D. McFarlane, IEEE Trans. Automatic Control 34(8), 1989, and an LQG
    controller: ``kr.lqr(A, B, result.state_cost, R)`` and ``kr.lqe(A, C, result.noise, V)`` are
    its gains, so that the nodes run it with these as their parameters.

    Parameters
    ----------
    A, B, C
        Matrices (n, n), (n, m) and (k, n); or a system of another library alone.
    R
        Input cost: a smaller one gives a faster loop.
    V
        Spectral density of the noise of the readings.
    beyond
        gamma divided by its least value, above 1.

    Raises
    ------
    ValueError
        If a size is wrong, or ``beyond`` is at most 1.
    DesignError
        If no input stabilises a mode, or no reading observes it.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.loop_shaping([[0, 1], [0, 0]], [0, 1], [1, 0]).least
    2.613125929752753
    """
    if C is None and (given := read_system('A', A)) is not None:
        C = given.C
    system = plant(A, B)
    n, m = system.B.shape
    C = rows('C', C, n)
    design = shaping.loop_shaping(
        state_space(system.A, system.B, C, dt=system.dt),
        weight('R', R, m, definite=True), weight('V', V, len(C), definite=True),
        number('beyond', beyond),
    )  # fmt: skip
    regulator = design.regulator
    return LoopShaping(
        StateFeedback(system, regulator.gain, regulator.poles, regulator.cost_to_go),
        observer_of(system.A, C, design.estimator, Labels(system.states, None, None), None),
        design.state_cost, design.noise, design.least, design.gamma,
    )  # fmt: skip
