# SPDX-License-Identifier: Apache-2.0
"""Places on the Earth, and local metres east, north and up of a datum.

The tangent plane is a rotation and a translation of the Earth-centred coordinates, so it has no
zones, no scale factor and no limit of distance: the rounding error is some nanometres.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, isfinite, isinf, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from kalman_ros.linear.matrices import Array

#: Semi-major axis in m, and flattening: NIMA, Department of Defense World Geodetic System 1984,
#: TR8350.2, third edition (2000), table 3.1.
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1.0 / 298.257223563
_SEMI_MINOR_AXIS = SEMI_MAJOR_AXIS * (1.0 - FLATTENING)
_ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
_SECOND_ECCENTRICITY_2 = _ECCENTRICITY_2 / (1.0 - _ECCENTRICITY_2)
#: Passes of Bowring's formula; the second is exact to rounding from 5000 km below the surface up.
_PASSES = 3
#: Largest height of a place in m; no robot is beyond it.
_HIGHEST = 1e7


class Place(NamedTuple):
    """Latitude and longitude in degrees, and height above the WGS-84 ellipsoid in m."""

    latitude: float
    longitude: float
    altitude: float

    def __str__(self) -> str:
        return f'{self.latitude:.8f}, {self.longitude:.8f}, {self.altitude:.3f} m'


def place(argument: str, values: Sequence[float]) -> Place:
    """Return the place of latitude, longitude and altitude.

    Raises
    ------
    ValueError
        If the values are not such numbers; the message names the ``argument``.
    """
    if len(values) != 3:
        expected = 'expected latitude, longitude and altitude'
        raise ValueError(f'{argument}: {expected}, got {len(values)} numbers')
    latitude, longitude, altitude = map(float, values)
    if not -90.0 <= latitude <= 90.0:
        raise ValueError(f'{argument}: expected a latitude of -90 to 90 degrees, got {latitude:g}')
    if not -360.0 <= longitude <= 360.0:
        expected = 'expected a longitude of -360 to 360 degrees'
        raise ValueError(f'{argument}: {expected}, got {longitude:g}')
    if not abs(altitude) <= _HIGHEST:
        raise ValueError(f'{argument}: expected an altitude in m, got {altitude:g}')
    return Place(latitude, longitude, altitude)


def datum(values: Sequence[float]) -> Place | None:
    """Return the datum of a parameter; None if its one value is infinite.

    Raises
    ------
    ValueError
        If the value is neither infinite nor a place.
    """
    return None if len(values) == 1 and isinf(values[0]) else place('datum', values)


def earth_centred(where: Place) -> Array:
    """Return the Earth-centred, Earth-fixed coordinates (3,) of a place, in m.

    IOGP, Geomatics Guidance Note 7-2, EPSG method 9602.
    """
    phi, lam = radians(where.latitude), radians(where.longitude)
    height = where.altitude
    nu = SEMI_MAJOR_AXIS / sqrt(1.0 - _ECCENTRICITY_2 * sin(phi) ** 2)
    ring = (nu + height) * cos(phi)
    return np.array(
        [ring * cos(lam), ring * sin(lam), ((1.0 - _ECCENTRICITY_2) * nu + height) * sin(phi)]
    )


def geodetic(point: Array) -> Place:
    """Return the place at Earth-centred, Earth-fixed coordinates (3,), in m.

    B. R. Bowring, Transformation from spatial to geographical coordinates, Survey Review 23
    (1976), repeated; the height as in The accuracy of geodetic latitude and height equations,
    Survey Review 28 (1985), which is exact at the poles, too.
    """
    X, Y, Z = point.tolist()
    p = hypot(X, Y)
    beta = atan2(SEMI_MAJOR_AXIS * Z, _SEMI_MINOR_AXIS * p)
    for _ in range(_PASSES):
        phi = atan2(
            Z + _SECOND_ECCENTRICITY_2 * _SEMI_MINOR_AXIS * sin(beta) ** 3,
            p - _ECCENTRICITY_2 * SEMI_MAJOR_AXIS * cos(beta) ** 3,
        )
        beta = atan2(_SEMI_MINOR_AXIS * sin(phi), SEMI_MAJOR_AXIS * cos(phi))
    root = sqrt(1.0 - _ECCENTRICITY_2 * sin(phi) ** 2)
    height = p * cos(phi) + Z * sin(phi) - SEMI_MAJOR_AXIS * root
    return Place(degrees(phi), degrees(atan2(Y, X)), height)


def axes(where: Place) -> Array:
    """Return the directions (3, 3) east, north and up at a place, as rows.

    IOGP, Geomatics Guidance Note 7-2, EPSG method 9836.
    """
    phi, lam = radians(where.latitude), radians(where.longitude)
    return np.array(
        [
            [-sin(lam), cos(lam), 0.0],
            [-sin(phi) * cos(lam), -sin(phi) * sin(lam), cos(phi)],
            [cos(phi) * cos(lam), cos(phi) * sin(lam), sin(phi)],
        ]
    )


class TangentPlane:
    """Metres east, north and up of a datum."""

    def __init__(self, datum: Place) -> None:
        self.datum = datum
        self._origin, self._axes = earth_centred(datum), axes(datum)

    def local(self, where: Place) -> Array:
        """Return the place in metres (3,) east, north and up of the datum."""
        return np.asarray(self._axes @ (earth_centred(where) - self._origin))

    def place(self, local: Array) -> Place:
        """Return the place at metres (3,) east, north and up of the datum."""
        return geodetic(self._origin + self._axes.T @ local)

    def turn(self, where: Place) -> Array:
        """Return the rotation (3, 3) from east, north and up at a place to those at the datum."""
        return np.asarray(self._axes @ axes(where).T)


class Origin:
    """The datum that several receivers share, which the first good fix may set.

    Parameters
    ----------
    datum
        Datum; None if it is not known yet.
    """

    def __init__(self, datum: Place | None = None) -> None:
        self.plane = None if datum is None else TangentPlane(datum)
        #: Whether the last fix has become the datum.
        self.is_new = False

    def at(self, first: Place) -> TangentPlane:
        """Return the plane; without a datum, ``first`` becomes the datum."""
        if self.plane is None:
            known = first if isfinite(first.altitude) else first._replace(altitude=0.0)
            self.plane, self.is_new = TangentPlane(known), True
        return self.plane

    def settle(self, *, good: bool) -> None:
        """Keep the datum of the last fix if that is ``good``, otherwise forget it."""
        self.is_new = False
        if not good:
            self.plane = None
