# SPDX-License-Identifier: Apache-2.0
"""One kind of sensor per file. The file's name is the kind, and its ``SENSOR`` builds it.

A builder is called with the state's space and the standard deviations of the noise, and with
its options as keyword arguments.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence

from kalman_ros.core import Option, Sensor, Space, Value, build_with, find, options_of
from kalman_ros.core.registry import builds
from kalman_ros.core.registry import names as _names


def names() -> list[str]:
    """Return the names of the built-in kinds of sensor."""
    return _names(__name__)


#: The signature of a kind.
_EXPECTED = 'expected a Sensor that is built by __init__(self, state, noise, OPTION=DEFAULT, ...)'


def builder(kind: str) -> Callable[..., Sensor]:
    """Return the builder of sensors of ``kind``: a subclass of `Sensor`, or an annotated function.

    Raises
    ------
    ValueError
        If there is no such builder, or it is something else; the builder is not called.
    """
    sensor_builder: Callable[..., Sensor] = find('kind', kind, __name__, 'SENSOR')
    if not builds(sensor_builder, Sensor):
        raise ValueError(
            f"kind: '{kind}' is not a Sensor class or a function annotated '-> Sensor'"
        )
    return sensor_builder


def options(kind: str) -> tuple[Option, ...]:
    """Return the options of a kind of sensor: the keyword arguments of its builder.

    Raises
    ------
    ValueError
        If there is no such kind, or it cannot be built with a state and noise.
    """
    sensor_builder = builder(kind)
    try:
        inspect.signature(sensor_builder).bind(None, None)
        return options_of(sensor_builder)
    except TypeError as error:
        raise ValueError(f"kind: '{kind}': {_EXPECTED}; {error}") from None
    except ValueError as error:
        raise ValueError(f"kind: '{kind}': {error}") from None


def build(kind: str, state: Space, noise: Sequence[float], options: Mapping[str, Value]) -> Sensor:
    """Return a sensor of ``kind`` (a file here, or ``package.module:Class``) on ``state``.

    Raises
    ------
    ValueError
        If the kind is unknown, has another signature, or refuses its noise or its options.
    """
    try:
        sensor = build_with(builder(kind), options, state, noise)
    except ValueError:
        raise
    except Exception as error:  # a user's class may raise anything
        reason = f'{type(error).__name__}: {error}'.partition('\n')[0]
        raise ValueError(f"kind: '{kind}': {_EXPECTED}; {reason}") from error
    if not isinstance(sensor, Sensor):
        raise ValueError(f"kind: '{kind}': {_EXPECTED}; it is a {type(sensor).__name__}")
    sensor.state = state
    return sensor
