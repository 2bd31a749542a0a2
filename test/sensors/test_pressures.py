# SPDX-License-Identifier: Apache-2.0
"""Pressures in air and in water are those of the standards."""

import numpy as np
import pytest

from kalman_ros.core import Space
from kalman_ros.sensors.barometer import Barometer
from kalman_ros.sensors.pressure import Pressure

SPACE = Space(('x', 'z'), ('m', 'm'))
#: Geopotential height in m and pressure in Pa: ISO 2533:1975, Standard Atmosphere, table 1.
ATMOSPHERE = [(-1000.0, 113929.0), (0.0, 101325.0), (1000.0, 89874.6), (5000.0, 54019.9),
              (10000.0, 26436.3), (11000.0, 22632.0)]  # fmt: skip


def read(sensor, height):
    (pressure,) = sensor.measure(np.array([7.0, height]))
    return pressure


@pytest.mark.parametrize(('height', 'pressure'), ATMOSPHERE)
def test_a_barometer_reads_the_standard_atmosphere(height, pressure):
    assert read(Barometer(SPACE, [12.0]), height) == pytest.approx(pressure, rel=1e-5)
    above = Barometer(SPACE, [12.0], altitude=height)  # an origin at that height
    assert read(above, 0.0) == pytest.approx(pressure, rel=1e-5)


def test_a_barometer_scales_with_the_weather_and_stays_finite():
    low = Barometer(SPACE, [12.0], sea_level_pressure=98000.0)
    ratio = 98000.0 / 101325.0
    assert read(low, 0.0) == 98000.0
    assert read(low, 800.0) == pytest.approx(ratio * read(Barometer(SPACE, [12.0]), 800.0))
    assert np.isfinite(read(low, 1e9)) and read(low, 1e9) == read(low, 1e5) > 0.0
    slope = low.jacobian(np.array([0.0, 100.0]))
    step = (read(low, 101.0) - read(low, 99.0)) / 2.0
    np.testing.assert_allclose(slope, [[0.0, step]], rtol=1e-6)


def test_water_weighs_on_a_pressure_sensor():
    """A column of 10 m of sea water weighs 1025 * 9.80665 * 10 = 100518 Pa."""
    assert read(Pressure(SPACE, [100.0]), -10.0) == pytest.approx(101325.0 + 100518.0, abs=0.5)
    lake = Pressure(SPACE, [100.0], surface_pressure=80000.0, density=1000.0, gravity=9.81)
    assert read(lake, 0.0) == 80000.0
    assert read(lake, -3.0) == pytest.approx(80000.0 + 3.0 * 9810.0)
    np.testing.assert_allclose(lake.jacobian(np.zeros(2)), [[0.0, -9810.0]])
