# SPDX-License-Identifier: Apache-2.0
"""Builds the filter and the policy of an estimator from a scenario and its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.compiled.parts import NUMPY, parts
from kalman_ros.core import Array, Gaussian, Sensor, Value, is_finite
from kalman_ros.estimators import NATIVE, build_filter
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.filter import Filter
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario

from .estimator_options import EstimatorOptions


@dataclass(frozen=True)
class Fusion:
    """A filter, its sensors by name, and how to treat late, doubtful or missing data.

    Parameters
    ----------
    filter, sensors, policy
        What an `OnlineEstimator` takes.
    arithmetic
        What computes the model and the sensors, in words.
    pending
        What is still to be compiled, for `compiled.library.load`.
    """

    filter: Filter
    sensors: Mapping[str, Sensor]
    policy: Policy
    arithmetic: str
    pending: Sequence[str] = ()


def fusion(
    scenario: Scenario,
    options: EstimatorOptions,
    extra: Mapping[str, Value],
    *,
    wait: bool = True,
) -> Fusion:
    """Return the filter that the ``options``, and its own ``extra`` ones, describe.

    Without ``wait``, what was not compiled before is `Fusion.pending`.

    Raises
    ------
    ValueError
        If the filter is unknown, or does not support the scenario.
    """
    if options.initialize not in ('belief', 'reading'):
        raise ValueError(f"initialize: expected belief or reading, got '{options.initialize}'")
    gates = {
        name: chi_square_gate(source.gate, source.sensor.output.size)
        for name, source in scenario.sensors.items()
        if source.gate < 1.0
    }
    rests = options.rest_until_input and not options.lockstep and bool(scenario.input.fields)
    policy = Policy(
        window=options.window,
        gates=gates,
        recover_after=options.gate_recover_after,
        restart_after=options.restart_after,
        max_gap=options.max_gap,
        future_tolerance=options.future_tolerance,
        from_reading=options.initialize == 'reading',
        rest_until_input=rests,
    )
    believed, plan = scenario.believed, scenario.believed_plan
    chosen = options.arithmetic if options.implementation == NATIVE else NUMPY
    fast = parts(believed.model, believed.sensors, chosen, wait=wait)
    plan = plan.computed_by(fast.model, fast.sensors)
    filter = build_filter(scenario.filter, plan, extra, options.implementation)
    return Fusion(filter, fast.sensors, policy, fast.arithmetic, fast.pending)


def check_start(found: Fusion, scenario: Scenario) -> None:
    """Raise ValueError if no reading could ever correct the initial belief.

    Its numbers may be finite, but too large to compute with; or the model makes them so in a step.
    """
    belief, filter = scenario.believed.initial, found.filter
    sensors = [found.sensors[name] for name in scenario.enabled]
    zero = np.zeros(scenario.model.input.size)

    def starts(first: Gaussian) -> bool:
        return any(_corrects(filter, first, zero, each, scenario.rate) for each in sensors)

    with np.errstate(all='ignore'):
        if not sensors or starts(belief):
            return
        if not starts(Gaussian(belief.mean, np.eye(len(belief.mean)))):
            step = 1.0 / scenario.rate
            raise ValueError(
                f'model_parameters: within a step of {step:g} s, 1 / rate, the model grows beyond '
                'what a filter can compute with'
            )
    std = np.sqrt(belief.covariance.diagonal()).tolist()
    raise ValueError(f'initial_std: no filter can compute with {std}: too large or small')


def _corrects(filter: Filter, belief: Gaussian, u: Array, sensor: Sensor, rate: float) -> bool:
    """Return whether a typical reading gives a finite belief, now and a step later."""
    try:
        for first in (belief, filter.predict(belief, u, 1.0 / rate)):
            posterior = filter.correct(first, sensor.measure(first.mean), sensor).posterior
            if not is_finite(posterior.mean) or not is_finite(posterior.covariance):
                return False
    except (ArithmeticError, np.linalg.LinAlgError):
        return False
    return True
