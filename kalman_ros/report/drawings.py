# SPDX-License-Identifier: Apache-2.0
"""The systems themselves at one moment: truth solid, estimate dashed with its band."""

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
from .maps import SIGMAS, frame, magnified, observer, plane, sights
from .style import BOUND, ESTIMATE, INPUT, READING, TRUTH, time_label

#: The most curves of a system that has no drawing.
_ROWS = 4


@dataclass(frozen=True)
class Moments:
    """What is drawn: a run, the ``steps`` that are shown, and how its model is drawn.

    Parameters
    ----------
    scenario, run
        The run, and what it is of.
    steps
        Its indices.
    heading
        The name of a state, if it is a heading.
    length
        Of the part that is drawn, in m: that of the pole from the pivot to its centre.
    """

    scenario: Scenario
    run: Trajectory
    steps: Any
    heading: str | None = None
    length: float = 1.0

    @property
    def state(self) -> Space:
        """The space of the state."""
        return self.scenario.model.state

    def beliefs(self, name: str, k: int) -> tuple[float, float, float]:
        """Return a state in truth, its estimate, and the half width of its band."""
        index = self.state.names.index(name)
        std = float(np.sqrt(max(self.run.covariance[k, index, index], 0.0)))
        truth, mean = self.run.truth[k, index], self.run.estimate[k, index]
        return float(truth), float(mean), SIGMAS * std

    def reach(self, *names: str) -> float:
        """Return what holds these states (and 0) in all steps, and a third more."""
        found = self.run.truth[self.steps][:, self.state.indices(names)]
        return 1.35 * max(float(np.abs(found).max()), 1e-3)

    def push(self, k: int, index: int) -> float:
        """Return an input, such that 1 is large for it."""
        u = self.run.input[:, index] - self.scenario.model.equilibrium.input[index]
        usual = float(np.sqrt(np.mean(u**2)))
        return float(np.tanh(u[k] / (4.0 * usual))) if usual else 0.0

    def crosses(self, axis: Any, k: int) -> None:
        """Draw the last reading of each sensor that measures the place."""
        names = [self.state.names[index] for index in plane(self.state) or ()]
        for sensor, source in self.scenario.enabled.items():
            output = source.sensor.output
            if {*names} <= {*output.names}:
                read = self.run.readings[sensor]
                cross(axis, read, output.indices(names), float(self.run.time[k]))

    def place(self, k: int) -> tuple[Array, Array, Array]:
        """Return the true place (2,), its estimate (2,), and the covariance (2, 2)."""
        at = list(plane(self.state) or (0, 1))
        P = self.run.covariance[k][np.ix_(at, at)]
        return self.run.truth[k, at], self.run.estimate[k, at], P


def spring(axis: Any, show: Moments, k: int) -> None:
    """Draw a mass between a wall and the air."""
    reach, (x, mean, band) = show.reach('x'), show.beliefs('x', k)
    size = 0.12 * reach
    axis.add_patch(Rectangle((mean - band, -0.8 * size), 2.0 * band, 1.6 * size, **BAND_LOOK))
    coil(axis, (-reach, 0.0), (x - 0.5 * size, 0.0), 0.03 * reach)
    for at, look in ((x, TRUTH_LOOK), (mean, ESTIMATE_LOOK)):
        axis.add_patch(Rectangle((at - 0.5 * size, -0.5 * size), size, size, fill=False, **look))
    arrow(axis, (x, 0.9 * size), (0.4 * reach * show.push(k, 0), 0.0), reach)
    axis.plot((-reach, -reach, reach), (0.4 * reach, -0.5 * size, -0.5 * size), color=READING)
    window(axis, (-reach, reach), (-0.4 * reach, 0.5 * reach))
    axis.set_xlabel('x [m]')


def springs(axis: Any, show: Moments, k: int) -> None:
    """Draw a mass in a frame, on four springs."""
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
    long = 2.0 * show.length
    wide, high = 0.5 * long, 0.2 * long
    turn, half = 90.0 + np.degrees(mean), np.degrees(min(band, np.pi))
    axis.add_patch(Wedge((x_mean, high), 1.06 * long, turn - half, turn + half, **BAND_LOOK))
    axis.add_patch(
        Rectangle((x_mean - x_band, -0.1 * long), 2.0 * x_band, 0.05 * long, **BAND_LOOK)
    )
    for at, angle, look in ((x, theta, TRUTH_LOOK), (x_mean, mean, ESTIMATE_LOOK)):
        axis.add_patch(Rectangle((at - 0.5 * wide, 0.0), wide, high, fill=False, **look))
        tip = at - long * np.sin(angle), high + long * np.cos(angle)
        axis.plot((at, tip[0]), (high, tip[1]), **look)
    arrow(axis, (x, 0.5 * high), (1.2 * long * show.push(k, 0), 0.0), long)
    reach = show.reach('x') + 1.1 * long
    axis.plot((-reach, reach), (0.0, 0.0), color=READING)
    window(axis, (-reach, reach), (-0.4 * long, 1.7 * long))
    axis.set_xlabel('x [m]')


def motor(axis: Any, show: Moments, k: int) -> None:
    """Draw the angle of a load as a hand."""
    theta, mean, band = show.beliefs('theta', k)
    half = np.degrees(min(band, np.pi))
    axis.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=READING))
    turn = np.degrees(mean)
    axis.add_patch(Wedge((0.0, 0.0), 1.05, turn - half, turn + half, **BAND_LOOK))
    for angle, look in ((theta, TRUTH_LOOK), (mean, ESTIMATE_LOOK)):
        axis.plot((0.0, np.cos(angle)), (0.0, np.sin(angle)), **look)
    # the voltage as an arrow beside it
    arrow(axis, (1.4, 0.0), (0.0, show.push(k, 0)), 1.5)
    window(axis, (-1.8, 1.8), (-1.2, 1.2))
    axis.set_xticks(())
    axis.set_xlabel('the angle of the load, and the voltage')


def submersible(axis: Any, show: Moments, k: int) -> None:
    """Draw a vehicle under water with its thrusters; positive pitch is nose down (REP 103)."""
    truth, mean, P = show.place(k)
    size = 0.25
    axis.axhline(0.0, color=BOUND, ls=':')
    axis.fill(*outline(mean, P, SIGMAS).T, **BAND_LOOK)
    (pitch, believed, _) = show.beliefs('pitch', k)
    for at, turn, look in ((truth, pitch, TRUTH_LOOK), (mean, believed, ESTIMATE_LOOK)):
        body = Ellipse((0.0, 0.0), 3.0 * size, size, fill=False, **look)
        body.set_transform(Affine2D().rotate(-turn).translate(*at) + axis.transData)
        axis.add_patch(body)
    along = np.array([np.cos(pitch), -np.sin(pitch)])
    up = np.array([np.sin(pitch), np.cos(pitch)])
    for index, (offset, way) in enumerate(((-1.6, along), (1.0, up), (-1.0, up))):
        start = truth + offset * size * along
        arrow(axis, tuple(start), tuple(3.0 * size * show.push(k, index) * way), 6.0 * size)
    shown = show.run.truth[show.steps][:, list(plane(show.state) or (0, 1))]
    low, high = shown.min(axis=0), shown.max(axis=0)
    middle = 0.5 * (low + high)
    half = 0.5 * max(float(np.max(high - low)), 8.0 * size) + 3.0 * size
    axis.set_xlabel('x [m]')
    axis.set_ylabel('z [m]')
    window(axis, (middle[0] - 1.3 * half, middle[0] + 1.3 * half),
            (middle[1] - half, middle[1] + half))  # fmt: skip


def course(axis: Any, show: Moments, k: int) -> None:
    """Draw a vehicle or a target in the plane: its track, its ellipse, and bearings to it."""
    run, at = show.run, list(plane(show.state) or (0, 1))
    own = observer(show.scenario, run)
    moved = np.zeros((len(run.time), 2)) if own is None else own
    truth, mean = run.truth[:, at] + moved, run.estimate[:, at] + moved
    past = slice(show.steps[0], k + 1, max(1, (k + 1) // 400))
    P = run.covariance[k][np.ix_(at, at)]
    seen = list(sights(show.scenario, run))
    for sight in seen:
        ray(axis, sight, run.time[k], 4.0 * float(np.ptp(truth[show.steps], axis=0).max()))
        if own is None:
            axis.plot(*sight.place[0], '^', color=READING, ms=7)
    axis.fill(*outline(mean[k], P, SIGMAS).T, **BAND_LOOK)
    axis.plot(*mean[past].T, color=ESTIMATE, lw=1.0, ls='--')
    axis.plot(*truth[past].T, color=TRUTH, lw=0.8)
    show.crosses(axis, k)
    axis.plot(*mean[k], '+', color=ESTIMATE, ms=9, mew=1.6)
    if own is not None:
        axis.plot(*own[past].T, color=INPUT, lw=1.2)
        axis.plot(*own[k], '^', color=INPUT, ms=8)
    frame(axis, np.vstack([truth[show.steps], moved[show.steps], *(s.place[:1] for s in seen)])
          if seen else truth[show.steps])  # fmt: skip
    size = 0.025 * float(np.ptp(axis.get_xlim()))
    ahead = _heading(show, k) if own is None else _direction(np.gradient(truth, axis=0)[k])
    vehicle(axis, truth[k], ahead, size)
    magnified(axis, truth[k], mean[k], P, 'estimate')
    axis.set_xlabel('x [m]')
    axis.set_ylabel('y [m]')


def curves(axes: Any, show: Moments, k: int) -> None:
    """Draw the states of a system that has no drawing, up to now."""
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
                read = series.time <= run.time[k]
                column = source.sensor.output.names.index(name)
                axis.plot(series.time[read], series.values[read, column], '.', ms=2.5,
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


#: What draws one axis, by the kind of drawing; others are drawn as curves.
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
    """Return where a vehicle points: its heading, its rotation, or its velocity."""
    x, space = show.run.truth[k], show.state
    if show.heading is not None:
        return float(x[space.names.index(show.heading)])
    if space.rotations:
        return _direction(so3.exp(x[space.rotation(space.rotations[0])])[:, 0])
    if {'v_x', 'v_y'} <= {*space.names}:
        return _direction(x[space.indices(('v_x', 'v_y'))])
    return 0.0


def _direction(ahead: Array) -> float:
    return float(np.arctan2(ahead[1], ahead[0]))
