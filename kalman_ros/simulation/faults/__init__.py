# SPDX-License-Identifier: Apache-2.0
"""Faults of a plant's sensors, its actuator and its body."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from kalman_ros.core import Option, TimedSensor, Value, build_with, options_of

from .fault import Fault, Window, window
from .transit import BurstLoss, Delay, Dropout, Duplication, Jitter, Reordering
from .values import Bias, Drift, Freeze, NotANumber, Outliers, RandomWalk

#: Faults in the order in which they act: first on the values, then on the transport. A new one
#: only a class and its name here.
FAULTS: tuple[type[Fault], ...] = (
    Bias,
    Drift,
    RandomWalk,
    Outliers,
    Freeze,
    NotANumber,
    Dropout,
    BurstLoss,
    Delay,
    Jitter,
    Reordering,
    Duplication,
)

#: Options of each fault, by its class.
_OPTIONS = {kind: options_of(kind) for kind in FAULTS}
_WINDOW = options_of(window)


def fault_options() -> tuple[Option, ...]:
    """Return the options of all sensor faults, without the sensor's name."""
    return (*_WINDOW, *(option for options in _OPTIONS.values() for option in options))


def options_of_sensors(names: Iterable[str]) -> Iterator[Option]:
    """Yield the options of all faults of these sensors, with the sensor's name."""
    for name in names:
        for option in fault_options():
            yield Option(f'{name}.{option.name}', option.default, option.about)


def settings_of_sensors(
    sensors: Mapping[str, TimedSensor], values: Mapping[str, Value]
) -> dict[str, dict[str, Value]]:
    """Return the fault settings in ``values``, by sensor.

    Raises
    ------
    ValueError
        If the faults of a sensor are invalid; the message names the option.
    """
    settings = {}
    for name, timed in sensors.items():
        settings[name] = {o.name: values[f'{name}.{o.name}'] for o in fault_options()}
        try:
            check(timed, settings[name])
        except ValueError as error:
            raise ValueError(f'{name}.{error}') from None
    return settings


def settings_of(kind: type[Fault], values: Mapping[str, Value]) -> dict[str, Value] | None:
    """Return the settings of one fault; None if it is off."""
    settings = {option.name: values.get(option.name, option.default) for option in _OPTIONS[kind]}
    return settings if np.any(next(iter(settings.values()))) else None


def window_of(values: Mapping[str, Any]) -> Window:
    """Return the time window in which the faults of a sensor act."""
    return window(**{o.name: values[o.name] for o in _WINDOW if o.name in values})


def check(timed: TimedSensor, values: Mapping[str, Value]) -> None:
    """Raise ValueError, naming the option, if the faults of a sensor are invalid."""
    window_of(values)
    for kind in FAULTS:
        settings = settings_of(kind, values)
        if settings is not None:
            build_with(kind, settings).of(timed, np.random.default_rng(0))
