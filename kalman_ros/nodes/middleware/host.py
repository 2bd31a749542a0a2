# SPDX-License-Identifier: Apache-2.0
"""The interface of a node to its parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from kalman_ros.pipeline.intake import Intake

from .one_line_logger import OneLineLogger


class Host(Protocol):
    """A managed node, as its parts see it.

    What a part creates in `configure` or `activate` is destroyed with that state.
    """

    #: A clock that never jumps.
    steady: Any
    #: Its publishers, and its diagnostics.
    publishers: Any
    diagnostics: Any

    @property
    def intake(self) -> Intake:
        """Drops unreadable messages of every subscription."""
        ...

    def create_publisher(self, kind: Any, topic: str, queue: Any, /) -> Any:
        """Return a new publisher, which counts its messages."""
        ...

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., Any], queue: Any, /, **options: Any
    ) -> Any:
        """Return a new subscription; undecodable messages do not reach the callback."""
        ...

    def subscribe_in_batches(
        self, kind: Any, topic: str, callback: Callable[[bytes], None], queue: Any, /
    ) -> Any:
        """Return a new subscription to messages as they come."""
        ...

    def watch(self, kind: Any, topic: str, take: Callable[[bytes], None], queue: Any, /) -> Any:
        """Return a new subscription that is read now and then."""
        ...

    def resolve_topic_name(self, topic: str, /) -> str:
        """Return the full name of a topic."""
        ...

    def get_fully_qualified_name(self) -> str:
        """Return the name of the node with its namespace."""
        ...

    def get_publishers_info_by_topic(self, topic: str, /) -> Any:
        """Return the endpoints that publish on a topic, of all nodes."""
        ...

    def create_timer(self, seconds: float, callback: Callable[[], Any], /, **options: Any) -> Any:
        """Return a new timer."""
        ...

    def create_service(self, kind: Any, name: str, callback: Callable[..., Any], /) -> Any:
        """Return a new service."""
        ...

    def destroy_subscription(self, subscription: Any, /) -> Any:
        """Destroy a subscription."""
        ...

    def destroy_timer(self, timer: Any, /) -> Any:
        """Destroy a timer."""
        ...

    def get_clock(self) -> Any:
        """Return the clock of the node."""
        ...

    def get_logger(self) -> OneLineLogger:
        """Return the log of the node."""
        ...

    def at_the_end(self, action: Callable[[], Any], /) -> Any:
        """Have an action done when the present state ends."""
        ...
