# SPDX-License-Identifier: Apache-2.0
"""Bodies that MuJoCo simulates: a beam with two rotors, and a pendulum with a reaction wheel.

Inputs are programs of time. Another version of MuJoCo may give other last digits.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Readings, commanded, sampled, square
from ..third.bodies import observed

_WORLDS = Path(__file__).with_name('worlds')


def _world(name: str) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of a world of this set."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(_WORLDS / f'{name}.xml'))
    return model, mujoco.MjData(model)


def twinrotor(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a beam on two hinges, with a rotor at each end.

    ``low`` is how far below the hinge its centre of mass is, ``friction`` that of the vertical
    hinge, and ``weak`` the thrust of the tail below zero by that which is recorded.
    """
    import mujoco

    model, data = _world('twinrotor')
    model.body_ipos[2, 2] = -physics['low']
    model.dof_damping[0] = physics['friction']
    mujoco.mj_setConst(model, data)
    data.qpos[:] = rng.normal(0.0, [0.05, 0.03])
    data.qvel[:] = rng.normal(0.0, 0.05, 2)

    def fly(t: float, data: Any) -> list[float]:
        return [
            0.25 * square(t, 3.7) + 0.15 * math.sin(5.1 * t),
            0.3 * square(t + 0.8, 5.3) + 0.2 * math.sin(1.4 * t),
        ]

    def act(t: float, data: Any) -> list[float]:
        main, tail = fly(t, data)
        return [main, tail if tail > 0.0 else physics['weak'] * tail]

    truth = observed(model, data, physics['seconds'], 0.02, act, [1e-5, 1e-5], rng)
    told = commanded(truth, 'rotors', 'rotors')
    told.value[:] = [fly(t, data) for t in told.time.tolist()]
    return {
        'yaw': sampled(truth, 'yaw', 'pan', 25.0, lambda y: [y[0]], [0.006], rng),
        'pitch': sampled(truth, 'pitch', 'tilt', 25.0, lambda y: [y[1]], [0.006], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda y: [*y[2:5], 0, 0, 0], [0.02] * 3 + [0.1] * 3, rng
        ),
        'input': told,
    }


def cubli(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return 50 seconds of a plate that hangs from a corner, with a wheel that pushes it.

    ``wheel`` is the inertia of the wheel, ``damping`` that of the hinge, ``stuck`` the torque
    below which the motor does nothing, and ``steps`` the density of pushes by that of the file.
    """
    import mujoco

    model, data = _world('cubli')
    model.body_inertia[2, 1] = physics['wheel']
    model.dof_damping[0] = physics['damping']
    mujoco.mj_setConst(model, data)
    data.qpos[:] = rng.normal(0.0, [0.05, 0.1])
    data.qvel[:] = rng.normal(0.0, [0.2, 1.0])
    stuck, steps = physics['stuck'], physics['steps']

    def spin(t: float, data: Any) -> list[float]:
        return [
            0.03 * square(t, 1.7) + 0.02 * math.sin(8.3 * t) * math.sin(0.3 * t)
            + 0.012 * math.sin(4.1 * t)
        ]  # fmt: skip

    def act(t: float, data: Any) -> list[float]:
        (torque,) = spin(t, data)
        return [math.copysign(max(abs(torque) - stuck, 0.0), torque)]

    truth = observed(model, data, physics['seconds'], 0.02, act, [4e-6 * steps, 1e-7], rng)
    told = commanded(truth, 'motor', 'spin')
    told.value[:] = [spin(t, data) for t in told.time.tolist()]
    return {
        'tilt': sampled(truth, 'tilt', 'tilt', 50.0, lambda y: [y[0]], [0.004], rng),
        'tacho': sampled(truth, 'tacho', 'wheel', 50.0, lambda y: [y[1]], [0.5], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda y: [*y[2:5], 0, 0, 0], [0.03] * 3 + [0.1] * 3, rng
        ),
        'input': told,
    }
