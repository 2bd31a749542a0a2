# SPDX-License-Identifier: Apache-2.0
"""Poses over time, and how far two of them are apart.

The measures are those of Z. Zhang and D. Scaramuzza, A Tutorial on Quantitative Trajectory
Evaluation for Visual(-Inertial) Odometry, IROS 2018: the absolute trajectory error, and relative
errors over parts of one length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, nan
from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal, Space
from kalman_ros.core import rotations as so3
from kalman_ros.scenario.body_roles import body_of

#: A path that is shorter than this, in metres, has no direction.
_SHORTEST = 1e-3
#: Rounding errors of a sum of steps are no step.
_ROUNDED = 1.0 - 1e-9
#: The median interval times the first number, and at least the second in s, is a gap.
_GAP, _SHORT_GAP = 5.0, 0.5
#: Largest number of parts of one length.
_MOST_PARTS = 1000


@dataclass(frozen=True)
class PosePath:
    """Poses of one body at increasing times.

    Parameters
    ----------
    time
        Times (N,), in seconds.
    position
        Positions (N, 3), in metres.
    rotation
        Rotation vectors (N, 3) from the axes of the body to those of ``frame``, in rad.
    covariance
        Covariances (N, 3, 3) of the positions; None if they are not known.
    frame
        Frame of the poses.
    planar
        Whether the third coordinate is not known.
    skipped
        Number of messages that had no pose at a time.
    """

    time: Array
    position: Array
    rotation: Array
    covariance: Array | None = None
    frame: str = ''
    planar: bool = False
    skipped: int = 0

    def covers(self, time: Array) -> Any:
        """Return at which times (M,) the path is known: not before or after it, nor in a gap."""
        if len(self.time) < 2:
            return np.zeros(len(time), dtype=bool)
        steps = np.diff(self.time)
        longest = max(_GAP * float(np.median(steps)), _SHORT_GAP)
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        known = (steps[after - 1] <= longest) | np.isin(time, self.time)
        return known & (time >= self.time[0]) & (time <= self.time[-1])

    def at(self, time: Array) -> PosePath:
        """Return the poses at times (M,), interpolated; where it is not known they are NaN."""
        if len(self.time) < 2:
            gone = np.full((len(time), 3), np.nan)
            return replace(self, time=time, position=gone, rotation=gone, covariance=None)
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        before = after - 1
        length = self.time[after] - self.time[before]
        share = ((time - self.time[before]) / np.where(length > 0.0, length, 1.0))[:, np.newaxis]
        outside = ~self.covers(time)
        first, last = self.position[before], self.position[after]
        turn = so3.compose(-self.rotation[before], self.rotation[after])
        C = self.covariance
        nearest = np.where(share[:, 0] < 0.5, before, after)
        return replace(
            self,
            time=time,
            position=_without(first + share * (last - first), outside),
            rotation=_without(so3.compose(self.rotation[before], share * turn), outside),
            covariance=None if C is None else C[nearest],
        )

    def within(self, other: PosePath) -> PosePath:
        """Return the poses at the times that another path covers."""
        use, C = other.covers(self.time), self.covariance
        return replace(
            self,
            time=self.time[use],
            position=self.position[use],
            rotation=self.rotation[use],
            covariance=None if C is None else C[use],
        )

    def aligned_with(self, reference: PosePath) -> PosePath:
        """Return the path, moved and turned about the vertical, next to poses of the same times.

        The turn and the shift have the least sum of squared distances.
        """
        mine, theirs = self.position, reference.position
        p, q = mine - mine.mean(axis=0), theirs - theirs.mean(axis=0)
        yaw = 0.0
        if min(np.abs(p[:, :2]).max(), np.abs(q[:, :2]).max()) > _SHORTEST:
            yaw = atan2(
                float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])),
                float(np.sum(p[:, :2] * q[:, :2])),
            )
        turn = np.array([0.0, 0.0, yaw])
        R, C = so3.exp(turn), self.covariance
        return replace(
            self,
            position=p @ R.T + theirs.mean(axis=0),
            rotation=so3.compose(turn, self.rotation),
            covariance=None if C is None else R @ C @ R.T,
            frame=reference.frame,
        )

    @property
    def length(self) -> float:
        """The way along the path, in metres."""
        return float(self.travelled[-1]) if len(self.time) else 0.0

    @property
    def travelled(self) -> Array:
        """The way (N,) from the first pose to each, in metres."""
        steps = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        return np.concatenate(([0.0], np.cumsum(steps)))


def _without(values: Array, gone: Array) -> Array:
    return np.where(gone[:, np.newaxis], np.nan, values)


def path_of_states(
    space: Space, signal: Signal, time: Array, mean: Array, covariance: Array | None, frame: str
) -> PosePath | None:
    """Return the poses in states (N, n); None if the state has no position and heading.

    Times are sorted, and of several states at one time the last one counts.
    """
    body = body_of(space, signal)
    if not (body.moves and body.turns) or not len(time):
        return None
    order = np.argsort(time, kind='stable')
    last = np.append(np.diff(time[order]) > 0.0, True)
    order = order[last]
    x = mean[order]
    position = np.stack([body.value(x, axis) for axis in 'xyz'], axis=-1)
    C = None
    if covariance is not None:
        index = [body.index[axis] for axis in body.position]
        C = np.zeros((len(x), 3, 3))
        k = len(index)
        C[:, :k, :k] = covariance[order][:, index][:, :, index]
    planar = 'z' not in body.index
    return PosePath(time[order], position, body.attitude(x), C, frame, planar)


@dataclass(frozen=True)
class RelativeError:
    """Errors over parts of one length.

    Parameters
    ----------
    length
        Length of the parts, in metres.
    position, rotation
        Root mean square errors at their ends, in metres and rad.
    count
        Number of parts.
    """

    length: float
    position: float
    rotation: float
    count: int


@dataclass(frozen=True)
class Separation:
    """How far a path is from a reference.

    Parameters
    ----------
    time
        Times (N,) at which both are known, in seconds.
    distance
        Distances (N,) of the positions, in metres; in the plane where one path has no height.
    ate
        Absolute trajectory error: the root of the mean squared distance.
    heading
        Root mean square of the differences of the heading, in rad.
    relative
        Relative errors, over parts of increasing length.
    nees
        Mean normalised squared difference of the positions by its expectation, as if both were
        independent; NaN without a covariance.
    aligned
        Whether the path was moved and turned to the reference first.
    """

    time: Array
    distance: Array
    ate: float
    heading: float
    relative: tuple[RelativeError, ...]
    nees: float
    aligned: bool


def separation(path: PosePath, reference: PosePath, *, align: bool) -> Separation | None:
    """Return how far a path is from a reference; None if there is no time of both."""
    mine = path.within(reference)
    if len(mine.time) < 2:
        return None
    theirs = reference.at(mine.time)
    if align:
        mine = mine.aligned_with(theirs)
    lengths = _lengths(theirs.length)
    headings = [_level(pose_path) for pose_path in (mine, theirs)]
    axes = 2 if path.planar or reference.planar else 3
    apart = (mine.position - theirs.position)[:, :axes]
    distance = np.linalg.norm(apart, axis=1)
    turned = so3.compose(-headings[1].rotation, headings[0].rotation)[..., 2]
    if axes == 2:
        mine, theirs = headings
    return Separation(
        time=mine.time,
        distance=distance,
        ate=_rms(distance),
        heading=_rms(turned),
        relative=tuple(_relative(mine, theirs, length, axes) for length in lengths),
        nees=_nees(apart, mine.covariance, theirs.covariance),
        aligned=align,
    )


def _level(path: PosePath) -> PosePath:
    """Return a path with the headings alone, without roll and pitch."""
    turns = np.zeros_like(path.rotation)
    turns[:, 2] = so3.to_euler(path.rotation)[..., 2]
    return replace(path, rotation=turns)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _lengths(whole: float) -> list[float]:
    """Return up to three round lengths, about a twentieth, a fifth and a half of a path."""
    if whole < 1.0:
        return []
    steps = np.outer(10.0 ** np.arange(-2, 6), (1.0, 2.0, 5.0)).ravel()
    lengths = [float(steps[steps <= share * whole].max()) for share in (0.05, 0.2, 0.5)]
    return list(dict.fromkeys(lengths))


def _relative(path: PosePath, reference: PosePath, length: float, axes: int) -> RelativeError:
    """Return the errors over parts of a length: the moves in the axes of their first poses."""
    way = reference.travelled
    starts = np.flatnonzero(way + length * _ROUNDED <= way[-1])
    starts = starts[:: max(1, len(starts) // _MOST_PARTS)]
    ends = np.searchsorted(way, way[starts] + length * _ROUNDED).clip(max=len(way) - 1)
    if not len(starts):
        return RelativeError(length, nan, nan, 0)
    moves, turns = [], []
    for pose_path in (path, reference):
        first = pose_path.rotation[starts]
        moves.append(so3.rotate_back(first, pose_path.position[ends] - pose_path.position[starts]))
        turns.append(so3.compose(-first, pose_path.rotation[ends]))
    apart = np.linalg.norm((moves[0] - moves[1])[:, :axes], axis=1)
    turned = np.linalg.norm(so3.compose(-turns[1], turns[0]), axis=1)
    return RelativeError(length, _rms(apart), _rms(turned), len(starts))


def _nees(apart: Array, *covariances: Array | None) -> float:
    known = [C for C in covariances if C is not None]
    if not known:
        return nan
    k = apart.shape[1]
    P = np.sum([C[:, :k, :k] for C in known], axis=0)
    try:
        solved = np.linalg.solve(P, apart[..., np.newaxis])[..., 0]
    except np.linalg.LinAlgError:
        return nan
    return float(np.mean(np.sum(apart * solved, axis=1)) / k)
