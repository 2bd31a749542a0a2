# SPDX-License-Identifier: Apache-2.0
"""Motions on ``reference/path`` and ``reference/trajectory``, planned beside the loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.codecs.messages import decode, message_type
from kalman_ros.control.feedback import Regulator
from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.control.planning import ReferenceMotion
from kalman_ros.core import Array
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import QUEUE
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario, motions
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.scenario.reference_motions import Beginning, along_path, in_time

from .newest_job import Job, NewestJob
from .options import ControllerOptions

PATH, TRAJECTORY = 'reference/path', 'reference/trajectory'

#: A new motion goes on from the last one if the estimate is near: within four tolerances of it.
_NEAR = 4.0
#: The motion that is followed is kept for this many times as long as the last planning took.
_LEAD, _LONGEST_LEAD = 1.5, 1.0
#: A body that moves at less than this share of the speed of paths is at rest.
_SLOW = 0.1
#: The most characters of a frame that are logged.
_SHOWN = 60


class _Wanted(NamedTuple):
    """The motion that a message asks for.

    ``coordinates`` are the indices of those that it gives. ``reference`` returns the reference
    from a beginning on, which is None before the first estimate; if it is ``paced``, at a share
    ``pace`` of its speed.
    """

    topic: str
    coordinates: list[int]
    reference: Callable[..., ReferenceMotion]
    paced: bool = False


class Planned(NamedTuple):
    """A motion, and the time at which it begins in the one that is followed; None: at once."""

    motion: Motion
    since: float | None


class MotionReader:
    """Plans the motion of each received path or trajectory, from the one that is followed on.

    Parameters
    ----------
    node
        The node, for its subscriptions.
    regulator
        The regulator, for the motion that it follows.
    frame
        Returns the frame of the estimate, '' if unknown.
    here
        Returns the last estimate (n,), None before the first.
    """

    def __init__(
        self,
        node: Host,
        regulator: Regulator,
        frame: Callable[[], str],
        here: Callable[[], Array | None],
    ) -> None:
        self._node, self._regulator, self._frame, self._here = node, regulator, frame, here
        self._warn = Throttle(node.get_logger().warning)
        #: The motion that was asked for last, until it is planned.
        self._wanted: _Wanted | None = None
        #: The scenario and the options that plans depend on.
        self._asked: tuple[object, tuple[object, ...]] = None, ()
        #: Whether the motion that is followed has the gains of other weights.
        self._stale = False
        #: Numbers of planned and refused references, and the reason of the last refusal.
        self.planned = self.refused = 0
        self.refusal = ''

    def adopt(self, scenario: Scenario, options: ControllerOptions, limits: Limits) -> None:
        """Plan for another scenario, or with other options, from now on."""
        asked = (
            options.path_speed, options.path_acceleration, options.path_tolerance,
            limits.lower.tolist(), limits.upper.tolist(), limits.rate.tolist(),
        )  # fmt: skip
        same = scenario is self._asked[0] and asked == self._asked[1]
        self._scenario, self._options, self._limits = scenario, options, limits
        self._asked = scenario, asked
        if self._wanted is not None and not same:
            self.plan(self._wanted)

    def listen(self) -> None:
        """Subscribe."""
        self._jobs: NewestJob[Planned] = NewestJob(waits=self._options.lockstep)
        self._planned: Planned | None = None
        self._planned_for: _Wanted | None = None
        self._waited = False
        if body_of(self._scenario.model.state, self._scenario.state).position:
            self._subscribe(PATH, 'nav_msgs/Path', self._path)
        self._subscribe(TRAJECTORY, 'trajectory_msgs/JointTrajectory', self._trajectory)

    def regain(self, motion: Motion, scenario: Scenario) -> None:
        """Compute the gains of a motion again, for other weights.

        If another is planned, it gets them in its place; one that is being planned has them.
        """
        self._stale = self._wanted is not None
        if not self._stale:
            source, self._planned = self._planned or Planned(motion, 0.0), None
            self._jobs.start(
                lambda: lambda _: source._replace(motion=motions.with_law(scenario, source.motion))
            )

    def forget(self) -> None:
        """Forget what is planned, or being planned."""
        self._jobs.forget()
        self._planned = self._wanted = self._planned_for = None

    @property
    def followed(self) -> _Wanted | None:
        """What the motion that is followed was planned for; None without one."""
        return None if self._regulator.motion is None else self._planned_for

    def plan(self, wanted: _Wanted) -> None:
        """Plan what is wanted, as soon as the plan before is followed."""
        self._wanted, self._planned, self._waited = wanted, None, False
        self._jobs.start(lambda: self._job(wanted))
        if self._options.lockstep:
            self.poll(acts=True)

    def take(self) -> Planned | None:
        """Return a motion to follow, once, when it is planned."""
        self.poll(acts=True)
        planned, self._planned = self._planned, None
        if planned is None:
            return None
        if self._waited and self._planned_for is not None:  # it may be elsewhere by now
            self.plan(self._planned_for)
            return self.take() if self._options.lockstep else None
        return planned

    def poll(self, *, acts: bool) -> None:
        """Receive what is planned; an error is logged instead.

        What is planned while the controller does not act is planned again before it is followed.
        """
        if self._planned is not None and (acts or not self._jobs.is_waiting):
            self._waited = self._waited or not acts
            return
        result = self._jobs.take()
        if result is None:
            return
        wanted = self._wanted
        if not self._jobs.is_waiting:
            self._wanted = None
        if isinstance(result, Exception):
            if wanted is None:
                self._warn(f'{result}; what was held stays')
            else:
                self._refuse(wanted.topic, result)
            if self._stale and self._regulator.motion is not None:
                self.regain(self._regulator.motion, self._scenario)
        else:
            self._planned, self._planned_for, self._waited = result, wanted, not acts
            self.planned += wanted is not None
            self._node.diagnostics.soon()

    def _refuse(self, topic: str, reason: Exception) -> None:
        """Log and report why a reference is refused."""
        self.refused, self.refusal = self.refused + 1, f'{topic}: {reason}'
        self._warn(f'{self.refusal}; what was held stays')
        self._node.diagnostics.soon()

    def _subscribe(self, topic: str, kind: str, read: Callable[[str, Any], _Wanted]) -> None:
        message = message_type(kind)

        def on_message(data: bytes) -> None:
            try:
                wanted = read(topic, decode(data, message))
            except ValueError as error:
                self._refuse(topic, error)
                return
            self.plan(wanted)

        self._node.create_subscription(message, topic, on_message, QUEUE, raw=True)

    def _job(self, wanted: _Wanted) -> Job[Planned]:
        """Return what plans the wanted motion from now on."""
        scenario, limits = self._scenario, self._limits
        tolerance = self._options.path_tolerance
        beginning, kept, since = self._beginning(wanted.coordinates)

        def job(interrupt: Callable[[], None]) -> Planned:
            paced = partial(wanted.reference, beginning)
            reference = paced if wanted.paced else paced()
            motion = motions.motion_of(scenario, reference, limits, tolerance, interrupt)
            return Planned(motion if kept is None else kept.then(motion), since)

        return job

    def _beginning(
        self, coordinates: list[int]
    ) -> tuple[Beginning | None, Motion | None, float | None]:
        """Return where a motion begins, the part of one that leads there, and where that begins.

        It goes on from the motion that is followed: from where that will be at the end of the
        planning, if it takes as long as the last time. If the estimate is not near the motion, or
        at rest, it begins at the estimate.
        """
        here, regulator, space = self._here(), self._regulator, self._scenario.model.state
        if here is None:
            return None, None, None
        aim, rest = regulator.target[0], np.zeros(space.size)
        off = np.abs(space.subtract(here, aim)[coordinates])
        near = bool((off <= _NEAR * self._options.path_tolerance).all())
        motion, now = regulator.motion, regulator.elapsed
        if motion is None or not near:
            is_held = near and regulator.feedback.gain.any()
            return Beginning(aim, rest) if is_held else self._moving(here), None, None
        lead = 0.0 if self._options.lockstep else min(_LEAD * self._jobs.took, _LONGEST_LEAD)
        kept = motion.part(now, now + lead)
        return Beginning(*motion.moving(now + lead)), kept, now

    def _moving(self, here: Array) -> Beginning:
        """Return an estimate (n,) and how it changes, by the model; at rest if it is slow."""
        model = self._scenario.model
        rate = model.time_derivative(here, self._regulator.input)
        body = body_of(model.state, self._scenario.state)
        speed = float(np.linalg.norm(rate[[body.index[axis] for axis in body.position]]))
        if body.position and speed < _SLOW * self._options.path_speed:
            rate = np.zeros(model.state.size)
        return Beginning(here, rate, self._regulator.input)

    def _path(self, topic: str, message: Any) -> _Wanted:
        """Return what a ``nav_msgs/Path`` asks for."""
        expected = self._frame()
        for header in (message.header, *(stamped.header for stamped in message.poses)):
            given = header.frame_id
            if given and expected and given != expected:
                raise ValueError(
                    f"expected the frame '{expected}' of the estimate, got '{given[:_SHOWN]}'"
                )
        poses = [stamped.pose for stamped in message.poses]
        points = np.array([(p.position.x, p.position.y, p.position.z) for p in poses])
        points = points.reshape(-1, 3)
        yaw = _yaw([pose.orientation for pose in poses])
        times = _times([stamped.header.stamp for stamped in message.poses])
        body = body_of(self._scenario.model.state, self._scenario.state)
        coordinates = [body.index[axis] for axis in body.position]

        def reference(beginning: Beginning | None, pace: float = 1.0) -> ReferenceMotion:
            scenario, options = self._scenario, self._options  # those of the planning
            if beginning is not None and times is not None and len(points):
                first = points[0, ['xyz'.index(axis) for axis in body.position]]
                self._check_start(coordinates, first, beginning)
            return along_path(
                scenario,
                points,
                options.path_speed,
                options.path_acceleration,
                yaw,
                times,
                options.path_tolerance,
                beginning,
                pace,
            )

        return _Wanted(topic, coordinates, reference, paced=times is None)

    def _trajectory(self, topic: str, message: Any) -> _Wanted:
        """Return what a ``trajectory_msgs/JointTrajectory`` asks for."""
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
        scenario = self._scenario

        def reference(beginning: Beginning | None) -> ReferenceMotion:
            if times[0] == 0.0:
                if beginning is not None:
                    self._check_start(index, values[0], beginning)
                return in_time(scenario, index, times, values, velocities, beginning)
            # the first point is reached from what is held now
            held = self._regulator.target[0]
            begun = beginning or Beginning(held, np.zeros(scenario.model.state.size))
            first = np.vstack((begun.state[index], values))
            slopes = None
            if velocities is not None:
                slopes = np.vstack((begun.rate[index], velocities))
            clock = np.append(0.0, times)
            return in_time(scenario, index, clock, first, slopes, begun)

        return _Wanted(topic, index, reference)

    def _check_start(self, coordinates: list[int], first: Array, beginning: Beginning) -> None:
        """Raise ValueError if what begins now begins elsewhere than the model is."""
        space, tolerance = self._scenario.model.state, self._options.path_tolerance
        wanted = beginning.state.copy()
        wanted[coordinates] = first
        off = np.abs(space.subtract(wanted, beginning.state)[coordinates])
        if not (off <= _NEAR * tolerance).all():
            worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
            name, unit = (side[coordinates[worst]] for side in (space.names, space.units))
            raise ValueError(
                f'it begins {off[worst]:.3g} {unit} away in {name}, allowed are '
                f'{_NEAR * tolerance:g} {unit}: give the first point a later time'
            )


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
