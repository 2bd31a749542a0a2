# SPDX-License-Identifier: Apache-2.0
"""Bodies that MuJoCo simulates: a pendulum on an arm that turns, and a table on a spring.

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


def furuta(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a pendulum that hangs from the end of an arm, which a motor turns.

    ``mass`` is that of the pendulum, ``friction`` that of the arm, and ``stuck`` the torque below
    which the motor does not move.
    """
    import mujoco

    model, data = _world('furuta')
    share, stuck = physics['mass'] / model.body_mass[2], physics['stuck']
    model.body_mass[2] *= share
    model.body_inertia[2] *= share
    model.dof_damping[0] = physics['friction']
    mujoco.mj_setConst(model, data)
    data.qpos[:] = rng.normal(0.0, [0.02, 0.1])
    data.qvel[:] = rng.normal(0.0, 0.1, 2)

    def turn(t: float, data: Any) -> list[float]:
        return [0.03 * square(t, 2.3) + 0.02 * math.sin(6.0 * t) + 0.015 * math.sin(2.1 * t)]

    def act(t: float, data: Any) -> list[float]:
        (torque,) = turn(t, data)
        return [math.copysign(max(abs(torque) - stuck, 0.0), torque)]

    truth = observed(model, data, physics['seconds'], 0.02, act, [2e-6, 2e-7], rng)
    told = commanded(truth, 'motor', 'spin')
    told.value[:] = [turn(t, data) for t in told.time.tolist()]
    return {
        'arm': sampled(truth, 'arm', 'pan', 50.0, lambda y: [y[0]], [0.005], rng),
        'pole': sampled(truth, 'pole', 'pole', 50.0, lambda y: [y[1]], [0.006], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda y: [*y[2:5], 0, 0, 0], [0.05] * 3 + [0.1] * 3, rng
        ),
        'input': told,
    }


def isolator(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a table on a spring, which a coil pushes along one axis.

    ``mass`` is that of the table, ``damping`` that of its damper, ``lean`` a force that nobody
    records, and ``steps`` the density of random forces by that of the file.
    """
    import mujoco

    model, data = _world('isolator')
    model.body_mass[1] = physics['mass']
    model.dof_damping[0] = physics['damping']
    mujoco.mj_setConst(model, data)  # else the mass of the file moves
    data.qpos[:], data.qvel[:] = rng.normal(0.0, 0.005), rng.normal(0.0, 0.05)
    lean = physics['lean']

    def coil(t: float, data: Any) -> list[float]:
        return [30.0 * square(t, 2.6) + 15.0 * math.sin(8.0 * t) + 10.0 * math.sin(3.3 * t) + lean]

    truth = observed(model, data, physics['seconds'], 0.01, coil, [0.5 * physics['steps']], rng)
    truth.command -= lean
    return {
        'laser': sampled(truth, 'laser', 'range', 50.0, lambda y: [y[0]], [0.0005], rng),
        'geophone': sampled(truth, 'geophone', 'speed', 100.0, lambda y: [y[1]], [0.005], rng),
        'cell': sampled(truth, 'cell', 'force', 50.0, lambda y: [3000.0 * y[0]], [2.5], rng),
        'input': commanded(truth, 'coil', 'drive_torque'),
    }  # fmt: skip
