# SPDX-License-Identifier: Apache-2.0
"""Bodies that MuJoCo simulates, as its own sensors see them: a gimbal, a cart-pole and a drone.

Random forces and noise are added here. Another version of MuJoCo may give other last digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Array, Readings, Track, commanded, sampled, square

#: Whether MuJoCo can be imported.
AVAILABLE = find_spec('mujoco') is not None
_WORLDS = Path(__file__).with_name('worlds')
#: The input, of the time and MuJoCo's data.
Control = Callable[[float, Any], Sequence[float]]


def world(name: str) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of a world."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(_WORLDS / f'{name}.xml'))
    return model, mujoco.MjData(model)


def observed(
    model: Any, data: Any, seconds: float, hold: float, control: Control,
    density: Sequence[float], rng: np.random.Generator,
) -> Track:  # fmt: skip
    """Return the readings of MuJoCo's sensors as a track, a row for each step.

    ``density`` is that of the random generalised forces; the input is constant for ``hold``.
    """
    import mujoco

    step = model.opt.timestep
    count, every = round(seconds / step), round(hold / step)
    pushes = rng.standard_normal((count, model.nv)) * np.sqrt(np.array(density) / step)
    seen = np.empty((count, model.nsensordata))
    inputs = []
    mujoco.mj_forward(model, data)
    for k in range(count):
        if k % every == 0:
            inputs.append([*control(k * step, data)])
            data.ctrl[:] = inputs[-1]
        data.qfrc_applied[:] = pushes[k]
        mujoco.mj_step(model, data)  # its sensors see the state before the step
        seen[k] = data.sensordata
    time: Array = step * np.arange(count, dtype=np.float64)
    return Track(time, seen, time[::every], np.array(inputs))


def gimbal(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a camera that pans and tilts, with an encoder on each axis and a gyro."""
    model, data = world('gimbal')
    data.qpos[:] = rng.normal([0.0, 0.0], [0.05, 0.05])
    data.qvel[:] = rng.normal(0.0, 0.1, 2)
    model.dof_damping[:] = physics['friction']

    def aim(t: float, data: Any) -> list[float]:
        wish = 1.0 * square(t, 11.0) + 0.5 * math.sin(0.9 * t), 0.4 * square(t + 2.0, 7.0) - 0.2
        seen = data.qpos + rng.normal(0.0, 0.02, 2)
        pan, tilt = 0.06 * (np.array(wish) - seen) - 0.03 * data.qvel
        return [pan, tilt - 0.04]

    density = [0.05 * 0.012**2, 0.05 * 0.006**2]
    truth = observed(model, data, physics['seconds'], 0.02, aim, density, rng)
    return {
        'pan': sampled(truth, 'pan', 'pan', 25.0, lambda y: [y[0]], [0.005], rng),
        'tilt': sampled(truth, 'tilt', 'tilt', 25.0, lambda y: [y[1]], [0.005], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda y: [*y[2:5], 0, 0, 0], [0.03] * 3 + [0.1] * 3, rng
        ),
        'input': commanded(truth, 'motors', 'pan_and_tilt'),
    }


def cartpole(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a cart that is pushed back and forth, with a pole that hangs down."""
    model, data = world('cartpole')
    model.body_mass[2] = physics['pole_mass']
    model.dof_damping[0] = physics['friction']
    data.qpos[:] = rng.normal([0.0, math.pi], [0.02, 0.1])
    data.qvel[:] = rng.normal(0.0, 0.1, 2)

    def push(t: float, data: Any) -> list[float]:
        x = data.qpos[0] + rng.normal(0.0, 0.02)
        return [3.0 * square(t, 3.1) + 2.0 * math.sin(4.3 * t) - 2.0 * x]

    truth = observed(model, data, physics['seconds'], 0.02, push, [0.02, 2e-4], rng)
    return {
        'cart': sampled(truth, 'cart', 'cart', 25.0, lambda y: [y[0]], [0.004], rng),
        'pole': sampled(truth, 'pole', 'pole', 25.0, lambda y: [y[1]], [0.008], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda y: [*y[2:5], 0, 0, 0], [0.03] * 3 + [0.1] * 3, rng
        ),
        'input': commanded(truth, 'force', 'force'),
    }


def drone(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a drone that flies loops; the readings of its IMU are the input.

    The biases of the IMU wander; its readings are means over 5 ms. The antenna may be elsewhere.
    """
    model, data = world('drone')
    model.site_pos[1] = physics['antenna_forward'], 0.0, physics['antenna_up']
    model.site_sameframe[1] = 0  # else MuJoCo takes it for the centre
    data.qpos[:3] = rng.normal([0.0, 0.0, 10.0], 0.5)
    data.qvel[:3] = rng.normal(0.0, 0.3, 3)
    half = 0.5 * rng.normal([0.0, 0.0, 0.6], [0.03, 0.03, 0.05])
    data.qpos[3:] = np.array([1.0, *half]) / math.sqrt(1.0 + half @ half)

    def fly(t: float, data: Any) -> list[float]:
        turn = data.xmat[1].reshape(3, 3)
        wish = 12.0 * math.sin(0.3 * t), 8.0 * math.sin(0.6 * t), 10.0 + 2.0 * square(t, 20.0)
        place = data.qpos[:3] + rng.normal(0.0, 0.1, 3)
        pull = 0.8 * (np.array(wish) - place) - 1.5 * data.qvel[:3]
        pull = pull.clip(-3.0, 3.0) + np.array([0.0, 0.0, 9.80665])
        lean = np.cross(turn[:, 2], pull / np.linalg.norm(pull)) @ turn
        rate = 0.5 * math.cos(0.2 * t)
        torque = [1.2 * lean[0] - 0.2 * data.qvel[3], 1.2 * lean[1] - 0.2 * data.qvel[4]]
        return [1.5 * pull @ turn[:, 2], *torque, 0.1 * (rate - data.qvel[5])]

    density = [0.3, 0.3, 0.3, 1e-5, 1e-5, 1e-5]
    truth = observed(model, data, physics['seconds'], 0.02, fly, density, rng)
    imu = 0.5 * (truth.state[:-2:2, :6] + truth.state[1:-1:2, :6])
    start = np.repeat([0.005, 0.05], 3), np.repeat([1e-10, 1e-7], 3)
    steps = rng.standard_normal(imu.shape) * np.sqrt(0.005 * start[1])
    steps[0] = rng.normal(0.0, start[0])
    truth.command_time, truth.command = truth.time[:-2:2], imu + np.cumsum(steps, axis=0)
    heard = commanded(truth, 'imu', 'imu')
    heard.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-6, 1e-4], 3) / 0.005)

    def pressure(y: Array) -> list[Array]:
        return [101325.0 * (1.0 - 0.0065 / 288.15 * (y[17] + 430.0)) ** 5.255876]

    return {
        'gnss': sampled(truth, 'place', 'triple', 5.0, lambda y: [*y[6:9]], [0.3, 0.3, 0.5], rng),
        'magnetometer': sampled(
            truth, 'field', 'field', 20.0, lambda y: [*y[9:12]], [1e-6] * 3, rng
        ),
        'flow': sampled(truth, 'flow', 'velocity', 20.0, lambda y: [*y[12:15]], [0.1] * 3, rng),
        'barometer': sampled(truth, 'pressure', 'pressure', 10.0, pressure, [6.0], rng),
        'input': heard,
    }
