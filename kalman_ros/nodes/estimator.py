# SPDX-License-Identifier: Apache-2.0
"""The estimator: readings and forces in, the state with its covariance out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from std_srvs.srv import Trigger

from kalman_ros.analysis.observability import observability
from kalman_ros.core import Gaussian, Option, Value
from kalman_ros.estimators import filter_options
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.scenario import Scenario

from . import runtime
from .diagnostics import Report
from .estimate_publisher import EstimatePublisher
from .estimator_health import Health
from .estimator_intake import LockstepIntake, RealTimeIntake
from .fuser import Fuser
from .fusion import check_start, fusion
from .idle import idle_input
from .initial_pose import PoseReader
from .meters import Latency
from .options import EstimatorOptions
from .topics import QUEUE

#: The lowest rate of publication, in Hz, other than none.
_SLOWEST = 1e-3


class EstimatorNode(runtime.ScenarioNode):
    """Feeds an `OnlineEstimator` from topics and publishes what it believes."""

    def __init__(self) -> None:
        super().__init__('estimator', EstimatorOptions)

    def configure(self) -> None:
        """Build the filter, and what it reads and publishes."""
        super().configure()
        scenario, options = self.scenario, self.options
        if 0.0 < options.publish_rate < _SLOWEST:
            expected = f'0 or at least {_SLOWEST:g} Hz'
            raise ValueError(f'publish_rate: expected {expected}, got {options.publish_rate:g}')
        found = fusion(scenario, options, self.extra)
        # this also imports what the first step needs, which takes longer than a step
        check_start(found.filter, scenario)
        idle = idle_input(scenario.model, options.idle_input)
        seen = observability(scenario)
        self._online = OnlineEstimator(
            found.filter, found.sensors, scenario.initial_belief, idle, found.policy
        )
        self._publish = EstimatePublisher(self, scenario, options.frame, options.child_frame)
        self._read_pose = PoseReader(scenario)
        self._latency = Latency()
        self._fuser = Fuser(self, scenario, self._online)
        self._health = Health(self._fuser, self._latency, self.get_logger().warning)
        self.get_logger().info(str(seen))  # now that nothing is refused any more

    def activate(self) -> None:
        """Start from the initial belief and subscribe.

        An earlier belief is of no use: the inputs in the meantime are not known.
        """
        self._fuser.reset(self.scenario.initial_belief)
        if self.options.lockstep:
            LockstepIntake(self, self._fuser)
        else:
            RealTimeIntake(self, self._fuser, self._latency)
        pose = self._read_pose.message_type
        self.create_subscription(pose, 'initialpose', self._on_initial_pose, QUEUE, raw=True)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def publish(self, time: int, belief: Gaussian) -> None:
        """Publish the belief at ``time``, in nanoseconds."""
        self._publish(time, belief)

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return the options of the filter."""
        implementation = str(chosen.get('implementation', 'native'))
        return filter_options(str(chosen['filter']), implementation)

    def _on_initial_pose(self, data: bytes) -> None:
        try:
            belief = self._read_pose(data, self.scenario.initial_belief)
        except ValueError as error:
            self._fuser.warn(f'initialpose: {error}')
            return
        self._fuser.reset(belief)
        self.get_logger().info('reset to initialpose')

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._fuser.reset(self.scenario.initial_belief)
        response.success, response.message = True, 'back at the initial belief'
        return response

    def prepare(
        self, scenario: Scenario, options: EstimatorOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Change the model's parameters, noise or gates; the belief stays."""
        found = fusion(scenario, options, extra)
        observability(scenario)  # what no filter can follow is refused

        def apply() -> None:
            self._online.configure(found.filter, found.sensors, found.policy)
            self._fuser.observability.configure(scenario)

        return apply

    def report(self) -> Report:
        """Return the outcomes of the readings, and whether innovations scatter as expected."""
        lockstep = self.options.lockstep
        return self._health.report(self.scenario, self._publish.count, lockstep=lockstep)


def main() -> None:
    """Run the estimator."""
    runtime.main(EstimatorNode)
