# SPDX-License-Identifier: Apache-2.0
"""The Luenberger observer: gains by placing the poles of the error.

D. Luenberger, An Introduction to Observers, IEEE Trans. Automatic Control 16(6), 1971.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from kalman_ros.core import About, DesignError
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.plan import Plan
from kalman_ros.linear.placement import place_observer, pole_pairs


class LuenbergerObserver(FixedGainObserver):
    """The observer of a linear system whose gains place the poles of the error."""

    needs_continuous = True
    optimal = False

    @classmethod
    def build(
        cls,
        plan: Plan,
        observer_poles: Annotated[
            Sequence[float],
            About(
                'real parts of the poles of the error, up to one per state',
                '1/s',
                maximum=-1e-9,
                live=True,
            ),
        ] = (-4.0,),
        observer_frequencies: Annotated[
            Sequence[float],
            About(
                'their imaginary parts, in pairs of both signs; zero where not given', live=True
            ),
        ] = (0.0,),
    ) -> LuenbergerObserver:
        """Return the observer whose error, with all sensors together, has the given poles.

        The continuous gain L with eig(A - L C) at the poles is divided among the readings: a
        reading of a sensor with period T corrects by L T. If there are fewer poles than states,
        `pole_pairs` completes them.

        Raises
        ------
        DesignError
            If there are no sensors, if they do not observe every state, or if a pole is too fast
            for the rates of the sensors.
        ValueError
            If there are more poles than states, or a complex pole has no conjugate.
        """
        model: Any = plan.model
        n = model.state.size
        poles = cls.placed_poles(
            n, observer_poles=observer_poles, observer_frequencies=observer_frequencies
        )
        if not plan.sensors:
            raise DesignError('filter: luenberger needs at least one enabled sensor')
        x = np.zeros(n)
        C = np.vstack([timed.sensor.jacobian(x) for timed in plan.sensors.values()])
        try:
            L = place_observer(model.A, C, poles).gain
        except ValueError as error:  # also a DesignError
            raise DesignError(f'observer_{error}') from None
        gains, start = {}, 0
        for name, timed in plan.sensors.items():
            k = timed.sensor.output.size
            gains[name] = L[:, start : start + k] / timed.rate
            start += k
        observer = cls(model, gains)
        _check_decay(plan, observer)
        return observer

    @classmethod
    def placed_poles(cls, n: int, **options: Any) -> list[complex]:
        """Return the n poles in 1/s of the continuous gain with these options."""
        poles, frequencies = names = 'observer_poles', 'observer_frequencies'
        return pole_pairs(names, options[poles], options[frequencies], n)


def _check_decay(plan: Plan, observer: FixedGainObserver) -> None:
    """Raise DesignError if the error grows over a period of the readings."""
    n = observer.model.state.size
    transition = np.eye(n)
    F = observer.model.sampled(plan.dt).F
    for step in range(plan.period):
        transition = F @ transition
        for name in plan.due(step):
            C = plan.sensors[name].sensor.jacobian(np.zeros(n))
            transition = (np.eye(n) - observer.gains[name] @ C) @ transition
    if not np.max(np.abs(np.linalg.eigvals(transition))) < 1.0:
        raise DesignError('observer_poles: too fast for the rates of the sensors')


FILTER = LuenbergerObserver
