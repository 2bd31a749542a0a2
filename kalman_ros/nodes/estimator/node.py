# SPDX-License-Identifier: Apache-2.0
"""The estimator: readings and inputs in, the state with its covariance out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool, Trigger

from kalman_ros.analysis.observability import observability
from kalman_ros.codecs.messages import message_type
from kalman_ros.core import Gaussian, Option, Value
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.meters import Latency
from kalman_ros.nodes.middleware.topics import QUEUE, STATIC
from kalman_ros.nodes.middleware.watcher import waiting
from kalman_ros.pipeline import transforms
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.frames import STATIC as TF_STATIC
from kalman_ros.pipeline.frames import Frames
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.fusion import check_start, falls_while_idle, fusion
from kalman_ros.pipeline.global_topics import uses_fixes
from kalman_ros.pipeline.initial_pose import (
    OWN_POSE,
    POSES,
    SHARED,
    ForeignFrameError,
    OthersPoseError,
    PoseReader,
)
from kalman_ros.pipeline.mounts import Mounts
from kalman_ros.pipeline.named_state import StateReader
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.settings import Settings, estimator_extra
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

from .changeover import Changeover
from .channel import InputChannel, SensorChannel
from .frame_finder import FrameFinder
from .geographic import GeographicServer, service_type
from .health import Health
from .intake import LockstepIntake, RealTimeIntake
from .publisher import EstimatePublisher
from .smoothed_publisher import SmoothedPublisher
from .transform_publisher import TransformPublisher

#: The lowest rate of publication, in Hz, other than none.
_SLOWEST = 1e-3


class EstimatorNode(runtime.ScenarioNode):
    """Feeds an `OnlineEstimator` from topics and publishes its estimates."""

    def __init__(self) -> None:
        super().__init__('estimator', EstimatorOptions)

    def configure(self) -> None:
        """Build the filter and its intake, and create the publishers."""
        super().configure()
        scenario, options = self.scenario, self.options
        if 0.0 < options.publish_rate < _SLOWEST:
            expected = f'0 or at least {_SLOWEST:g} Hz'
            raise ValueError(f'publish_rate: expected {expected}, got {options.publish_rate:g}')
        settings = Settings(scenario, options, self.extra)
        estimation = settings.fusion(wait=options.lockstep)
        origin = self._origin = settings.origin()
        self._online, self._estimation = settings.estimator(estimation), estimation
        seen = observability(scenario)
        self._estimates = EstimatePublisher(self, scenario, options, origin)
        self._read_pose = PoseReader(scenario, options.frame)
        self._read_state = StateReader(scenario)
        self._smoothed = None
        if options.fixed_lag:
            self._smoothed = SmoothedPublisher(self, scenario, options, self._online)
        self._latency = Latency()
        frames, warn = (options.frame, options.child_frame), self.get_logger().warning
        self._mounts = mounts = Mounts(scenario, options.child_frame, warn)
        self._transforms, self._static = None, None
        if options.publish_tf and self._has_transforms('publish_tf: no transform is published'):
            self._transforms = TransformPublisher(self, scenario, options)
        others = f"mount.tf: sensors in other frames than '{options.child_frame}' are not used"
        if mounts.needed and self._has_transforms(others):
            self._static = message_type(transforms.TYPE)
        channels = {
            name: SensorChannel(self, name, source, scenario.state, origin, mounts)
            for name, source in scenario.sensors.items()
        }
        input = InputChannel(scenario.input, frames, warn, mounts)
        self._fuser = Fuser(
            scenario,
            self._online,
            channels,
            input,
            warn,
            settings.input_timeout(),
            estimation.arithmetic,
        )
        self._changeover = Changeover(self, lambda: self._use(self._fuser.scenario))
        self._changeover.when_compiled(estimation.pending)
        mounts.on_mounted = self._use_before_next
        self._health = Health(self._fuser, self._latency, warn)
        self.get_logger().info(str(seen))  # after all checks
        falling = falls_while_idle(scenario, options)
        if falling:
            warn(falling)

    def activate(self) -> None:
        """Start from the initial belief and subscribe.

        An earlier belief is useless: the inputs in the meantime are unknown.
        """
        self._fuser.begin(self.scenario.believed.initial)
        self._fuser.fusing = True
        if self.options.lockstep:
            LockstepIntake(self, self._fuser)
        else:
            RealTimeIntake(self, self._fuser, self._latency)
        if self._transforms is not None:
            self._transforms.subscribe()
        if self._static is not None:
            self.create_subscription(self._static, TF_STATIC, self._on_static, STATIC, raw=True)
        self._finder = FrameFinder(self)
        self.at_the_end(self._finder.stop)
        pose, shared = self._read_pose, partial(self._read_pose, shared=True)
        for topic in (*POSES, OWN_POSE):
            take = self._take_belief(topic, pose.message_type, shared if topic == SHARED else pose)
        self._take_belief('~/set_state', self._read_state.message_type, self._read_state)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/toggle', self._on_toggle)
        self._answer_as_robot_localization(take)
        if uses_fixes(self.scenario) or self._origin.plane is not None:
            position = body_of(self.scenario.model.state, self.scenario.state).position
            level = len(position) < 3
            GeographicServer(self, self.options.frame, self._origin, level=level)

    def publish(self, time: int, belief: Gaussian) -> None:
        """Publish the belief at ``time``, in nanoseconds, once it knows all states."""
        if isinstance(belief, Diffuse):
            return
        if self.scenario.believed.places:
            belief = self.scenario.believed.own(belief)
        self._estimates.publish(time, belief)
        if self._transforms is not None:
            self._transforms(time, belief, self._fuser.fused_at)

    def publish_innovations(self, fused: Sequence[Reading], most: int | None = None) -> None:
        """Publish the innovations of readings, of more than ``most`` the newest ones."""
        corrected = self._fuser.judge(fused)
        for reading in corrected[0 if most is None else -most :]:
            self._fuser.channels[reading.source].publish(reading.time, reading.correction)

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return the options of the filter."""
        return estimator_extra(chosen)

    def _has_transforms(self, without: str) -> bool:
        """Return whether there are messages of transforms; warn what is ``without`` them."""
        lacking = transforms.why_none()
        if lacking:
            self.get_logger().warning(f'{without}: {lacking}')
        return not lacking

    def _answer_as_robot_localization(self, take_pose: Callable[[bytes], bool | None]) -> None:
        """Offer its services ``set_pose`` and ``toggle``, where its types are installed."""
        set_pose, toggle = service_type('SetPose'), service_type('ToggleFilterProcessing')

        def on_pose(request: Any, response: Any) -> Any:
            take_pose(bytes(serialize_message(request.pose)))
            return response

        def on_toggle(request: Any, response: Any) -> Any:
            response.status = request.on != self._fuser.fusing  # false if nothing changes
            self._on_toggle(SetBool.Request(data=request.on), SetBool.Response())
            return response

        for kind, name, answer in ((set_pose, 'set_pose', on_pose), (toggle, 'toggle', on_toggle)):
            if kind is not None:
                self.create_service(kind, name, answer)

    def _take_belief(
        self, topic: str, kind: Any, read: Callable[[bytes, Gaussian, Frames | None], Gaussian]
    ) -> Callable[[bytes], bool | None]:
        """Restart from the beliefs that a topic brings; return what takes a message of it."""
        name = topic.rpartition('/')[2]

        def take(data: bytes, frames: Frames | None = None) -> bool | None:
            try:
                belief = read(data, self.scenario.believed.initial, frames)
                check_start(replace(self._estimation, initial=belief), self.scenario)
            except ForeignFrameError as error:
                if frames is not None:
                    return None
                return self._look_for_frame(partial(take, data), f'{name}: {error}')
            except OthersPoseError as error:
                self.get_logger().info(f'{name}: {error}', throttle_duration_sec=1.0)
                return True
            except ValueError as error:
                self._fuser.warn(f'{name}: {error}')
                return None if frames is None else False
            self._finder.stop()  # of two that were sent the later one counts
            self._fuser.reset(belief)
            self.diagnostics.soon()
            self.get_logger().info(f'reset to {name}', throttle_duration_sec=1.0)
            return True

        def on_message(data: bytes) -> None:
            # of those that wait only the last one counts, and a flood must hold up nothing else
            self.intake.newest(subscription.topic_name, take, waiting(subscription, [data]))

        subscription = self.create_subscription(kind, topic, on_message, QUEUE, raw=True)
        return take

    def _look_for_frame(self, take: Callable[[Frames], bool | None], refusal: str) -> bool | None:
        """Have a pose taken once its frame is known; return true, or None if it is refused."""
        lacking = transforms.why_none() or self._finder.find(
            lambda frames: take(frames) is not None, lambda: self._fuser.warn(refusal)
        )
        if lacking:
            self._fuser.warn(f'{refusal}; {lacking}')
            return None
        return True

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._fuser.reset(self.scenario.believed.initial)
        response.success, response.message = True, 'back at the initial belief'
        return response

    def _on_toggle(self, request: Any, response: Any) -> Any:
        self._fuser.fusing = request.data
        self.diagnostics.soon()
        response.success = True
        log = self.get_logger().info
        if request.data:  # two places: a throttle counts by place
            response.message = 'readings are fused'
            log(response.message, throttle_duration_sec=1.0)
        else:
            response.message = 'readings are not fused'
            log(response.message, throttle_duration_sec=1.0)
        return response

    def prepare(
        self, scenario: Scenario, options: EstimatorOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Change the model's parameters, noise or gates; the belief is kept."""
        if scenario is not self.scenario:
            observability(scenario)  # what no filter can follow is refused
        mounted = self._mounts.applied(scenario)
        estimation = fusion(mounted, options, extra, wait=options.lockstep)
        pairs = zip(scenario.initial_belief, self.scenario.initial_belief)
        if not all(np.array_equal(new, old) for new, old in pairs):
            check_start(estimation, mounted)

        def apply() -> None:
            self._estimation = estimation
            self._fuser.configure(mounted, estimation)
            self._mounts.configure(scenario)
            self._changeover.when_compiled(estimation.pending)

        return apply

    def _use_before_next(self, scenario: Scenario) -> None:
        """Use a mounting before readings are fused: of several in a batch, all at once."""
        self._fuser.before_next = partial(self._use, scenario)

    def _use(self, scenario: Scenario) -> None:
        """Continue with a sensor whose mounting is known now, or with what is compiled now."""
        estimation = fusion(scenario, self.options, self.extra, wait=self.options.lockstep)
        self._estimation = estimation
        self._fuser.configure(scenario, estimation)
        self._changeover.when_compiled(estimation.pending)

    def _on_static(self, data: bytes) -> None:
        self.intake.read(TF_STATIC, self._mounts.on_static, data)

    def report(self) -> Report:
        """Return the outcomes of the readings, and whether innovations scatter as expected."""
        lockstep = self.options.lockstep
        report = self._health.report(self.scenario, self._estimates.count, lockstep=lockstep)
        if not self.get_clock().now().nanoseconds:
            report = Level.WARN, 'use_sim_time: nothing is received on /clock', report[2]
        return report if self._transforms is None else self._transforms.report(*report)


def main() -> None:
    """Run the estimator."""
    runtime.main(EstimatorNode)
