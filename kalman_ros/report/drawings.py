# SPDX-License-Identifier: Apache-2.0
"""Drawings of the systems at one time: the truth solid, the estimate dashed with its band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.patches import Circle, Ellipse, Rectangle, Wedge
from matplotlib.transforms import Affine2D

from kalman_ros.core import Array, Space
from kalman_ros.core import rotations as so3
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .drawing_parts import (
    BAND_LOOK,
    ESTIMATE_LOOK,
    TRUTH_LOOK,
    arrow,
    coil,
    cross,
    ray,
    vehicle,
    window,
)
from .ellipse import outline
from .maps import frame, magnified, observer, plane, sights
from .style import BOUND, ESTIMATE, INPUT, READING, SIGMAS, TRUTH, time_label

#: Largest number of curves of a system without a drawing.
_ROWS = 4


@dataclass(frozen=True)
class Moments:
    """The content of a drawing: a run, the steps that are shown, and options of the model.

    Parameters
    ----------
    scenario, run
        Scenario, and a run of it.
    steps
        Indices of the steps that are shown.
    heading
        Name of the state that is a heading; None without one.
    length
        Length in m of the pole of a cart, from the pivot to the centre.
    """

    scenario: Scenario
    run: Trajectory
    steps: Any
    heading: str | None = None
    length: float = 1.0

    @property
    def state(self) -> Space:
        """Space of the state."""
        return self.scenario.model.state

    def beliefs(self, name: str, k: int) -> tuple[float, float, float]:
        """Return the true value of a state, its estimate, and half the width of its band."""
        index = self.state.names.index(name)
        std = float(np.sqrt(max(self.run.covariance[k, index, index], 0.0)))
        truth, mean = self.run.truth[k, index], self.run.estimate[k, index]
        return float(truth), float(mean), SIGMAS * std

    def reach(self, *names: str) -> float:
        """Return the largest magnitude of these states in all steps, with a margin of a third."""
        values = self.run.truth[self.steps][:, self.state.indices(names)]
        return 1.35 * max(float(np.abs(values).max()), 1e-3)

    def push(self, k: int, index: int) -> float:
        """Return an input relative to its typical magnitude, limited to -1 to 1."""
        u = self.run.input[:, index] - self.scenario.model.equilibrium.input[index]
        rms = float(np.sqrt(np.mean(u**2)))
        return float(np.tanh(u[k] / (4.0 * rms))) if rms else 0.0

    def crosses(self, axis: Any, k: int) -> None:
        """Draw the last reading of each sensor that measures the position."""
        names = [self.state.names[index] for index in plane(self.state) or ()]
        for sensor, source in self.scenario.enabled.items():
            output = source.sensor.output
            if {*names} <= {*output.names}:
                read = self.run.readings[sensor]
                cross(axis, read, output.indices(names), float(self.run.time[k]))

    def place(self, k: int) -> tuple[Array, Array, Array]:
        """Return the true position (2,), its estimate (2,), and the covariance (2, 2)."""
        indices = list(plane(self.state) or (0, 1))
        P = self.run.covariance[k][np.ix_(indices, indices)]
        return self.run.truth[k, indices], self.run.estimate[k, indices], P


def spring(axis: Any, show: Moments, k: int) -> None:
    """Draw a mass on a spring at a wall."""
    reach, (x, mean, band) = show.reach('x'), show.beliefs('x', k)
    size = 0.12 * reach
    axis.add_patch(Rectangle((mean - band, -0.8 * size), 2.0 * band, 1.6 * size, **BAND_LOOK))
    coil(axis, (-reach, 0.0), (x - 0.5 * size, 0.0), 0.03 * reach)
    for centre, look in ((x, TRUTH_LOOK), (mean, ESTIMATE_LOOK)):
        axis.add_patch(
            Rectangle((centre - 0.5 * size, -0.5 * size), size, size, fill=False, **look)
        )
    arrow(axis, (x, 0.9 * size), (0.4 * reach * show.push(k, 0), 0.0), reach)
    axis.plot((-reach, -reach, reach), (0.4 * reach, -0.5 * size, -0.5 * size), color=READING)
    window(axis, (-reach, reach), (-0.4 * reach, 0.5 * reach))
    axis.set_xlabel('x [m]')


def springs(axis: Any, show: Moments, k: int) -> None:
    """Draw a mass on four springs in a frame."""
    reach = show.reach('x', 'y')
    truth, mean, P = show.place(k)
    for end in ((-reach, 0.0), (reach, 0.0), (0.0, -reach), (0.0, reach)):
        coil(axis, end, tuple(truth), 0.02 * reach)
    axis.fill(*outline(mean, P, SIGMAS).T, **BAND_LOOK)
    show.crosses(axis, k)
    axis.plot(*mean, '+', color=ESTIMATE, ms=9, mew=1.6)
    axis.add_patch(Circle(tuple(truth), 0.05 * reach, fill=False, **TRUTH_LOOK))
    push = 0.4 * reach * np.array([show.push(k, 0), show.push(k, 1)])
    arrow(axis, tuple(truth), tuple(push), reach)
    axis.set_xlabel('x [m]')
    axis.set_ylabel('y [m]')
    window(axis, (-reach, reach), (-reach, reach))
    magnified(axis, truth, mean, P, 'estimate')


def cart_pole(axis: Any, show: Moments, k: int) -> None:
    """Draw a cart with its pole, upright at 0."""
    (x, x_mean, x_band), (theta, mean, band) = show.beliefs('x', k), show.beliefs('theta', k)
    length = 2.0 * show.length
    width, height = 0.5 * length, 0.2 * length
    angle_deg, half = 90.0 + np.degrees(mean), np.degrees(min(band, np.pi))
    axis.add_patch(
        Wedge((x_mean, height), 1.06 * length, angle_deg - half, angle_deg + half, **BAND_LOOK)
    )
    axis.add_patch(
        Rectangle((x_mean - x_band, -0.1 * length), 2.0 * x_band, 0.05 * length, **BAND_LOOK)
    )
    for centre, angle, look in ((x, theta, TRUTH_LOOK), (x_mean, mean, ESTIMATE_LOOK)):
        axis.add_patch(Rectangle((centre - 0.5 * width, 0.0), width, height, fill=False, **look))
        tip = centre - length * np.sin(angle), height + length * np.cos(angle)
        axis.plot((centre, tip[0]), (height, tip[1]), **look)
    arrow(axis, (x, 0.5 * height), (1.2 * length * show.push(k, 0), 0.0), length)
    reach = show.reach('x') + 1.1 * length
    axis.plot((-reach, reach), (0.0, 0.0), color=READING)
    window(axis, (-reach, reach), (-0.4 * length, 1.7 * length))
    axis.set_xlabel('x [m]')


def motor(axis: Any, show: Moments, k: int) -> None:
    """Draw the angle of a load as the hand of a clock."""
    theta, mean, band = show.beliefs('theta', k)
    half = np.degrees(min(band, np.pi))
    axis.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=READING))
    angle_deg = np.degrees(mean)
    axis.add_patch(Wedge((0.0, 0.0), 1.05, angle_deg - half, angle_deg + half, **BAND_LOOK))
    for angle, look in ((theta, TRUTH_LOOK), (mean, ESTIMATE_LOOK)):
        axis.plot((0.0, np.cos(angle)), (0.0, np.sin(angle)), **look)
    # the arrow is the voltage
    arrow(axis, (1.4, 0.0), (0.0, show.push(k, 0)), 1.5)
    window(axis, (-1.8, 1.8), (-1.2, 1.2))
    axis.set_xticks(())
    axis.set_xlabel('the angle of the load, and the voltage')


def submersible(axis: Any, show: Moments, k: int) -> None:
    """Draw a submersible with its thrusters; positive pitch is nose down (REP 103)."""
    truth, mean, P = show.place(k)
    size = 0.25
    axis.axhline(0.0, color=BOUND, ls=':')
    axis.fill(*outline(mean, P, SIGMAS).T, **BAND_LOOK)
    (pitch, pitch_mean, _) = show.beliefs('pitch', k)
    for position, angle, look in ((truth, pitch, TRUTH_LOOK), (mean, pitch_mean, ESTIMATE_LOOK)):
        body = Ellipse((0.0, 0.0), 3.0 * size, size, fill=False, **look)
        body.set_transform(Affine2D().rotate(-angle).translate(*position) + axis.transData)
        axis.add_patch(body)
    along = np.array([np.cos(pitch), -np.sin(pitch)])
    up = np.array([np.sin(pitch), np.cos(pitch)])
    for index, (offset, direction) in enumerate(((-1.6, along), (1.0, up), (-1.0, up))):
        start = truth + offset * size * along
        arrow(axis, tuple(start), tuple(3.0 * size * show.push(k, index) * direction), 6.0 * size)
    shown = show.run.truth[show.steps][:, list(plane(show.state) or (0, 1))]
    low, high = shown.min(axis=0), shown.max(axis=0)
    middle = 0.5 * (low + high)
    half = 0.5 * max(float(np.max(high - low)), 8.0 * size) + 3.0 * size
    axis.set_xlabel('x [m]')
    axis.set_ylabel('z [m]')
    window(axis, (middle[0] - 1.3 * half, middle[0] + 1.3 * half),
            (middle[1] - half, middle[1] + half))  # fmt: skip


def course(axis: Any, show: Moments, k: int) -> None:
    """Draw a vehicle or a target in the plane, with its track, its ellipse, and bearings."""
    run, indices = show.run, list(plane(show.state) or (0, 1))
    track = observer(show.scenario, run)
    offset = np.zeros((len(run.time), 2)) if track is None else track
    truth, mean = run.truth[:, indices] + offset, run.estimate[:, indices] + offset
    past = slice(show.steps[0], k + 1, max(1, (k + 1) // 400))
    P = run.covariance[k][np.ix_(indices, indices)]
    visible = list(sights(show.scenario, run))
    for sight in visible:
        ray(axis, sight, run.time[k], 4.0 * float(np.ptp(truth[show.steps], axis=0).max()))
        if track is None:
            axis.plot(*sight.place[0], '^', color=READING, ms=7)
    axis.fill(*outline(mean[k], P, SIGMAS).T, **BAND_LOOK)
    axis.plot(*mean[past].T, color=ESTIMATE, lw=1.0, ls='--')
    axis.plot(*truth[past].T, color=TRUTH, lw=0.8)
    show.crosses(axis, k)
    axis.plot(*mean[k], '+', color=ESTIMATE, ms=9, mew=1.6)
    if track is not None:
        axis.plot(*track[past].T, color=INPUT, lw=1.2)
        axis.plot(*track[k], '^', color=INPUT, ms=8)
    frame(axis, np.vstack([truth[show.steps], offset[show.steps], *(s.place[:1] for s in visible)])
          if visible else truth[show.steps])  # fmt: skip
    size = 0.025 * float(np.ptp(axis.get_xlim()))
    heading = _heading(show, k) if track is None else _direction(np.gradient(truth, axis=0)[k])
    vehicle(axis, truth[k], heading, size)
    magnified(axis, truth[k], mean[k], P, 'estimate')
    axis.set_xlabel('x [m]')
    axis.set_ylabel('y [m]')


def curves(axes: Any, show: Moments, k: int) -> None:
    """Draw the states of a system without a drawing as curves, up to step ``k``."""
    run, space = show.run, show.state
    past = slice(show.steps[0], k + 1)
    time = run.time[past]
    for index, axis in enumerate(axes):
        name = space.names[index]
        band = SIGMAS * np.sqrt(np.maximum(run.covariance[:, index, index], 0.0))
        mean, truth = run.estimate[:, index], run.truth[:, index]
        for sensor, source in show.scenario.enabled.items():
            series = run.readings[sensor]
            if name in source.sensor.output.names and len(series.time):
                taken = series.time <= run.time[k]
                column = source.sensor.output.names.index(name)
                axis.plot(series.time[taken], series.values[taken, column], '.', ms=2.5,
                          color=READING)  # fmt: skip
        axis.fill_between(time, (mean - band)[past], (mean + band)[past], **BAND_LOOK)
        axis.plot(time, mean[past], color=ESTIMATE, lw=1.2, ls='--')
        axis.plot(time, truth[past], color=TRUTH, lw=0.9)
        shown = np.concatenate([(truth - band)[show.steps], (truth + band)[show.steps]])
        low, high = np.quantile(shown, (0.05, 0.95))
        margin = 0.2 * (high - low) or 1.0
        axis.set_ylim(min(low, truth.min()) - margin, max(high, truth.max()) + margin)
        axis.set_xlim(run.time[show.steps[0]], run.time[show.steps[-1]])
        axis.set_ylabel(space.label(name))
    axes[-1].set_xlabel(time_label())


#: Function that draws one axis, by the kind of drawing; any other kind is drawn as curves.
DRAWN = {
    'spring': spring,
    'springs': springs,
    'cart_pole': cart_pole,
    'motor': motor,
    'submersible': submersible,
    'plane': course,
}


def rows(kind: str, state: Space) -> int:
    """Return the number of axes of a drawing."""
    return 1 if kind in DRAWN else min(state.size, _ROWS)


def _heading(show: Moments, k: int) -> float:
    """Return the direction of a vehicle from its heading, its rotation, or its velocity."""
    x, space = show.run.truth[k], show.state
    if show.heading is not None:
        return float(x[space.names.index(show.heading)])
    if space.rotations:
        return _direction(so3.exp(x[space.rotation(space.rotations[0])])[:, 0])
    if {'v_x', 'v_y'} <= {*space.names}:
        return _direction(x[space.indices(('v_x', 'v_y'))])
    return 0.0


def _direction(vector: Array) -> float:
    return float(np.arctan2(vector[1], vector[0]))
