# SPDX-License-Identifier: Apache-2.0
"""The likelihood of a bag with a parameter file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import models
from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.analysis.tuning.observations import Observations, Readings
from kalman_ros.analysis.tuning.walk import Conditions
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import estimator_settings, replay_bag
from kalman_ros.bags.replayed import Replayed, SensorReplay
from kalman_ros.core import Array
from kalman_ros.pipeline.fusion import policy as policy_of
from kalman_ros.scenario import shipped
from kalman_ros.scenario.estimation import by_innovation
from kalman_ros.scenario.idle import idle_input
from kalman_ros.scenario.parameter_files import from_file

#: Fewest numbers for each fitted parameter.
_LEAST = 5


@dataclass(frozen=True)
class Recorded:
    """A recording for a fit.

    Parameters
    ----------
    likelihood
        Likelihood of the readings that are not held out.
    named
        Parameters by name, with the choice of those to fit.
    notes
        Sentences on properties of the recording that affect the fit.
    """

    likelihood: Likelihood
    named: NamedParameters
    notes: tuple[str, ...]


def load(
    bag: Path,
    params: Path | None,
    changes: Mapping[str, Any],
    fit: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
    hold_out: float,
    part: tuple[float, float] = (0.0, inf),
) -> Recorded:
    """Return the likelihood of a bag with the estimator of a parameter file.

    Raises
    ------
    ValueError
        If a parameter is wrong, or the bag has too few readings.
    """
    file = shipped.file(params or models.DEFAULT)
    values = {'model': models.DEFAULT, **from_file(file, 'estimator'), **changes}
    settings = estimator_settings(values)
    named = NamedParameters(values, settings.extra)
    chosen = named.choose(list(fit) or named.usual, bounds, priors)
    replayed = replay_bag(Bag(bag), settings, start=part[0], end=part[1])
    constant = [name for name in _constant(replayed) if name in named.names]
    if any(parameter.name in constant for parameter in chosen):
        chosen = named.choose(_changing(named, fit, constant), bounds, priors)
    observations = _observations(replayed, named)
    if observations.count < _LEAST * len(chosen):
        raise ValueError(
            f'{bag}: expected at least {_LEAST * len(chosen)} numbers to fit {len(chosen)} '
            f'parameters to, got {observations.count}'
        )
    options = settings.in_lockstep(replayed.lockstep).options
    policy = by_innovation(settings.scenario, policy_of(settings.scenario, options))
    conditions = Conditions(policy, idle_input(settings.scenario.model, options.idle_input))
    until = observations.until(1.0 - hold_out) if hold_out else None
    likelihood = Likelihood(chosen, named.candidate, observations, conditions, until)
    notes = [*_notes(replayed, named, observations), *map(_about_constant, constant)]
    return Recorded(likelihood, named, tuple(notes))


def _constant(replayed: Replayed) -> Iterator[str]:
    """Yield the names of the noise of coordinates whose readings are all the same.

    Zeros that are known without a sensor are so by intention, and have a noise that fits.
    """
    for name, sensor in replayed.sensors.items():
        source = replayed.scenario.sensors[name]
        output = source.sensor.output
        if source.signal.zero:
            continue
        for coordinate, values in zip(output.names, sensor.value.T):
            finite = values[np.isfinite(values)]
            if len(finite) > 1 and (finite == finite[0]).all():
                yield f'{name}.noise' if output.size == 1 else f'{name}.noise.{coordinate}'


def _about_constant(name: str) -> str:
    sensor, _, coordinate = name.partition('.noise')
    return (
        f'All readings of {sensor}{coordinate} are the same: no sensor takes them, and no noise '
        'fits. Leave it out, or declare its noise.'
    )


def _changing(named: NamedParameters, fit: Sequence[str], constant: Sequence[str]) -> list[str]:
    """Return what to fit without the noise of coordinates that do not change.

    Raises
    ------
    ValueError
        If such a noise is named alone, or if nothing else is left.
    """
    for name in fit:
        if name in constant:
            raise ValueError(f'fit: {name}: {_about_constant(name)}')
    chosen = [parameter.name for parameter in named.choose(list(fit) or named.usual)]
    left = [name for name in chosen if name not in constant]
    if not left:
        raise ValueError(f'fit: {_about_constant(constant[0])}')
    return left


def _observations(replayed: Replayed, named: NamedParameters) -> Observations:
    configured = named.configured_noise()
    readings = {
        name: _readings(
            replayed.sensors[name], configured=name in configured, taken=not source.signal.zero
        )
        for name, source in named.scenario.enabled.items()
        if name in replayed.sensors
    }
    inputs = replayed.inputs
    order = np.argsort(inputs.stamp, kind='stable')
    stamps = np.rint(inputs.stamp[order] * 1e9).astype(np.int64)
    return Observations(readings, stamps, inputs.value[order])


def _readings(sensor: SensorReplay, *, configured: bool, taken: bool) -> Readings:
    """Return the readings that a filter can take, by stamp, each stamp once."""
    use: Any = np.isfinite(sensor.stamp) & np.isfinite(sensor.value).all(axis=1)
    if not configured:
        use &= _definite(sensor.covariance)
    indices = np.flatnonzero(use)
    stamps = np.rint(sensor.stamp[indices] * 1e9).astype(np.int64)
    stamps, first = np.unique(stamps, return_index=True)
    rows = indices[first]
    covariance = None if configured else sensor.covariance[rows]
    return Readings(stamps, sensor.value[rows], covariance, taken)


def _definite(covariance: Array) -> Any:
    """Return the mask (N,) of covariances (N, k, k) that are finite and positive definite."""
    finite: Any = np.isfinite(covariance).all(axis=(1, 2))
    lowest = np.linalg.eigvalsh(np.where(finite[:, None, None], covariance, 0.0))
    positive: Any = lowest.min(axis=1, initial=np.inf) > 0.0
    return finite & positive


def _notes(
    replayed: Replayed, named: NamedParameters, observations: Observations
) -> Iterator[str]:
    yield from replayed.notes
    for name in sorted(named.configured_noise()):
        source = named.scenario.sensors[name]
        R, used = source.sensor.covariance, replayed.sensors[name].covariance
        if source.covariance_from != 'configuration' and not np.allclose(used, R):
            yield (
                f'The messages of {name} have a covariance; the fitted noise replaces it '
                '(covariance_from: configuration).'
            )
    for name, series in observations.readings.items():
        if not len(series.stamp):
            yield f'{name} has no reading that can be used.'
    u = observations.input
    if named.scenario.model.input.size and not (u != u[:1]).any():
        yield (
            'The input does not change in this recording: parameters that only it shows are not '
            'determined.'
        )
    if replayed.restarts:
        yield f'The estimator restarted {replayed.restarts} times; ./dev doctor may say why.'
