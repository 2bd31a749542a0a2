# SPDX-License-Identifier: Apache-2.0
"""Motions on ``reference/path`` and ``reference/trajectory``, planned beside the loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kalman_ros.codecs.messages import decode, message_type
from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.control.planning import ReferenceMotion
from kalman_ros.core import Array
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import QUEUE
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario, motions
from kalman_ros.scenario.body_roles import body_of

from .newest_job import NewestJob
from .options import ControllerOptions

PATH, TRAJECTORY = 'reference/path', 'reference/trajectory'


class MotionReader:
    """Plans the motion of each received path or trajectory; the newest one counts.

    Parameters
    ----------
    node
        The node, for its subscriptions.
    frame
        Returns the frame of the estimate, '' if unknown.
    held
        Returns the state (n,) that is held now, at which a trajectory begins.
    here
        Returns the last estimate (n,), None before the first; a path begins there.
    """

    def __init__(
        self,
        node: Host,
        frame: Callable[[], str],
        held: Callable[[], Array],
        here: Callable[[], Array | None],
    ) -> None:
        self._node, self._frame, self._held, self._here = node, frame, held, here
        self._warn = Throttle(node.get_logger().warning)
        self._topic = ''
        #: Returns the reference that is being planned; None if none is.
        self._wanted: Callable[[], ReferenceMotion] | None = None

    def adopt(self, scenario: Scenario, options: ControllerOptions, limits: Limits) -> None:
        """Plan for another scenario, or with other options, from now on."""
        self._scenario, self._options, self._limits = scenario, options, limits
        if self._wanted is not None:
            self._plan()

    def listen(self) -> None:
        """Subscribe."""
        self._jobs: NewestJob[Motion] = NewestJob(waits=self._options.lockstep)
        self._planned: Motion | None = None
        self._regained: Array | None = None
        if body_of(self._scenario.model.state, self._scenario.state).position:
            self._subscribe(PATH, 'nav_msgs/Path', self._path)
        self._subscribe(TRAJECTORY, 'trajectory_msgs/JointTrajectory', self._trajectory)

    def regain(self, motion: Motion, scenario: Scenario) -> None:
        """Compute the gains of a motion again, for other weights, unless another is planned."""
        if self._wanted is None:
            self._regained = motion.states
            self._jobs.start(lambda: motions.with_law(scenario, motion))

    def is_regained(self, motion: Motion) -> bool:
        """Return whether a motion is the one whose gains were computed again."""
        return motion.states is self._regained

    def forget(self) -> None:
        """Forget what is planned, or being planned."""
        self._jobs.forget()
        self._planned = self._wanted = None

    def take(self) -> Motion | None:
        """Return a motion, once, when it is planned."""
        self.poll()
        motion, self._planned = self._planned, None
        return motion

    def poll(self) -> None:
        """Receive what is planned; an error is logged instead."""
        result = self._jobs.take()
        if result is not None:
            self._wanted = None
        if isinstance(result, Exception):
            self._warn(f'{self._topic}: {result}; what was held stays')
        elif result is not None:
            self._planned = result

    def _subscribe(
        self, topic: str, kind: str, read: Callable[[Any], Callable[[], ReferenceMotion]]
    ) -> None:
        message = message_type(kind)

        def on_message(data: bytes) -> None:
            try:
                wanted = read(decode(data, message))
            except ValueError as error:
                self._warn(f'{topic}: {error}; what was held stays')
                return
            self._topic, self._planned, self._wanted = topic, None, wanted
            self._plan()

        self._node.create_subscription(message, topic, on_message, QUEUE, raw=True)

    def _plan(self) -> None:
        """Start to plan the wanted motion; in lockstep it is then done."""
        wanted, scenario, limits = self._wanted, self._scenario, self._limits
        tolerance = self._options.path_tolerance
        assert wanted is not None
        self._jobs.start(lambda: motions.motion_of(scenario, wanted(), limits, tolerance))
        self.poll()

    def _path(self, message: Any) -> Callable[[], ReferenceMotion]:
        """Return what gives the reference of a ``nav_msgs/Path``."""
        given, expected = message.header.frame_id, self._frame()
        if given and expected and given != expected:
            raise ValueError(f"expected the frame '{expected}' of the estimate, got '{given}'")
        poses = [stamped.pose for stamped in message.poses]
        points = np.array([(p.position.x, p.position.y, p.position.z) for p in poses])
        points = points.reshape(-1, 3)
        yaw = _yaw([pose.orientation for pose in poses])
        times = _times([stamped.header.stamp for stamped in message.poses])
        if times is None and len(points):
            points, yaw = self._from_here(points, yaw)
        scenario, options = self._scenario, self._options
        return lambda: motions.along_path(
            scenario,
            points,
            options.path_speed,
            options.path_acceleration,
            yaw,
            times,
            options.path_tolerance,
        )

    def _from_here(self, points: Array, yaw: Array | None) -> tuple[Array, Array | None]:
        """Return a path from where the robot is, unless the path begins there."""
        here, state = self._here(), self._scenario.model.state
        if here is None:
            return points, yaw
        body = body_of(state, self._scenario.state)
        first = points[0].copy()
        for axis in body.position:
            first['xyz'.index(axis)] = body.value(here, axis)
        if not float(np.linalg.norm(points[0] - first)) > self._options.path_tolerance:
            return points, yaw
        yaw = None if yaw is None else np.append(yaw[0], yaw)
        return np.vstack((first, points)), yaw

    def _trajectory(self, message: Any) -> Callable[[], ReferenceMotion]:
        """Return what gives the reference of a ``trajectory_msgs/JointTrajectory``."""
        names, points = list(message.joint_names), message.points
        index = _joints(self._scenario, names)
        values, velocities = (
            _table(attribute, [getattr(point, attribute) for point in points], len(names))
            for attribute in ('positions', 'velocities')
        )
        if values is None:
            raise ValueError('expected positions')
        times = np.array([_seconds(point.time_from_start) for point in points])
        if len(times) and times[0] < 0.0:
            raise ValueError(f'expected times from 0 on, got {times[0]:g} s')
        if len(times) and times[0] > 0.0:  # from what is held now
            times = np.append(0.0, times)
            values = np.vstack((self._held()[index], values))
            if velocities is not None:
                velocities = np.vstack((np.zeros(len(names)), velocities))
        scenario = self._scenario
        return lambda: motions.in_time(scenario, index, times, values, velocities)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _times(stamps: Sequence[Any]) -> Array | None:
    """Return the times of poses (K,) from the first on; None if all stamps are the same."""
    times = np.array([stamp.sec * 1_000_000_000 + stamp.nanosec for stamp in stamps], dtype=object)
    if len({*times.tolist()}) < 2:
        return None
    return np.array((times - times[0]) * 1e-9, dtype=float)


def _yaw(orientations: Sequence[Any]) -> Array | None:
    """Return the headings (K,) of poses, whose quaternions may have any length.

    None if one before the last is not given: a planner that gives positions only leaves the
    orientations at zero, or all of them at identity.

    Raises
    ------
    ValueError
        If an orientation is not finite.
    """
    q = np.array([(o.x, o.y, o.z, o.w) for o in orientations]).reshape(-1, 4)
    if not np.isfinite(q).all():
        raise ValueError('expected finite orientations')
    given: Any = q.any(axis=1)
    if not q[:-1, :3].any() or not given[:-1].all():
        return None
    x, y, z, w = q.T
    yaw = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return np.asarray(yaw if given[-1] else np.append(yaw[:-1], yaw[-2]))


def _joints(scenario: Scenario, names: Sequence[str]) -> list[int]:
    """Return the coordinates of the state that joints are: by field, else by name."""
    fields = scenario.state.fields
    if not names or len({*names}) < len(names):
        raise ValueError(f'joint_names: expected one or more unique names, got {names}')
    known = scenario.model.state
    return [
        fields.index(f'position[{name}]')
        if f'position[{name}]' in fields
        else known.indices([name], 'joint_names')[0]
        for name in names
    ]


def _table(name: str, rows: Sequence[Any], count: int) -> Array | None:
    """Return the values of all points (K, k); None if no point has any."""
    if not any(len(row) for row in rows):
        return None
    for row in rows:
        if len(row) != count:
            raise ValueError(f'{name}: expected {count} numbers, one a joint, got {len(row)}')
    return np.array([list(row) for row in rows], dtype=float)
