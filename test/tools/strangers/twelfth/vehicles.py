# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a guide in a museum, a valet for cars, a go-kart, a sprayer, and a small submarine.

Inputs are programs of time, or the readings of the IMU; the go-kart has none.
"""

from __future__ import annotations

import math

import numpy as np

from ..fifth.rotations import Quaternion, exponential, product, rotated
from ..second.vehicles import GRAVITY, Physics
from ..simulation import (
    Array,
    Readings,
    Track,
    Vector,
    column,
    commanded,
    integrate,
    sampled,
    square,
)

#: Where the three loudspeakers of the museum are.
_LOUDSPEAKERS = (7.0, 3.0), (-5.0, 6.5), (-2.0, -7.0)
#: Where the two posts of the car park are.
_POSTS = (9.0, 6.0), (-8.0, 3.0)
#: Where the four radio anchors of the track are.
_ANCHORS = (60.0, 50.0), (-70.0, 60.0), (-60.0, -70.0), (70.0, -60.0)
#: Where the two beacons of the lake are: along the plane of the submarine, and up.
_BEACONS = (25.0, -2.0), (-18.0, -16.0)
#: The path of the sprayer: of each coordinate the mean, and sizes and rates of two sines.
_PATH = (
    (5.0, (14.0, 0.31), (0.6, 1.3)),
    (-8.0, (9.0, 0.43), (0.5, 1.6)),
    (3.5, (0.8, 0.52), (0.15, 2.3)),
)


def _distances(x: Array, places: Vector | Array | tuple[tuple[float, float], ...]) -> list[Array]:
    """Return the distances of the first two states to places in the plane."""
    return [np.hypot(a - x[0], b - x[1]) for a, b in np.asarray(places)]


def docent(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a guide on two wheels that hears three loudspeakers.

    The last of them is at ``x_c``, ``track`` is the distance of the wheels by that of the file,
    and from ``halt`` on it is told to stand for 20 s.
    """
    places = (*_LOUDSPEAKERS[:2], (physics['x_c'], _LOUDSPEAKERS[2][1]))
    track, halt = physics['track'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.4, turn, (u[1] - turn) / 0.4
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 20.0:
            return 0.0, 0.0
        speed = 0.45 + 0.2 * square(t, 9.1) + 0.1 * math.sin(1.3 * t)
        return speed, 0.18 + 0.45 * square(t + 1.0, 11.3) + 0.3 * math.sin(0.7 * t)

    start = rng.normal([1.0, -0.5, 0.3, -0.6, 0.0], [0.05, 0.05, 0.03, 0.03, 0.05])
    bias = rng.normal(0.0, 0.02)
    density = [0, 0, 0.01, 0, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)
    return {
        'odom': sampled(
            truth, 'odom', 'odometry', 20.0, lambda x: [x[2], track * x[4]], [0.025, 0.05], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 40.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(3), [0.04], rng),
        'sound': sampled(
            truth, 'sound', 'three_ranges', 5.0, lambda x: _distances(x, places), [0.03] * 3, rng
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def valet(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a platform that moves in all directions of a car park.

    Its scanner sees two posts. Its controllers are ``lag`` behind commands, and it moves to the
    left by ``left`` of these.
    """
    k, left = 1.0 / physics['lag'], physics['left']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, turn, ax, ay = x
        c, s, growth, fall = math.cos(yaw), math.sin(yaw), ax + turn * vy, ay - turn * vx
        return (
            c * vx - s * vy, s * vx + c * vy, turn, growth, fall, k * (u[2] - turn),
            4.0 * k * (k * (u[0] - vx) - growth), 4.0 * k * (k * (left * u[1] - vy) - fall),
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return (
            0.5 * square(t, 6.3) + 0.3 * math.sin(0.8 * t),
            0.45 * square(t + 0.9, 8.7) + 0.3 * math.cos(1.1 * t),
            0.5 * square(t + 2.0, 7.9) + 0.25 * math.sin(0.9 * t),
        )

    def look(x: Array) -> list[Array]:
        seen = []
        for a, b in _POSTS:
            bearing = np.arctan2(b - x[1], a - x[0]) - x[2]
            seen += [np.hypot(a - x[0], b - x[1]), np.angle(np.exp(1j * bearing))]
        return seen

    start = rng.normal([0.5, -1.0, 0.8, *[0.0] * 5], [0.05, 0.05, 0.02, *[0.1] * 5])
    density = [0, 0, 0, 0, 0, 0.02, 0.2, 0.2]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)
    return {
        'odom': sampled(
            truth, 'odom', 'legs', 20.0, lambda x: [*x[3:6]], [0.03, 0.03, 0.04], rng
        ),
        'imu': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], x[6], x[7], GRAVITY],
            [0.01] * 3 + [0.1] * 3, rng,
        ),
        'posts': sampled(
            truth, 'posts', 'reflectors', 8.0, look, [0.03, 0.008, 0.03, 0.008], rng
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def gokart(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of an electric go-kart that drives among four radio anchors.

    The second anchor is at ``y_b``; ``tread`` is the radius of a tyre by that of the file.
    """
    decay, tread = 1.0 / 2.5, physics['tread']
    anchors = (_ANCHORS[0], (_ANCHORS[1][0], physics['y_b']), *_ANCHORS[2:])

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn, a, _, _ = x
        return v * math.cos(psi), v * math.sin(psi), turn, a, -decay * turn, -decay * a, 0.0, 0.0

    start = rng.normal(
        [5.0, -10.0, 2.2, 7.0, 0.5, 0.0, 0.0, 0.0], [0.3, 0.3, 0.05, 0.3, 0.1, 0.2, 0.01, 0.1]
    )
    density = [0, 0, 0, 0, 0.12, 0.06, 1e-9, 1e-6]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng)

    def imu(x: Array) -> list[Array | float]:
        return [0, 0, x[4] + x[6], x[5] + x[7], x[3] * x[4], GRAVITY]

    return {
        'anchors': sampled(
            truth, 'anchors', 'ranges', 10.0, lambda x: _distances(x, anchors), [0.12] * 4, rng
        ),
        'imu': sampled(truth, 'imu', 'imu', 50.0, imu, [0.015] * 3 + [0.2] * 3, rng),
        'hall': sampled(
            truth, 'hall', 'wheel', 20.0, lambda x: [x[3] / (0.14 * tread)], [0.8], rng
        ),
    }  # fmt: skip


def _averaged(sensed: Array) -> Array:
    """Return means over 10 ms of what is sensed every 2.5 ms, by the rule of trapezia."""
    count = len(sensed) - 1
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    means: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    return means


def sprayer(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a drone that sprays a vineyard, with an antenna on each of two arms.

    The readings of its IMU are the input, and means over 10 ms. The first antenna is ``fore``
    ahead of the middle, and the other one 0.9 m behind.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)

    def turn(t: float) -> list[float]:
        return [
            0.2 * math.sin(2.3 * t) - 0.03 * math.cos(0.6 * t),
            0.22 * math.cos(1.9 * t) + 0.04 * math.sin(0.5 * t),
            0.5 * math.sin(0.4 * t) + 0.3 * math.cos(0.9 * t),
        ]

    q: Quaternion = exponential(rng.normal([0.05, 0.0, 0.9], 0.03).tolist())
    turns, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()
    for t in time.tolist():
        pull = [-sum(s * w**2 * math.sin(w * t) for s, w in sines) for _, *sines in _PATH]
        forces.append(rotated((q[0], -q[1], -q[2], -q[3]), [*pull[:2], pull[2] + GRAVITY]))
        rates.append(turn(t))
        turns.append(q)
        q = product(q, exponential([step * w for w in turn(t + 0.5 * step)]))
    place = np.array([m + sum(s * np.sin(w * time) for s, w in sines) for m, *sines in _PATH]).T
    moved = np.array([sum(s * w * np.cos(w * time) for s, w in sines) for _, *sines in _PATH]).T
    speed = rng.normal(0.0, 0.02, 3)
    place += rng.normal(0.0, 0.05, 3) + time[:, np.newaxis] * speed
    moved += speed
    seen = [rotated((a, -b, -c, -d), v) for (a, b, c, d), v in zip(turns, moved.tolist())]
    arms = [
        place + np.array([rotated(q, (ahead, 0.0, 0.2)) for q in turns])
        for ahead in (physics['fore'], -0.9)
    ]
    states = np.hstack((*arms, place[:, 2:], seen))
    imu = _averaged(np.hstack((rates, forces)))
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * np.repeat([1e-9, 1e-7], 3))
    walk[0] = rng.normal(0.0, np.repeat([0.005, 0.05], 3))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    heard = commanded(truth, 'imu', 'imu')
    heard.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-5, 1e-3], 3) / 0.01)
    noise = [0.03, 0.03, 0.05]
    return {
        'fore': sampled(truth, 'fore', 'triple', 5.0, lambda x: [*x[:3]], noise, rng),
        'aft': sampled(truth, 'aft', 'triple', 5.0, lambda x: [*x[3:6]], noise, rng),
        'altimeter': sampled(truth, 'altimeter', 'range', 10.0, column(6), [0.05], rng),
        'flow': sampled(truth, 'flow', 'planar', 20.0, lambda x: [*x[7:9]], [0.08] * 2, rng),
        'input': heard,
    }


def minisub(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a small submarine in a vertical plane, between two beacons.

    ``buoyancy`` is that of the file or another, ``drag`` the quadratic one, ``fore`` the gain of
    the fore thruster, and ``weak`` that of the propeller astern.
    """
    buoyancy, drag, gain, weak = (physics[k] for k in ('buoyancy', 'drag', 'fore', 'weak'))

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, pitch, ahead, up, q = x
        c, s = math.cos(pitch), math.sin(pitch)
        push, fore, aft = (u[0] if u[0] > 0.0 else weak * u[0]), gain * u[1], u[2]
        surge = push - (6.0 + drag * abs(ahead)) * ahead - buoyancy * s - 30.0 * up * q
        heave = fore + aft - (6.0 + drag * abs(up)) * up + buoyancy * c + 20.0 * ahead * q
        moment = 0.3 * (aft - fore) - (0.8 + 2.0 * abs(q)) * q - 15.0 * s + 10.0 * ahead * up
        return (
            c * ahead + s * up, c * up - s * ahead, q, surge / 20.0, heave / 30.0, moment / 2.0
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        heave, lean = -1.5 + 2.5 * square(t, 21.0), 4.0 * square(t + 2.0, 9.0)
        wave = 2.0 * math.sin(0.8 * t)
        return (
            3.0 + 13.0 * square(t, 27.0) + 4.0 * math.sin(0.5 * t),
            heave - lean + wave, heave + lean - wave,
        )  # fmt: skip

    start = rng.normal([0, -8, 0, 0.3, 0, 0], [0.2, 0.1, 0.03, 0.05, 0.05, 0.03])
    density = [0, 0, 0, 0.2 / 20.0**2, 0.2 / 30.0**2, 0.004 / 4.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, steer, 0.2)
    return {
        'beacons': sampled(
            truth, 'beacons', 'two_ranges', 2.0, lambda x: _distances(x, _BEACONS), [0.1] * 2, rng
        ),
        'gauge': sampled(
            truth, 'gauge', 'pressure', 10.0, lambda x: [101325.0 - 1000.0 * GRAVITY * x[1]],
            [250.0], rng,
        ),
        'doppler': sampled(
            truth, 'doppler', 'surge_and_heave', 5.0, lambda x: [x[3], x[4]], [0.02, 0.02], rng
        ),
        'imu': sampled(
            truth, 'imu', 'imu', 20.0, lambda x: [0, x[5], 0, 0, 0, 0], [0.01] * 6, rng
        ),
        'bubble': sampled(truth, 'bubble', 'tilt', 10.0, column(2), [0.02], rng),
        'input': commanded(truth, 'thrusters', 'auv_thrusters'),
    }  # fmt: skip
