# SPDX-License-Identifier: Apache-2.0
"""Places on the ellipsoid against published coordinates and pyproj."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalman_ros.core.geodesy import (
    Origin,
    Place,
    TangentPlane,
    axes,
    datum,
    earth_centred,
    geodetic,
    place,
)

#: Datum, place, and its metres east, north and up of the datum: pyproj 3.7.2 (PROJ 9.5.1),
#: `+proj=cart +ellps=WGS84` and `+proj=topocentric`; 10 m, 5 km and 100 km away.
PYPROJ = (
    ((49.9, 8.65, 144.0), (49.89994138, 8.649894466, 5.872), (-7.582038, -6.520135, -138.128008)),
    (
        (49.9, 8.65, 144.0),
        (49.94347006, 8.667735483, -146.083),
        (1273.020052, 4835.107912, -292.044043),
    ),
    (
        (49.9, 8.65, 144.0),
        (50.240897167, 7.357460424, 391.653),
        (-92203.55646, 38715.804068, -535.082508),
    ),
    (
        (-33.9, 151.2, 20.0),
        (-33.900070664, 151.19993286, 157.698),
        (-6.210122, -7.838289, 137.697992),
    ),
    (
        (-33.9, 151.2, 20.0),
        (-33.943393455, 151.185359869, 281.043),
        (-1353.481429, -4813.553063, 259.076716),
    ),
    (
        (-33.9, 151.2, 20.0),
        (-33.533561859, 150.214261966, -278.357),
        (-91553.41381, 40202.997099, -1082.021284),
    ),
    (
        (69.65, 18.96, 5.0),
        (69.650056004, 18.959798897, -274.849),
        (-7.807711, 6.247414, -279.849008),
    ),
    (
        (69.65, 18.96, 5.0),
        (69.644239877, 18.832306195, -189.607),
        (-4959.057737, -637.384872, -196.561013),
    ),
    (
        (69.65, 18.96, 5.0),
        (70.223886656, 16.95412191, 29.877),
        (-75760.131558, 65266.230402, -756.982771),
    ),
    (
        (0.0, -78.45, 2850.0),
        (-2.7791e-05, -78.449914515, 2803.612),
        (9.52033, -3.07433, -46.388008),
    ),
    (
        (0.0, -78.45, 2850.0),
        (0.04450451, -78.442049897, 2624.57),
        (885.365323, 4923.092114, -227.403431),
    ),
    (
        (0.0, -78.45, 2850.0),
        (-0.432556885, -79.238906389, 2938.314),
        (-87855.852013, -47851.401803, -697.168738),
    ),
    ((89.9, 10.0, 3.0), (89.899932968, 9.966006374, -66.793), (-6.631181, -7.485025, -69.793008)),
    (
        (89.9, 10.0, 3.0),
        (89.944752719, 9.186161152, 291.501),
        (-87.651947, 4999.458885, 286.547662),
    ),
    (
        (89.9, 10.0, 3.0),
        (89.060786163, -51.179704166, 93.276),
        (-91907.773722, -39400.999037, -691.019487),
    ),
    (
        (-45.0, 179.99, 0.0),
        (-45.00003394, 179.989882539, -66.647),
        (-9.261326, -3.77178, -66.647008),
    ),
    (
        (-45.0, 179.99, 0.0),
        (-44.970256982, -179.962431576, 132.893),
        (3752.637258, 3304.353142, 130.933539),
    ),
    (
        (-45.0, 179.99, 0.0),
        (-45.888188317, 179.785634566, -113.855),
        (-15862.36157, -98727.939627, -898.969695),
    ),
    (
        (27.98, 86.92, 8848.0),
        (27.97991012, 86.920009035, 9081.693),
        (0.890129, -9.97467, 233.692992),
    ),
    (
        (27.98, 86.92, 8848.0),
        (28.021297689, 86.899527872, 8762.677),
        (-2016.044583, 4583.072193, -87.292708),
    ),
    (
        (27.98, 86.92, 8848.0),
        (27.166495674, 86.481647926, 8741.122),
        (-43503.400071, -90189.541825, -894.665037),
    ),
)


@pytest.mark.parametrize(('origin', 'where', 'local'), PYPROJ)
def test_it_is_exact_to_a_millimetre_within_100_km(origin, where, local):
    plane = TangentPlane(Place(*origin))
    np.testing.assert_allclose(plane.local(Place(*where)), local, rtol=0, atol=1e-5)
    back = plane.place(np.array(local))
    np.testing.assert_allclose(earth_centred(back), earth_centred(Place(*where)), atol=1e-5)


def test_the_published_example_of_the_topocentric_conversion():
    """IOGP, Geomatics Guidance Note 7-2, EPSG methods 9602 and 9837."""
    where = Place(53 + 48 / 60 + 33.820 / 3600, 2 + 7 / 60 + 46.380 / 3600, 73.0)
    known = [3771793.968, 140253.342, 5124304.349]
    np.testing.assert_allclose(earth_centred(where), known, atol=1e-3)
    plane = TangentPlane(Place(55.0, 5.0, 200.0))
    np.testing.assert_allclose(
        plane.local(where), [-189013.869, -128642.040, -4220.171], atol=1e-3
    )


angles, heights = st.floats(-90.0, 90.0), st.floats(-10_000.0, 1_000_000.0)


@given(latitude=angles, longitude=st.floats(-180.0, 180.0), altitude=heights)
def test_a_place_comes_back(latitude, longitude, altitude):
    point = earth_centred(Place(latitude, longitude, altitude))
    found = geodetic(point)
    assert found.latitude == pytest.approx(latitude, abs=1e-9)
    assert found.altitude == pytest.approx(altitude, abs=1e-6)
    np.testing.assert_allclose(earth_centred(found), point, atol=1e-6)


@given(latitude=angles, longitude=st.floats(-180.0, 180.0))
def test_the_axes_are_orthonormal_and_up_is_up(latitude, longitude):
    where = Place(latitude, longitude, 0.0)
    R = axes(where)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    higher = earth_centred(where._replace(altitude=1.0)) - earth_centred(where)
    np.testing.assert_allclose(R @ higher, [0.0, 0.0, 1.0], atol=1e-8)


def test_the_turn_between_two_places_is_theirs():
    plane, where = TangentPlane(Place(49.9, 8.65, 144.0)), Place(50.5, 9.5, 10.0)
    step = np.array([1.0, -2.0, 0.5])
    moved = TangentPlane(where).place(step)
    change = plane.local(moved) - plane.local(where)
    np.testing.assert_allclose(plane.turn(where) @ step, change, atol=1e-7)


@pytest.mark.parametrize(
    ('values', 'why'),
    [
        ([1.0, 2.0], 'expected latitude, longitude and altitude, got 2 numbers'),
        ([91.0, 0.0, 0.0], 'latitude of -90 to 90 degrees, got 91'),
        ([0.0, 400.0, 0.0], 'longitude of -360 to 360 degrees, got 400'),
        ([0.0, 0.0, np.inf], 'altitude in m, got inf'),
        ([np.nan, 0.0, 0.0], 'latitude of -90 to 90 degrees, got nan'),
    ],
)
def test_what_is_no_place_is_refused(values, why):
    with pytest.raises(ValueError, match=f'datum: .*{why}'):
        place('datum', values)


def test_no_datum_is_the_first_place():
    assert datum([np.inf]) is None
    assert datum([1.0, 2.0, 3.0]) == Place(1.0, 2.0, 3.0)
    origin = Origin()
    first = Place(49.9, 8.65, 144.0)
    np.testing.assert_allclose(origin.at(first).local(first), np.zeros(3), atol=1e-8)
    assert origin.at(Place(0.0, 0.0, 0.0)).datum == first


def test_a_first_place_without_a_height_is_on_the_ellipsoid():
    assert Origin().at(Place(49.9, 8.65, np.nan)).datum == Place(49.9, 8.65, 0.0)
