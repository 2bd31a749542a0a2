# SPDX-License-Identifier: Apache-2.0
"""Instruments that lie on their side, by the axis of gravity at the start."""

from __future__ import annotations

from collections.abc import Iterator
from math import acos, degrees, inf, radians

import numpy as np

from kalman_ros.core import Array, rotations
from kalman_ros.scenario.body_roles import body_of

from .examination import Examination
from .finding import Finding

#: Gravity in m/s^2, and the share of it by which the size of a mean may differ; the mean of an
#: instrument that is shaken, or has removed gravity, differs by more.
_GRAVITY, _DIFFERENT = 9.80665, 0.15
#: Angles between gravity and the vertical of the first belief, in rad: beyond the first one it is
#: no slope, and beyond the second one the accelerometer may have the other sign. And the deviation
#: of that belief beyond which any attitude is expected.
_FAR, _OPPOSITE, _UNKNOWN = radians(35.0), radians(145.0), 0.5
_AXES, _LEANING = ('x', 'y', 'z'), ('rx', 'ry', 'roll', 'pitch')


def find(case: Examination) -> Iterator[Finding]:
    """Yield the instruments of which gravity shows that they are turned.

    At rest an accelerometer reads gravity upwards. A robot in the plane is upright.
    """
    vertical = _vertical(case)
    if vertical is None:
        return
    for name, force in case.evidence.forces.items():
        size = float(np.linalg.norm(force))
        scenario = case.evidence.scenario
        signal = scenario.input if name == 'input' else scenario.sensors[name].signal
        mounted = rotations.exp(rotations.from_euler(np.array(signal.mounting.rotation)))
        read = signal.mounting.body_from_sensor @ force / max(size, 1e-9)
        angle = acos(float(np.clip(read @ vertical, -1.0, 1.0)))
        if abs(size / _GRAVITY - 1.0) < _DIFFERENT and _FAR < angle < _OPPOSITE:
            turn = _shortest(read, vertical)
            yield _turned(case, name, force, rotations.log(turn @ mounted), angle)


def _vertical(case: Examination) -> Array | None:
    """Return the vertical in the axes of the body, by the first belief; None if it is unknown."""
    scenario = case.evidence.scenario
    body, first = body_of(scenario.model.state, scenario.state), scenario.initial_belief
    leaning = [index for role, index in body.index.items() if role in _LEANING]
    # a pendulum is no robot that moves upright
    if not (body.moves and body.turns) or first.std[leaning].max(initial=0.0) > _UNKNOWN:
        return None
    return np.asarray(rotations.exp(body.attitude(first.mean))[2])


def _shortest(read: Array, vertical: Array) -> Array:
    """Return the smallest rotation (3, 3) of one direction (3,) onto another."""
    axis = np.cross(read, vertical)
    angle = acos(float(np.clip(read @ vertical, -1.0, 1.0)))
    return np.asarray(rotations.exp(angle * axis / np.linalg.norm(axis)))


def _turned(case: Examination, name: str, force: Array, mount: Array, angle: float) -> Finding:
    """Return the finding that an instrument is turned by an angle, and mounted so."""
    evidence, option = case.evidence, f'{name}.mount.rotation'
    angles = [round(float(euler_angle), 3) for euler_angle in rotations.to_euler(mount)]
    change = {option: angles}
    try:
        evidence.adopting(change)
    except ValueError:  # its fields have no axes
        change = {}
    main = int(np.argmax(np.abs(force)))
    words = ', '.join(f'{component:.3g}' for component in force.tolist())
    side = 'up' if force[main] > 0.0 else 'down'
    return Finding(
        'rotated', name,
        f'{name} is mounted at an angle: at the start it reads gravity as ({words}) m/s^2. Its '
        f'{_AXES[main]} looks {side}, {degrees(angle):.3g} deg off the vertical of the first '
        f'belief. {option}: {angles} turns it upright; how it is turned about the vertical, '
        'gravity does not show.',
        inf, change, plain=True, mended=(lambda: evidence.rerun(change)) if change else None,
    )  # fmt: skip
