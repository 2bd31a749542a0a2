# SPDX-License-Identifier: Apache-2.0
"""The options of sensors, of the input and of the state: topics, fields, axes, noise."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, pi

from kalman_ros import sensors
from kalman_ros.core import About, Option, SensorSetup, Signal, Value

#: The farthest from the centre of a body that a sensor is, in m.
_FARTHEST = 1e4
#: The feature of turned and displaced sensors, and of the frames of messages.
_FRAMES = 'frames'
#: That of sensors that are late, or read too much or too little.
_CORRECTED = 'corrections'
#: That of readings of zero, and of those at rest.
_STILL = 'stand-still'
#: The feature of sensors whose readings count less, or whose noise changes.
_DOUBTED = 'spikes'


#: Longest correction of stamps, in seconds.
LONGEST_OFFSET = 10.0
#: The correction of stamps, of a sensor or of the input.
STAMP_OFFSET: tuple[Value, About] = (
    0.0,
    About(
        'added to the stamps: below 0 for stamps that are late', 's',
        -LONGEST_OFFSET, LONGEST_OFFSET, feature=_CORRECTED,
    ),
)  # fmt: skip
#: The options of axes and frames, of a sensor or of the input.
AXES: Mapping[str, tuple[Value, About]] = {
    'mount.translation': (
        [0.0, 0.0, 0.0],
        About('forward, left, up of the body', 'm', -_FARTHEST, _FARTHEST, feature=_FRAMES),
    ),
    'mount.rotation': (
        [0.0, 0.0, 0.0],
        About('roll, pitch, yaw on the body', 'rad', -2.0 * pi, 2.0 * pi, feature=_FRAMES),
    ),
    'mount.tf': (
        False,
        About('place and rotation by the transform of frame on /tf_static', feature=_FRAMES),
    ),
    'convention': (
        'enu',
        About("axes of the messages: 'enu', or 'ned' and forward, right, down", feature=_FRAMES),
    ),
    'frame': (
        '',
        About("frame of the messages, others are dropped; '': the first", feature=_FRAMES),
    ),
}


def sensor_options(name: str, setup: SensorSetup) -> dict[str, Option]:
    """Return the options of a sensor, which depend on its kind, by name.

    Raises
    ------
    ValueError
        If the kind is unknown.
    """
    signal = setup.signal
    common: dict[str, tuple[Value, About]] = {
        'kind': (setup.kind, About('kind of sensor, or package.module:Class of your own')),
        'noise': (list(setup.noise), About('standard deviation of each coordinate', live=True)),
        'rate': (setup.rate, About('readings a second', 'Hz', minimum=1e-6, live=True)),
        'enabled': (setup.enabled, About('whether the sensor is used', live=True)),
        'topic': (signal.topic, About('topic of readings')),
        'type': (signal.type, About('message type of the readings')),
        'fields': (list(signal.fields), About('field of the message for each coordinate')),
        'covariance': (
            signal.covariance,
            About("path of an array in the message; '': by its type"),
        ),
        'covariance_from': (
            'message',
            About(
                "noise from the 'message' if it has one, from the "
                "'configuration', or the 'larger' of both",
                live=True,
            ),
        ),
        'mount.translation': AXES['mount.translation'],
        'mount.rotation': AXES['mount.rotation'],
        'mount.heading': (
            0.0,
            About(
                'heading of the body where the messages have 0, from east',
                'rad',
                -2.0 * pi,
                2.0 * pi,
                feature=_FRAMES,
            ),
        ),
        'mount.gravity': (
            0.0,
            About(
                'what an accelerometer reads upwards at rest',
                'm/s^2',
                -100.0,
                100.0,
                feature=_FRAMES,
            ),
        ),
        'mount.tf': AXES['mount.tf'],
        'convention': AXES['convention'],
        'pose': (
            'absolute',
            About("'relative' to its first, or 'differential': a velocity", feature=_FRAMES),
        ),
        'frame': AXES['frame'],
        'stamp_offset': STAMP_OFFSET,
        'bias_std': (
            [0.0],
            About(
                'standard deviations of an unknown bias, estimated as a state; one for all',
                minimum=0.0,
                feature=_CORRECTED,
            ),
        ),
        'bias_noise': (
            [0.0],
            About(
                'spectral densities, in squared units by s, of its change; one for all',
                minimum=0.0,
                feature=_CORRECTED,
            ),
        ),
        'zero': (
            False,
            About('read zeros in place of the fields: no slip, no speed', feature=_STILL),
        ),
        'still.below': (
            [inf],
            About('read only while still.fields are smaller than this', feature=_STILL),
        ),
        'still.fields': ([''], About("fields of the messages; '': fields", feature=_STILL)),
        'still.duration': (
            0.5,
            About('and have been for this long', 's', 0.0, 3600.0, feature=_STILL),
        ),
        'gate': (
            1.0,
            About(
                'probability that a valid reading passes; 1: no gate',
                minimum=0.5,
                maximum=1.0,
                live=True,
            ),
        ),
        'soft_gate': (
            1.0,
            About(
                'probability that a valid reading counts in full, those beyond less; 1: all do',
                minimum=0.5,
                maximum=1.0,
                live=True,
                feature=_DOUBTED,
            ),
        ),
        'adapt': (
            False,
            About(
                'let the noise follow the innovations, within a factor of 10',
                live=True,
                feature=_DOUBTED,
            ),
        ),
        'reliable': (False, About('subscribe reliably, not best effort')),
    }
    by_name = {
        key: Option(f'{name}.{key}', default, about) for key, (default, about) in common.items()
    }
    try:
        listed = sensors.options(setup.kind)
    except ValueError as error:
        raise ValueError(f'{name}.{error}') from None
    for option in listed:
        default = setup.options.get(option.name, option.default)
        by_name[option.name] = Option(f'{name}.{option.name}', default, option.about)
    return {option.name: option for option in by_name.values()}


def signal_options(section: str, signal: Signal, meaning: str) -> dict[str, Option]:
    """Return the options of the state or the input, by name."""
    options = (
        Option(f'{section}.topic', signal.topic, About(f'topic of {meaning}')),
        Option(f'{section}.type', signal.type, About(f'message type of {meaning}')),
        Option(
            f'{section}.fields',
            list(signal.fields),
            About(f'field of the message for each coordinate of {meaning}'),
        ),
    )
    return {option.name: option for option in options}
