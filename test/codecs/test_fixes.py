# SPDX-License-Identifier: Apache-2.0
"""Satellite fixes as metres of a datum, through the bytes on the wire."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix

from kalman_ros.codecs.fixes import NoFixError, is_local, place_of
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader, WireWriter
from kalman_ros.core import Signal
from kalman_ros.core.geodesy import Origin, Place, TangentPlane

DATUM = Place(49.8728, 8.6512, 144.0)
TYPE = 'sensor_msgs/NavSatFix'
LOCAL = Signal('fix', TYPE, ('east', 'north', 'up'), datum=DATUM)
PLANAR = Signal('fix', TYPE, ('north', 'east'), datum=DATUM)
metres = st.floats(-1e5, 1e5)


def fix(where=DATUM, status=0, kind=0, covariance=None):
    message = NavSatFix()
    message.latitude, message.longitude, message.altitude = where
    message.status.status = status
    message.position_covariance_type = kind
    if covariance is not None:
        message.position_covariance = np.asarray(covariance, dtype=float).ravel()
    return message


def read(message, signal=LOCAL, origin=None):
    return WireReader(codec_of(signal, origin=origin))(bytes(serialize_message(message)))


@given(local=st.tuples(metres, metres, st.floats(-1000.0, 9000.0)))
def test_metres_come_back(local):
    P = np.diag([1.0, 4.0, 9.0]) + 0.5
    data = bytes(serialize_message(WireWriter(codec_of(LOCAL))(5, np.array(local), P)))
    time, values, covariance = WireReader(codec_of(LOCAL))(data)
    assert time == 5
    np.testing.assert_allclose(values, local, atol=1e-6)
    np.testing.assert_allclose(covariance, P, atol=1e-12)


def test_fields_are_in_any_order_and_a_direction_may_be_missing():
    data = bytes(serialize_message(WireWriter(codec_of(PLANAR))(5, np.array([3.0, -4.0]))))
    np.testing.assert_allclose(WireReader(codec_of(LOCAL))(data).values, [-4, 3, 0], atol=1e-6)
    np.testing.assert_allclose(WireReader(codec_of(PLANAR))(data).values, [3, -4], atol=1e-6)


@pytest.mark.parametrize('status', [-1, -2])
def test_a_status_without_a_fix_is_no_reading(status):
    with pytest.raises(NoFixError, match=f'status: expected at least 0, got {status}'):
        read(fix(status=status))


@pytest.mark.parametrize(
    ('where', 'why'),
    [
        ((0.0, 0.0, 0.0), 'both exactly 0'),
        ((91.0, 8.0, 0.0), 'latitude of -90 to 90 degrees, got 91'),
        ((np.nan, 8.0, 0.0), 'latitude of -90 to 90 degrees, got nan'),
        ((49.0, np.inf, 0.0), 'longitude'),
        ((49.0, 8.0, 1e300), 'altitude'),
        ((49.0, 8.0, -np.inf), 'altitude'),
    ],
)
def test_what_is_no_place_is_no_reading_and_no_datum(where, why):
    origin = Origin()
    with pytest.raises(NoFixError, match=why):
        read(fix(where), Signal('fix', TYPE, ('east',)), origin)
    assert origin.plane is None


FULL = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.2], [0.5, 0.2, 16.0]])


@pytest.mark.parametrize(
    ('kind', 'used'), [(0, None), (1, FULL), (2, np.diag(np.diag(FULL))), (3, FULL), (200, None)]
)
def test_the_covariance_is_used_according_to_its_type(kind, used):
    found = read(fix(kind=kind, covariance=FULL)).covariance
    if used is None:
        assert found is None
    else:
        np.testing.assert_allclose(found, used, atol=1e-9)


def test_the_covariance_is_turned_to_the_directions_at_the_datum():
    far = TangentPlane(DATUM).place(np.array([100_000.0, 0.0, 0.0]))
    found = read(fix(far, kind=3, covariance=np.diag([1.0, 1.0, 10_000.0]))).covariance
    # there, up leans east by 100 km / 6387 km, the radius of curvature
    lean = 100.0 / 6387.3
    assert found[0, 0] == pytest.approx(1.0 + 9999.0 * np.sin(lean) ** 2, rel=1e-3)
    assert found[0, 2] == pytest.approx(9999.0 * np.sin(lean) * np.cos(lean), rel=1e-3)


@pytest.mark.parametrize('hostile', [np.nan, np.inf, 1e300])
def test_a_covariance_that_is_not_finite_is_passed_on_to_be_refused(hostile):
    found = read(fix(kind=3, covariance=np.full((3, 3), hostile)), PLANAR).covariance
    assert not np.isfinite(found).all() or np.abs(found).max() > 1e299


def test_a_fix_without_a_height_is_one_at_the_height_of_the_datum():
    east = TangentPlane(DATUM).place(np.array([100.0, 0.0, 0.0]))
    values = read(fix(east._replace(altitude=np.nan))).values
    np.testing.assert_allclose(values[:2], [100.0, 0.0], atol=1e-5)
    assert np.isnan(values[2])


def test_receivers_share_the_datum_that_the_first_good_fix_sets():
    origin, signal = Origin(), Signal('fix', TYPE, ('east', 'north'))
    readers = [WireReader(codec_of(signal, origin=origin)) for _ in range(2)]
    with pytest.raises(NoFixError):
        readers[1](bytes(serialize_message(fix(Place(10.0, 10.0, 0.0), status=-1))))
    first, second = readers[0], readers[1]
    np.testing.assert_allclose(first(bytes(serialize_message(fix()))).values, 0, atol=1e-8)
    there = TangentPlane(DATUM).place(np.array([3.0, 4.0, 0.0]))
    found = second(bytes(serialize_message(fix(there)))).values
    np.testing.assert_allclose(found, [3, 4], atol=1e-6)
    assert origin.plane.datum == DATUM


def test_a_fix_cannot_be_written_without_a_datum():
    with pytest.raises(ValueError, match='datum: expected latitude, longitude and altitude'):
        WireWriter(codec_of(Signal('fix', TYPE, ('east', 'north'))))


@pytest.mark.parametrize('fields', [('east', 'latitude'), ('east', 'east'), ('up', 'status')])
def test_computed_fields_do_not_mix_with_others(fields):
    with pytest.raises(ValueError, match="signal 'fix': fields: expected east, north, up"):
        is_local(Signal('fix', TYPE, fields))


def test_degrees_are_still_numbers_of_the_message():
    signal = Signal('fix', 'sensor_msgs/msg/NavSatFix', ('latitude', 'longitude'))
    np.testing.assert_array_equal(read(fix(), signal).values, DATUM[:2])


@pytest.mark.parametrize(
    'where', [(0.0, 8.0), (49.0, 0.0), (0.0, -5e-324), (5e-324, 0.0), (8.0, 8.0)]
)
def test_a_place_on_the_equator_or_the_prime_meridian_is_a_fix(where):
    """Receivers without a fix report both as exactly 0."""
    assert place_of(fix((*where, 3.0))) == (*where, 3.0)
    for zeros in ((0.0, 0.0), (-0.0, 0.0)):
        with pytest.raises(NoFixError, match='both exactly 0'):
            place_of(fix((*zeros, 3.0)))
