# SPDX-License-Identifier: Apache-2.0
"""Estimation by the options of an estimator's node, with a check that it can start."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from kalman_ros.compiled import is_available
from kalman_ros.compiled.parts import COMPILED, IN_C, NUMPY, chosen
from kalman_ros.core import Array, Gaussian, Sensor, Value, is_finite
from kalman_ros.estimators import NATIVE, filter_class
from kalman_ros.estimators.diffuse import begun, known_part
from kalman_ros.estimators.filter import Filter
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation, estimation

from .estimator_options import EstimatorOptions


def fusion(
    scenario: Scenario,
    options: EstimatorOptions,
    extra: Mapping[str, Value],
    *,
    wait: bool = True,
    many: bool = False,
) -> Estimation:
    """Return the estimation by the ``options``, and by the ``extra`` options of a filter.

    Parameters
    ----------
    scenario, options, extra
        As of an estimator's node.
    wait
        Whether to wait for a C compiler.
    many
        Whether a filter that takes messages one by one is worth its compilation as a whole, as
        for a long recording; it is not where that is not possible.

    Raises
    ------
    ValueError
        If an option is wrong, as for `estimation`.
    """
    in_c = options.arithmetic == IN_C
    if not in_c and options.arithmetic not in (COMPILED, NUMPY):
        expected = f'{COMPILED}, {NUMPY} or {IN_C}'
        raise ValueError(f"arithmetic: expected {expected}, got '{options.arithmetic}'")
    setup = estimation(
        scenario,
        policy(scenario, options),
        options=extra,
        implementation=options.implementation,
        arithmetic=COMPILED if in_c else options.arithmetic,
        wait=wait,
    )
    unknown = np.isinf(setup.initial.covariance.diagonal()).any()
    for option in ('lockstep', 'fixed_lag'):
        if unknown and getattr(options, option):
            raise ValueError(
                f'initial_std: expected finite ones with {option}, got an infinite one'
            )
    if options.lockstep and scenario.input.stamp_offset:
        raise ValueError('input.stamp_offset: expected 0 with lockstep, where inputs answer steps')
    if in_c:
        return _in_c(scenario, setup, options, wait=wait)
    if many and not setup.filter.has_first_steps and chosen(options.arithmetic) == COMPILED:
        with suppress(ValueError):
            return _in_c(scenario, setup, options, wait=wait)
    return setup


def _in_c(
    scenario: Scenario, setup: Estimation, options: EstimatorOptions, *, wait: bool
) -> Estimation:
    if options.implementation != NATIVE:
        raise ValueError(
            f'arithmetic: {IN_C} is a filter of this package, '
            f'which implementation: {options.implementation} is not'
        )
    if not is_available():
        raise ValueError(f'arithmetic: {IN_C} is not possible here: CasADi is not installed')
    from kalman_ros.embedded.filter_in_c import in_c  # CasADi is slow to load

    return in_c(scenario, setup, wait=wait)


def policy(scenario: Scenario, options: EstimatorOptions) -> Policy:
    """Return the treatment of imperfect data by an estimator with these options."""
    if options.initialize not in ('belief', 'reading', 'rest'):
        raise ValueError(
            f"initialize: expected belief, reading or rest, got '{options.initialize}'"
        )
    kind = filter_class(scenario.filter)
    if options.initialize == 'rest' and (kind.fixed_gain or kind.mixture):
        raise ValueError(f'initialize: rest is not for {scenario.filter}, which has no such start')
    rests = options.rest_until_input and not options.lockstep and bool(scenario.input.fields)
    return Policy(
        window=options.window,
        recover_after=options.gate_recover_after,
        restart_after=options.restart_after,
        max_gap=options.max_gap,
        future_tolerance=options.future_tolerance,
        from_reading=options.initialize == 'reading',
        from_rest=options.initialize == 'rest',
        rest_until_input=rests,
    )


def check_start(built: Estimation, scenario: Scenario) -> None:
    """Raise ValueError if no reading could ever correct the initial belief.

    Its numbers may be finite but too large to compute with, or become so in a step of the model.
    """
    belief, filter = begun(built.initial), built.filter
    sensors = [built.sensors[name] for name in scenario.enabled]
    zero = np.zeros(scenario.model.input.size)

    def starts(first: Gaussian) -> bool:
        return any(_corrects(filter, first, zero, sensor, scenario.rate) for sensor in sensors)

    with np.errstate(all='ignore'):
        if not sensors or starts(belief):
            return
        belief = known_part(belief)
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
            correction = filter.correct(first, sensor.measure(first.mean), sensor)
            posterior = known_part(correction.posterior)
            if not is_finite(posterior.mean) or not is_finite(posterior.covariance):
                return False
    except (ArithmeticError, np.linalg.LinAlgError):
        return False
    return True


def falls_while_idle(scenario: Scenario, options: EstimatorOptions) -> str:
    """Return what to set where the state does not rest without an input; '' where it does.

    So the specific force of an IMU holds the weight of the body, and without it that falls.
    """
    rest = scenario.model.equilibrium.input
    rests = options.rest_until_input and options.idle_input != 'zero'
    if rests or options.lockstep or not scenario.input.fields or not rest.any():
        return ''
    held = ', '.join(
        f'{name} {value:.4g}' for name, value in zip(scenario.model.input.names, rest) if value
    )
    return (
        f'at rest the input is {held}: with idle_input: equilibrium and rest_until_input: true, '
        'the state rests until the first one'
    )
