# SPDX-License-Identifier: Apache-2.0
"""What an estimator computes with: the state, and behind it the biases of sensors.

They are the estimator's own: plant, controller and monitor know nothing of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import (
    Array,
    Dynamics,
    Gaussian,
    Sensor,
    in_continuous_time,
    one_each,
    spectral_densities,
    variances,
)

from .biased_model import BiasedSensor, biased_model, blocks, longer


@dataclass(frozen=True)
class Bias:
    """What is believed of the bias of a sensor before the first reading, and how it moves.

    Parameters
    ----------
    covariance
        At the start (k, k), about zero.
    density
        Spectral density of its random walk (k, k).
    """

    covariance: Array
    density: Array


def bias(size: int, std: Sequence[float], noise: Sequence[float]) -> Bias | None:
    """Return the bias of a sensor of ``size`` coordinates; None if it has none.

    Parameters
    ----------
    size
        The number of coordinates k.
    std
        Standard deviations at the start, one a coordinate, or one for all.
    noise
        Spectral densities of the random walk, likewise.

    Raises
    ------
    ValueError
        If their number is wrong.
    """
    covariance = variances('bias_std', one_each('bias_std', std, size), size, exact=True)
    density = np.diag(spectral_densities(size, bias_noise=one_each('bias_noise', noise, size)))
    return Bias(covariance, density) if covariance.any() or density.any() else None


@dataclass(frozen=True)
class Believed:
    """What an estimator computes with: a scenario with the biases of its sensors as states.

    Parameters
    ----------
    model
        With the biases.
    sensors
        By name, disabled ones too.
    initial
        The first belief.
    places
        Where the bias of each sensor that has one is in the state.
    """

    model: Dynamics
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    places: Mapping[str, slice]

    def own(self, belief: Gaussian) -> Gaussian:
        """Return the belief of the states of the scenario's model alone."""
        if not self.places:
            return belief
        n = min(place.start for place in self.places.values())
        return Gaussian(belief.mean[..., :n], belief.covariance[..., :n, :n])

    def biases(self, belief: Gaussian) -> dict[str, Gaussian]:
        """Return the bias of each sensor that has one."""
        x, P = belief
        return {name: Gaussian(x[place], P[place, place]) for name, place in self.places.items()}


def believed(
    model: Dynamics, sensors: Mapping[str, Sensor], initial: Gaussian, biases: Mapping[str, Bias]
) -> Believed:
    """Return what an estimator computes with.

    Raises
    ------
    ValueError
        If there are biases, and the model is in discrete time.
    """
    if not biases:
        return Believed(model, sensors, initial, {})
    if model.is_discrete:
        raise ValueError(f'{next(iter(biases))}.bias_std: expected a model in continuous time')
    names: list[str] = []
    units: list[str] = []
    places = {}
    P = initial.covariance
    density = np.zeros((0, 0))
    for name, sensor_bias in biases.items():
        output, start = sensors[name].output, len(P)
        places[name] = slice(start, start + output.size)
        names += [f'{name}.bias.{coordinate}' for coordinate in output.names]
        units += output.units
        P, density = blocks(P, sensor_bias.covariance), blocks(density, sensor_bias.density)
    whole = biased_model(in_continuous_time(model), names, units, density)
    none = slice(len(P), len(P))
    biased_sensors = {
        name: BiasedSensor(sensor, whole.state, places.get(name, none))
        for name, sensor in sensors.items()
    }
    mean = longer(initial.mean, np.zeros(len(names)))
    return Believed(whole, biased_sensors, Gaussian(mean, P), places)
