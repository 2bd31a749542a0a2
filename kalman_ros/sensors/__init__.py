# SPDX-License-Identifier: Apache-2.0
"""One kind of sensor a file. The file's name is the kind, and its ``SENSOR`` builds it.

A builder takes the state's space and the standard deviations of the noise, and what else it
needs as keyword arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from kalman_ros.core import Sensor, Space, Value, build_with, find
from kalman_ros.core.registry import builds
from kalman_ros.core.registry import names as _names


def names() -> list[str]:
    """Return the names of the built-in kinds of sensor."""
    return _names(__name__)


def builder(kind: str) -> Callable[..., Sensor]:
    """Return what builds sensors of ``kind``: a subclass of `Sensor`, or an annotated function.

    Raises
    ------
    ValueError
        If there is none, or it is something else; it is not called to find out.
    """
    found: Callable[..., Sensor] = find('kind', kind, __name__, 'SENSOR')
    if not builds(found, Sensor):
        raise ValueError(
            f"kind: '{kind}' is not a Sensor class or a function annotated '-> Sensor'"
        )
    return found


def build(kind: str, state: Space, noise: Sequence[float], options: Mapping[str, Value]) -> Sensor:
    """Return a sensor of ``kind`` (a file here, or ``package.module:Class``) on ``state``.

    Raises
    ------
    ValueError
        If the kind is unknown, or refuses its noise or its options.
    """
    try:
        sensor = build_with(builder(kind), options, state, noise)
    except TypeError as error:  # a method that is missing, for one
        raise ValueError(f"kind: '{kind}': {error}") from None
    if not isinstance(sensor, Sensor):
        raise ValueError(f"kind: '{kind}' is not a Sensor but a {type(sensor).__name__}")
    return sensor
