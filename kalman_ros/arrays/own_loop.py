# SPDX-License-Identifier: Apache-2.0
"""The estimator and the regulator of the nodes, for a loop of your own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array, ArrayLike, Gaussian
from kalman_ros.core.known_names import KnownNames
from kalman_ros.estimators import online
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.loop_law import Answer, Reference

from . import text
from .accept import belief_of, duration, finite, got, limits_given, number, numbers, seconds, whole
from .loop_setup import Given, law_of
from .passing import gate_limits
from .rows import sensors_of


class OnlineEstimator(KnownNames):
    """A filter in time, as in the estimator node: readings may be late, doubtful or missing.

    Late readings are inserted where they belong and what follows is computed again, so that the
    order of arrival does not matter.

    Parameters
    ----------
    filter
        A filter of a model, such as ``kr.ExtendedKalmanFilter(model)``.
    sensors
        One sensor, several by name ``{'gps': ..., 'imu': ...}``, or a pair (H, R).
    initial
        The belief at the first time received: a `Gaussian`, or a pair of mean and covariance.
    input
        The input (m,) in effect until the first one is added; zero by default.
    window
        Seconds for which late readings are accepted.
    gates
        The probability that a valid reading passes, such as 0.999, for all sensors or by name.
    recover_after
        The number of rejected readings in a row after which the covariance is widened; 0: never.
    max_gap
        Seconds of silence after which the estimator restarts from the initial belief; 0: never.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.

    See Also
    --------
    kalman_ros.filter : all readings of a recording at once

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kalman = kr.KalmanFilter(kr.discrete_model(1.0, Q=0.2, period=0.1))
    >>> estimator = kr.OnlineEstimator(kalman, ([[1.0]], 1.0), (0.0, 4.0), gates=0.999)
    >>> for time, y in ((0.0, 1.0), (0.2, 50.0), (0.1, 1.2)):  # one off, and one late
    ...     print(estimator.add_reading(time, [y])[0].name)
    FUSED
    REJECTED
    FUSED
    """

    def __init__(
        self,
        filter: Any,
        sensors: Any,
        initial: Any,
        *,
        input: ArrayLike | None = None,
        window: float = 1.0,
        gates: float | Mapping[str, float] | None = None,
        recover_after: int = 20,
        max_gap: float = 60.0,
    ) -> None:
        whole_filter = all(hasattr(filter, name) for name in ('predict', 'correct', 'model'))
        if isinstance(filter, type) or not whole_filter:
            raise ValueError(
                f'filter: expected one such as kr.ExtendedKalmanFilter(model), got {got(filter)}'
            )
        self._model = model = filter.model
        self._sensors = sensors_of(sensors, model)
        before = np.zeros(model.input.size) if input is None else self._input(input)
        policy = Policy(
            window=seconds('window', window),
            gates=gate_limits(gates, self._sensors, {name: name for name in self._sensors}),
            recover_after=whole('recover_after', recover_after),
            max_gap=seconds('max_gap', max_gap),
        )
        first = belief_of(initial, model)
        self._online = online.OnlineEstimator(filter, self._sensors, first, before, policy)

    @property
    def belief(self) -> Gaussian:
        """The belief at `time`."""
        return self._online.belief

    @property
    def time(self) -> float | None:
        """The time of the newest reading or input, in seconds; None before the first."""
        time = self._online.time
        return None if time is None else time * 1e-9

    @property
    def counts(self) -> dict[str, dict[str, int]]:
        """The number of readings of each sensor by their outcome."""
        counts = self._online.counts.items()
        return {
            name: {outcome.value: n for outcome, n in outcomes.items() if n}
            for name, outcomes in counts
        }

    @property
    def restarts(self) -> int:
        """How many times it restarted from the initial belief."""
        return self._online.restarts

    def add_reading(
        self, time: float, y: ArrayLike, sensor: str = '', covariance: ArrayLike | None = None
    ) -> tuple[Outcome, Correction | None]:
        """Add a reading; one that cannot be used is counted with the reason, and changes nothing.

        Parameters
        ----------
        time
            When it was taken, in seconds.
        y
            Its numbers (k,).
        sensor
            The name of the sensor; not needed if there is one alone.
        covariance
            Of this reading (k, k), a diagonal, or a number; by default the sensor's.

        Returns
        -------
        Outcome, Correction or None
            What happened to it, and what was computed, also if the gate rejected it.

        Raises
        ------
        ValueError
            If there is no such sensor, or an argument is no number.
        """
        name = sensor or next(iter(self._sensors))
        if name not in self._sensors or (not sensor and len(self._sensors) > 1):
            known = ', '.join(self._sensors)
            raise ValueError(f"sensor: expected one of {known}, got '{sensor}'")
        R = None if covariance is None else numbers('covariance', covariance)
        k = self._sensors[name].output.size
        if R is not None and R.ndim < 2:
            R = np.diag(np.full(k, R) if R.ndim == 0 else R)
        return self._online.add_reading(name, _stamp(time), np.ravel(numbers('y', y)), R)

    def add_input(self, time: float, u: ArrayLike) -> None:
        """Set the input (m,) in effect from a time in seconds on."""
        self._online.add_input(_stamp(time), self._input(u))

    def predicted(self, time: float) -> Gaussian:
        """Return the belief at a later time in seconds; nothing is kept."""
        stamp, newest = _stamp(time), self._online.time
        if newest is not None and self._online.nearest(stamp) < newest:
            raise ValueError(f'time: expected one from {newest * 1e-9:g} on, got {time:g}')
        return self._online.predicted(stamp)

    def reset(self, initial: Any) -> None:
        """Start again with a belief at the next time received; counts continue."""
        self._online.reset(belief_of(initial, self._model))

    def _input(self, u: ArrayLike) -> Array:
        return finite('input', u, self._model.input.size)

    def __repr__(self) -> str:
        kind = type(self._online.filter).__name__
        when = 'nothing received' if self.time is None else f'at {self.time:.6g} s'
        space = self._model.state
        labels = map(space.label, space.names)
        rows = zip(labels, self.belief.mean, self.belief.std)
        lines = [f'{kind} of {type(self._model).__name__} in time, {when}']
        lines += [f'{label:<12} {mean:12.5g} ± {std:.3g}' for label, mean, std in rows]
        lines += [
            f'{name}: ' + ', '.join(f'{n} {words}' for words, n in outcomes.items())
            for name, outcomes in self.counts.items()
            if outcomes
        ]
        return '\n'.join(lines)


class Regulator(KnownNames):
    """The law of the controller node: an estimate in, an input within its limits out.

    Parameters
    ----------
    scenario, overrides
        As for `load`: the model, the law (``lqr``, ``placement`` or ``lqi``), weights, the rate.
    reference
        The state to hold: (n,), or some of it by name, ``{'x': 1.0}``, the rest at the
        equilibrium; or a function of the time in seconds that returns either.
    gain
        K (m, n), instead of the law's.
    input_limit, input_lower_limit, input_rate_limit
        The largest magnitude of the input, its smallest value where that is another, and its
        largest change per second; one number for all inputs.

    Raises
    ------
    ValueError
        If an argument is invalid, or no input holds the reference.
    DesignError
        If the law has no solution.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> regulator = kr.Regulator('cart_pole', input_limit=20.0)
    >>> regulator.step([0.0, 0.0, 0.1, 0.0]).round(2)
    array([-9.51])
    """

    def __init__(
        self,
        scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
        overrides: Mapping[str, Any] | None = None,
        *,
        reference: Reference = None,
        gain: ArrayLike | None = None,
        input_limit: ArrayLike | None = None,
        input_lower_limit: ArrayLike | None = None,
        input_rate_limit: ArrayLike | None = None,
    ) -> None:
        given = Given(
            reference, gain, limits_given(input_limit, input_lower_limit, input_rate_limit)
        )
        self._law = law_of(scenario, overrides, given)
        self._answer: Answer = self._law()
        self._time, self._begun = 0, False
        self._input = np.zeros(self._law.scenario.model.input.size)

    @property
    def dt(self) -> float:
        """The length of a step in seconds, for which the gain is designed."""
        return 1.0 / self._law.scenario.rate

    @property
    def gain(self) -> Array:
        """K (m, n), about what it holds."""
        return self._answer.gain

    @property
    def target(self) -> Array:
        """The state (n,) that it holds."""
        return self._answer.target

    @property
    def input(self) -> Array:
        """The last input (m,)."""
        return self._input

    @property
    def limited(self) -> int:
        """The number of inputs that a limit has changed."""
        return int(self._answer.limited)

    def hold(self, reference: Reference) -> None:
        """Hold another reference from now on; None for the equilibrium.

        Raises
        ------
        ValueError
            If it is no state of the model, or no input holds the system there.
        """
        self._answer.hold(reference)

    def step(self, estimate: Gaussian | ArrayLike, dt: float | None = None) -> Array:
        """Return the input (m,) for an estimate ``dt`` seconds after the last one.

        Parameters
        ----------
        estimate
            A state (n,), or a belief, of which the mean counts.
        dt
            By default the length of a step.

        Raises
        ------
        ValueError
            If the estimate is not a finite state; the input stays as it is.
        """
        given = estimate.mean if isinstance(estimate, Gaussian) else estimate
        x = finite('estimate', given, len(self.target))
        passed = self.dt if dt is None else duration('dt', dt)
        if self._begun:  # the first one is at the time 0 of a reference
            self._time += round(passed * 1e9)
        self._begun = True
        self._input = self._answer(self._time, x)
        return self._input

    def __repr__(self) -> str:
        scenario = self._law.scenario
        lines = [f'{scenario.law} of {type(scenario.model).__name__}, {scenario.rate:g} Hz, K =']
        model = scenario.model
        lines += text.matrix(model.input.names, model.state.names, self.gain)
        lines.append(f'holds {np.array2string(self.target, precision=4, suppress_small=True)}')
        return '\n'.join(lines)


def _stamp(time: Any) -> int:
    """Return a time in whole nanoseconds."""
    at = number('time', time, 'a number of seconds')
    if not abs(at) < 9e9:  # a stamp holds no more
        raise ValueError(f'time: expected a number of seconds, got {at:g}')
    return round(at * 1e9)
