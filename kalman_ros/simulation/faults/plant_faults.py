# SPDX-License-Identifier: Apache-2.0
"""All faults of a plant: those of its sensors, its actuator and its body."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from kalman_ros.core import Option, TimedSensor, Value, build_with, one_each, options_of
from kalman_ros.scenario import options, sensor_names

from . import FAULTS, options_of_sensors, settings_of, settings_of_sensors
from .body import BodyFaults, BodyOptions
from .links import Links
from .transit import Delay, Jitter, Reordering

#: Faults after which a reading may arrive at a later step.
_LATE = (Delay, Jitter, Reordering)


class PlantFaults:
    """The faults of a plant; all are off by default.

    Parameters
    ----------
    sensors
        Sensors of the plant, by name.
    size
        Number of its inputs m.
    body
        Options of body and actuator.
    settings
        Options of the sensors' faults, as ``SENSOR.option``; all of them.

    Raises
    ------
    ValueError
        If they do not match these sensors or inputs; the message names the option.
    """

    def __init__(
        self,
        sensors: Mapping[str, TimedSensor],
        size: int,
        body: BodyOptions,
        settings: Mapping[str, Value],
    ) -> None:
        self._timed = dict(sensors)
        #: Options of the faults of each sensor, by its name.
        self.sensors = settings_of_sensors(sensors, settings)
        #: Faults at the input.
        self.body = BodyFaults(body, size)
        #: Factor of each input (m,) before it acts, and its delay in seconds.
        self.gain = one_each('actuator_gain', body.actuator_gain, size)
        self.delay = body.actuator_delay

    @staticmethod
    def from_values(
        sensors: Mapping[str, TimedSensor], size: int, values: Mapping[str, Value]
    ) -> PlantFaults:
        """Return the faults set by parameters, which may contain other parameters, too."""
        known = {option.name: option for option in fault_options(sensors)}
        settings = {
            name: option.check(values.get(name, option.default)) for name, option in known.items()
        }
        body = {option.name: settings.pop(option.name) for option in options_of(BodyOptions)}
        return PlantFaults(sensors, size, build_with(BodyOptions, body), settings)

    def __str__(self) -> str:
        links = Links(0)
        links.configure(self._timed, self.sensors)
        actuator = {}
        if np.any(self.gain != 1.0):
            actuator['actuator_gain'] = self.gain.tolist()
        if self.delay:
            actuator['actuator_delay'] = self.delay
        on = [f'{name}: {value}' for name, value in actuator.items()]
        return ', '.join((*links.faults, *on, *self.body.on))

    @property
    def any(self) -> bool:
        """Whether any fault is on."""
        return bool(str(self))

    @property
    def late(self) -> bool:
        """Whether readings may arrive at a later step than the one at which they are taken."""
        return any(kind in _LATE for name in self.sensors for kind in self._on(name))

    def disturbs(self, sensor: str) -> bool:
        """Whether a sensor has faults."""
        return next(self._on(sensor), None) is not None

    def _on(self, sensor: str) -> Iterator[type]:
        values = self.sensors.get(sensor, {})
        return (kind for kind in FAULTS if settings_of(kind, values) is not None)


def plant_options(values: Mapping[str, Any]) -> dict[str, Option]:
    """Return the options of the scenario that ``values`` describe, and of its faults, by name.

    Raises
    ------
    ValueError
        If the model, a sensor or a kind is unknown.
    """
    known = options(values)
    sensors = sensor_names(values.get('sensors', known['sensors'].default))
    return {**known, **{option.name: option for option in fault_options(sensors)}}


def fault_options(sensors: Iterable[str]) -> Iterator[Option]:
    """Yield the options of all faults of a plant with sensors of these names."""
    yield from options_of(BodyOptions)
    yield from options_of_sensors(sensors)
