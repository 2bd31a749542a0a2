# SPDX-License-Identifier: Apache-2.0
"""A sensor off the centre of its body: an antenna on the roof, an IMU in the bumper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from kalman_ros.core import Array, Gaussian, Hypotheses, Sensor, numerical_jacobian, vector
from kalman_ros.core import rotations as so3
from kalman_ros.core.quantity import (
    ACCELERATION,
    ANGLES,
    ATTITUDE,
    PLACE,
    RATE,
    VELOCITY,
    quantity,
)

from .body_roles import Body


class LeverArm(Sensor):
    """What another sensor reads at a place of the body that is not its centre.

    With R the attitude, w the angular rate and l the lever arm, both in the axes of the body, the
    position there is p + R l, the velocity v + w x l and the acceleration a + w x (w x l) (J. J.
    Craig, Introduction to Robotics, sections 2.4, 5.6 and 6.2; without the angular acceleration,
    which no state has). An accelerometer that reads g upwards at rest adds R' (0, 0, g); without
    roll and pitch in the state the body is taken to be level.

    Parameters
    ----------
    sensor
        At the centre.
    body
        The roles of the states.
    fields
        What each coordinate reads, as a field of a message.
    arm
        The place, (3,) in m: forward, left, up.
    gravity
        What an accelerometer reads upwards at rest, in m/s^2.

    Raises
    ------
    ValueError
        If the state lacks the attitude or the rate that this takes.
    """

    def __init__(
        self,
        sensor: Sensor,
        body: Body,
        fields: Sequence[str],
        arm: Sequence[float],
        gravity: float = 0.0,
    ) -> None:
        self._at_centre, self._body = sensor, body
        self.arm = vector('mount.translation', arm, 3)
        # whether there is gravity is no number that a compiled sensor may change
        self._up, self._weighs = np.array([0.0, 0.0, gravity]), bool(gravity)
        self.output, self.covariance = sensor.output, sensor.covariance
        self._effects = [_effect(field) for field in fields]
        kinds = {kind for kind, _ in self._effects}
        if gravity and ACCELERATION not in kinds:
            listed = ', '.join(fields)
            raise ValueError(f'mount.gravity: expected an acceleration among the fields {listed}')
        turns, rate = (body.turns, 'heading (yaw)'), ('wz' in body.index, 'yaw rate')
        for kind, (known, what) in ((PLACE, turns), (VELOCITY, rate), (ACCELERATION, rate)):
            if any(arm) and kind in kinds and not known:
                raise ValueError(
                    f'mount.translation: a {kind} off the centre takes a state with a {what}'
                )

    def at(self, arm: Sequence[float]) -> LeverArm:
        """Return the same sensor at another place (3,)."""
        other = copy(self)
        other.arm = vector('mount.translation', arm, 3)
        return other

    def measure(self, x: Array) -> Array:
        """Return the reading at the place."""
        return np.asarray(self._at_centre.measure(x) + self._displacement(x))

    def jacobian(self, x: Array) -> Array:
        """Return that at the centre, and that of the displacement, by differences."""
        return self._at_centre.jacobian(x) + numerical_jacobian(
            self._displacement, x, space=self.state
        )

    def hypotheses(self, belief: Gaussian, y: Array, count: int) -> Hypotheses | None:
        """Return None: one linearisation is used."""
        return None

    def _displacement(self, x: Array) -> Array:
        """Return what the lever arm adds to each coordinate (..., k)."""
        displacements: dict[str, Array] = {}
        makers: dict[str, Callable[[Array], Array]] = {
            PLACE: self._moved, VELOCITY: self._swung, ACCELERATION: self._drawn,
        }  # fmt: skip
        columns = []
        for kind, axis in self._effects:
            if kind not in makers:
                columns.append(np.zeros(x.shape[:-1]))
                continue
            if kind not in displacements:
                displacements[kind] = makers[kind](x)
            columns.append(displacements[kind][..., axis])
        return np.stack(columns, axis=-1)

    def _moved(self, x: Array) -> Array:
        """Return R l; roll, pitch and yaw are about the fixed axes x, y, z (REP-103)."""
        if self._body.has_rotation:
            return so3.rotate(self._body.attitude(x), self.arm)
        roll, pitch, yaw = (self._body.value(x, angle) for angle in ANGLES)
        a, b, c = self.arm
        b, c = np.cos(roll) * b - np.sin(roll) * c, np.sin(roll) * b + np.cos(roll) * c
        a, c = np.cos(pitch) * a + np.sin(pitch) * c, np.cos(pitch) * c - np.sin(pitch) * a
        a, b = np.cos(yaw) * a - np.sin(yaw) * b, np.sin(yaw) * a + np.cos(yaw) * b
        return np.stack((a, b, c), axis=-1)

    def _rate(self, x: Array) -> Array:
        return np.stack([self._body.value(x, f'w{axis}') for axis in 'xyz'], axis=-1)

    def _swung(self, x: Array) -> Array:
        """Return w x l."""
        return np.cross(self._rate(x), self.arm)

    def _drawn(self, x: Array) -> Array:
        """Return w x (w x l) + R' (0, 0, g)."""
        rate = self._rate(x)
        drawn = np.cross(rate, np.cross(rate, self.arm))
        if not self._weighs:
            return np.asarray(drawn)
        return np.asarray(drawn + so3.rotate_back(self._body.attitude(x), self._up))


#: What reads the same at every place of a body, or is moved.
_KNOWN = (PLACE, ATTITUDE, VELOCITY, ACCELERATION, RATE)


def _effect(field: str) -> tuple[str, int]:
    component = quantity(field)
    if component is None or component.kind not in _KNOWN:
        raise ValueError(f"mount.translation: nothing is known of a lever arm of '{field}'")
    return component.kind, component.axis
