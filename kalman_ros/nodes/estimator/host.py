# SPDX-License-Identifier: Apache-2.0
"""The interface of the estimator's node to its parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from kalman_ros.core import Gaussian
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.reading import Reading
from kalman_ros.scenario import Scenario


class EstimatorHost(Host, Protocol):
    """The estimator's node, as its parts see it."""

    options: EstimatorOptions
    scenario: Scenario

    def publish(self, time: int, belief: Gaussian) -> None:
        """Publish the belief at ``time``, in nanoseconds."""
        ...

    def publish_innovations(self, fused: Sequence[Reading], most: int | None = None) -> None:
        """Publish the innovations of readings, of more than ``most`` the newest ones."""
        ...
