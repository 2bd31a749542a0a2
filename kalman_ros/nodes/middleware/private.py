# SPDX-License-Identifier: Apache-2.0
"""Undocumented parts of rclpy, which no other module touches.

A new version of rclpy that changes one of these is met here.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.event_handler import QoSSubscriptionEventType, UnsupportedEventTypeError
from rclpy.impl import rcutils_logger
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.subscription import Subscription

#: The class of loggers.
Logger: Any = rcutils_logger.RcutilsLogger


def log_for_callers_of(path: str) -> None:
    """Have rclpy limit the rate of a message by the line that logs it, not by one of ``path``."""
    rcutils_logger._internal_callers.append(path)


def take(subscription: Any) -> tuple[bytes, dict[str, Any]] | None:
    """Return the next waiting message as bytes, with its numbers and times; None without one."""
    message: tuple[bytes, dict[str, Any]] | None = subscription.handle.take_message(
        subscription.msg_type, True
    )
    return message


def pass_on_with_number(subscription: Any, numbered: Callable[[int | None], object]) -> None:
    """Have the executor call ``pass_on`` of a subscription, after the number of the message."""

    def on_message(message: Any, info: dict[str, Any] | None = None) -> None:
        # the executor of events passes a pair where the others pass two arguments
        data, info = message if info is None else (message, info)
        numbered(info['publication_sequence_number'])
        subscription.pass_on(data)

    subscription.callback = on_message
    subscription._callback_type = Subscription.CallbackType.WithMessageInfo


def losses_of(subscription: Any) -> Any:
    """Return the event of messages that the middleware lost; None if it has none."""
    kind = QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST
    with suppress(UnsupportedEventTypeError), subscription.handle:
        return _rclpy.EventHandle(subscription.handle, kind)
    return None


def clock_handle(node: Any) -> Any:
    """Return the clock of a node, whose ``get_now`` makes no object of Python."""
    return node.get_clock().handle


def wrap_transitions(node: Any, answer: Callable[..., Any]) -> None:
    """Have ``answer`` called with the callback of a managed node's service of transitions."""
    service = node._service_change_state
    service.callback = partial(answer, service.callback)


def release_state_machine(node: Any) -> None:
    """Release the state machine of a managed node, which is destroyed.

    It holds the node of rcl, and with it the middleware's threads. rclpy keeps it until the
    process exits, where they would use what the process has destroyed by then.
    """
    node._state_machine = None


def is_of_rclpy(error: Exception) -> bool:
    """Return whether rcl raised an error; it has separate ones for names and parameter files."""
    return type(error).__module__.startswith(('rclpy', '_rclpy', 'rpyutils'))
