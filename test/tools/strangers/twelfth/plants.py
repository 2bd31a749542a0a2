# SPDX-License-Identifier: Apache-2.0
"""Plants: an antenna's motor, four tanks, a solar heater, a dialysis, and a tower that sways.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Readings, Vector, column, commanded, integrate, sampled, square


def rotator(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a motor that turns an antenna.

    ``inertia`` is that of motor and antenna, ``constant`` the torque by current, ``least`` the
    voltage below which the bridge does nothing, ``gusts`` the density of the wind by that of the
    file, and ``halt`` when the voltage rests for 15 s.
    """
    inertia, constant, least = physics['inertia'], physics['constant'], physics['least']
    halt = physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, omega, i = x
        volts = math.copysign(max(abs(u[0]) - least, 0.0), u[0])
        return (
            omega, (constant * i - 0.06 * omega) / inertia,
            (volts - constant * omega - 1.5 * i) / 0.12,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 15.0:
            return (0.0,)
        return (3.0 * square(t, 4.3) + 2.0 * math.sin(2.1 * t) + 1.5 * math.sin(0.6 * t),)

    start = rng.normal(0.0, [0.05, 0.2, 0.2])
    density = [0, 2e-4 * physics['gusts'] / inertia**2, 2e-4 / 0.12**2]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, drive)
    return {
        'resolver': sampled(truth, 'resolver', 'angle', 50.0, column(0), [0.01], rng),
        'tacho': sampled(truth, 'tacho', 'turning', 50.0, column(1), [0.15], rng),
        'shunt': sampled(truth, 'shunt', 'gauge', 50.0, column(2), [0.08], rng),
        'input': commanded(truth, 'bridge', 'number'),
    }


def quadtank(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return 20 minutes of four tanks, after Johansson; two pumps feed each a lower and an upper.

    ``outlet`` is the hole of the first in cm^2, ``split`` the share of the second pump that goes
    to the second tank, ``worn`` the flow of the first pump by what is recorded, and ``halt`` when
    the pumps are constant for 240 s.
    """
    outlet, split, worn, halt = (physics[k] for k in ('outlet', 'split', 'worn', 'halt'))

    def rates(x: Vector, u: Vector) -> Vector:
        one, two, three, four = (
            hole * math.sqrt(2.0 * 981.0 * max(level, 0.0))
            for hole, level in zip((outlet, 0.09, 0.07, 0.07), x)
        )
        first, second = worn * u[0], u[1]
        return (
            (three + 0.65 * first - one) / 28.0, (four + split * second - two) / 32.0,
            ((1.0 - split) * second - three) / 28.0, (0.35 * first - four) / 32.0,
        )  # fmt: skip

    def pump(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 240.0:
            t = halt
        return (
            10.5 + 2.5 * square(t, 310.0) + 1.2 * math.sin(0.05 * t),
            10.5 + 2.5 * square(t + 60.0, 230.0) + 1.2 * math.sin(0.037 * t),
        )

    start = rng.normal([7.0, 7.0, 1.8, 1.4], 0.2)
    density = [0.0008, 0.0008, 0.0004, 0.0004]
    truth = integrate(rates, start, density, physics['seconds'], 0.1, rng, pump, 2.0)
    return {
        'first': sampled(truth, 'first', 'range', 1.0, column(0), [0.1], rng),
        'second': sampled(truth, 'second', 'float', 1.0, column(1), [0.1], rng),
        'uppers': sampled(truth, 'uppers', 'two_levels', 1.0, lambda x: [*x[2:]], [0.05] * 2, rng),
        'input': commanded(truth, 'pumps', 'two_pumps'),
    }


def solar(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return four hours of a solar heater: a collector on a roof and a store with two layers.

    ``glass`` is the share of the sun that heats the collector, ``loss`` that of the store in W/K,
    and ``flow`` what the pump moves by what is recorded.
    """
    glass, loss, flow = physics['glass'], physics['loss'], physics['flow']

    def rates(x: Vector, u: Vector) -> Vector:
        collector, top, bottom = x
        sun, pump, outside = u[0], flow * u[1], u[2]
        moved = 180.0 * pump
        return (
            (4.0 * glass * sun - 18.0 * (collector - outside) - moved * (collector - bottom))
            / 2e4,
            (moved * (collector - top) - 15.0 * (top - bottom) - loss * (top - 18.0)) / 1.5e5,
            (moved * (top - bottom) + 15.0 * (top - bottom) - loss * (bottom - 18.0)) / 1.5e5,
        )

    def weather(t: float, x: Vector) -> Vector:
        cloud = 0.3 * square(t, 1900.0) + 0.15 * square(t + 300.0, 1100.0)
        sun = 520.0 * (1.0 + cloud) + 60.0 * math.sin(t / 170.0)
        return sun, 0.5 + 0.4 * square(t + 200.0, 2600.0), 9.0 + 3.0 * math.sin(t / 4000.0)

    start = rng.normal([40.0, 42.0, 34.0], [1.0, 0.5, 0.5])
    density = [0.0004, 2e-5, 2e-5]
    truth = integrate(rates, start, density, physics['seconds'], 1.0, rng, weather, 10.0)
    return {
        'collector': sampled(
            truth, 'collector', 'temperature', 1 / 10, column(0), [0.4], rng
        ),
        'top': sampled(truth, 'top', 'temperature', 1 / 10, column(1), [0.2], rng),
        'bottom': sampled(truth, 'bottom', 'temperature', 1 / 10, column(2), [0.2], rng),
        'input': commanded(truth, 'weather', 'sun_and_pump'),
    }  # fmt: skip


def dialysis(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return four hours of a dialysis, of which urea leaves the blood, and the body through it.

    ``membranes`` is what goes between the cells and the blood in l/s, ``growth`` what the body
    makes in mmol/s, ``clears`` the clearance by what is recorded, and ``refills`` the return of
    water in 1/s.
    """
    membranes, growth = physics['membranes'], physics['growth']
    clears, refills = physics['clears'], physics['refills']

    def rates(x: Vector, u: Vector) -> Vector:
        blood, cells, volume = x
        through = membranes * (cells - blood)
        back = refills * (15.0 - volume)
        return (
            (through - clears * u[0] * blood + (u[1] - back) * blood) / volume,
            (growth - through) / 25.0, back - u[1],
        )  # fmt: skip

    def machine(t: float, x: Vector) -> Vector:
        on = 1.0 if math.fmod(t + 500.0, 3700.0) < 2900.0 else 0.1
        pull = 2.0e-4 + 1.2e-4 * square(t + 400.0, 3100.0)
        return on * (0.0032 + 0.0006 * square(t, 1700.0)), pull

    start = rng.normal([26.0, 27.0, 14.5], [0.5, 0.5, 0.1])
    density = [3e-6, 1e-6, 2e-8]
    truth = integrate(rates, start, density, physics['seconds'], 2.0, rng, machine, 20.0)
    return {
        'optics': sampled(truth, 'optics', 'gauge', 1 / 10, column(0), [0.25], rng),
        'lab': sampled(truth, 'lab', 'speed', 1 / 100, column(0), [0.15], rng),
        'crit': sampled(truth, 'crit', 'humidity', 1 / 10, lambda x: [4.5 / x[2]], [0.001], rng),
        'input': commanded(truth, 'machine', 'clearance_and_loss'),
    }


def skyscraper(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a tower with a mass that swings on its top, driven by a motor.

    Lengths are in mm and forces in kN, of 1000 t of the tower and 50 t of the mass. ``spring`` is
    the stiffness of the tower in kN/mm, ``oil`` the damping of the mass in kN s/m, ``weak`` the
    force below zero by what is recorded, and ``storm`` the density of the wind by that of the
    file.
    """
    spring, oil, weak = physics['spring'], 0.001 * physics['oil'], physics['weak']

    def rates(x: Vector, u: Vector) -> Vector:
        link = 0.08 * (x[2] - x[0]) + oil * (x[3] - x[1])
        force = u[0] if u[0] > 0.0 else weak * u[0]
        return (
            x[1], -spring * x[0] - 0.06 * x[1] + link - force,
            x[3], 20.0 * (force - link),
        )  # fmt: skip

    def motor(t: float, x: Vector) -> Vector:
        return (6.0 * square(t, 5.2) + 5.0 * math.sin(1.5 * t) + 3.0 * math.sin(2.6 * t),)

    start = rng.normal(0.0, [5.0, 8.0, 20.0, 40.0])
    density = [0, 20.0 * physics['storm'], 0, 30.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, motor, 0.05)

    return {
        'roof': sampled(truth, 'roof', 'point', 10.0, column(0), [2.0], rng),
        'stroke': sampled(
            truth, 'stroke', 'slide', 20.0, lambda x: [x[2] - x[0]], [4.0], rng
        ),
        'strain': sampled(truth, 'strain', 'gauge', 20.0, lambda x: [0.8 * x[0]], [2.0], rng),
        'geophone': sampled(truth, 'geophone', 'speed', 25.0, column(1), [2.0], rng),
        'input': commanded(truth, 'motor', 'drive_torque'),
    }  # fmt: skip
