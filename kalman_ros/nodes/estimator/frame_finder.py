# SPDX-License-Identifier: Apache-2.0
"""A look at the transforms of others, for as long as something waits for one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from kalman_ros.codecs.messages import message_type
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.managed import mute, reason
from kalman_ros.nodes.middleware.topics import STATIC, TRANSFORMS
from kalman_ros.pipeline.frames import STATIC as TF_STATIC
from kalman_ros.pipeline.frames import TF, Frames
from kalman_ros.pipeline.transforms import TYPE

#: Seconds after which a transform that was not received is given up.
_PATIENCE = 2.0


class FrameFinder:
    """Subscription to ``/tf`` and ``/tf_static`` that lasts until a transform is found.

    An estimator seldom needs one, and those of a whole robot would cost it all the time.

    Parameters
    ----------
    node
        The estimator's node.
    """

    def __init__(self, node: Host) -> None:
        self._node = node
        self._entities: list[tuple[Callable[[Any], Any], Any]] = []
        self._frames = Frames()
        self._then: Callable[[Frames], object] = id

    def find(self, then: Callable[[Frames], object], otherwise: Callable[[], object]) -> str:
        """Call ``then`` with what is known of frames after each message until it returns true.

        Where it does not within 2 s, call ``otherwise``. An earlier search ends. Returns why there
        can be no search, as where SROS 2 does not allow it, '' if there is one.

        Raises
        ------
        ValueError
            If ``tf2_msgs`` is not installed.
        """
        kind, node = message_type(TYPE), self._node
        self.stop()
        self._then, self._frames = then, Frames()
        try:
            for topic, queue in ((TF_STATIC, STATIC), (TF, TRANSFORMS)):
                take = partial(self._on_tf, topic)
                subscription = node.create_subscription(kind, topic, take, queue, raw=True)
                self._entities.append((node.destroy_subscription, subscription))
        except Exception as error:
            self.stop()
            why = reason(error)
            if not why:
                raise
            return why

        def end() -> None:
            self.stop()
            otherwise()

        timer = node.create_timer(_PATIENCE, end, clock=node.steady)
        self._entities.append((node.destroy_timer, timer))
        return ''

    def stop(self) -> None:
        """End the search."""
        while self._entities:
            destroy, entity = self._entities.pop()
            mute(entity)  # an executor may have queued it
            destroy(entity)

    def _on_tf(self, topic: str, data: bytes) -> None:
        add = partial(self._frames.add, moving=topic == TF)
        self._node.intake.read(topic, add, data)
        if self._then(self._frames):
            self.stop()
