# SPDX-License-Identifier: Apache-2.0
"""The only publisher of the input topic: rate-limited by the wall clock, and closed when idle."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

from rclpy.duration import Duration

from kalman_ros.control.limiter import Limiter
from kalman_ros.core import Array, is_finite
from kalman_ros.scenario.idle import idle_name

#: A pause between two inputs counts for at most this many seconds, or one period: after it
#: the input must not jump by all that the rate limit would have allowed meanwhile.
_LONGEST_PAUSE = 0.1
#: The longest time in seconds to reach the idle input when the output closes.
_LONGEST_RAMP = 0.5
#: The longest interval in seconds between two inputs on that way, or one period.
_RAMP_STEP = 0.02
#: How long subscribers may take to acknowledge the last input, and to request what they missed,
#: before the publisher is destroyed. Below the five seconds after which ``ros2 launch`` insists.
_DELIVERY = Duration(seconds=2.0)


class OutputStage:
    """Publishes inputs within limits; after `close` nothing, until it is opened again.

    A node that stops acting, for any reason, closes it. The input then goes to idle, within the
    rate limit unless that takes longer than half a second, and the last message is exactly the
    idle input. It starts closed.

    Parameters
    ----------
    publisher
        Of the input topic, used exclusively here.
    write
        Returns the message for a stamp, in nanoseconds, and an input (m,).
    limiter
        Holds the limits and the idle input.
    period
        Seconds between two inputs.
    simulated
        Whether stamps define time, as in lockstep; otherwise they are ignored.
    """

    def __init__(
        self,
        publisher: Any,
        write: Callable[[int, Array], Any],
        limiter: Limiter,
        period: float,
        *,
        simulated: bool,
    ) -> None:
        self._publisher, self._write, self._limiter = publisher, write, limiter
        self._period, self._simulated = period, simulated
        self._longest = max(_LONGEST_PAUSE, period)
        self._closed = True
        self._at = monotonic()
        #: The stamp of the last input, None before the first.
        self.stamp: int | None = None
        #: The number of inputs published.
        self.count = 0

    @property
    def value(self) -> Array:
        """The last published input (m,); the idle one before the first."""
        return self._limiter.value

    @property
    def idle_name(self) -> str:
        """What the idle input is."""
        return idle_name(self._limiter.idle)

    @property
    def at_idle(self) -> bool:
        """Whether the last input was the idle one."""
        return self._limiter.at_idle

    @property
    def listeners(self) -> int:
        """The number of connected subscribers."""
        return int(self._publisher.get_subscription_count())

    @property
    def limited(self) -> int:
        """The number of inputs that a limit has changed."""
        return int(self._limiter.limited)

    @property
    def closed(self) -> bool:
        """Whether publishing is disabled."""
        return self._closed

    def open(self) -> None:
        """Publish commands from now on."""
        if self._closed:
            self._closed = False
            self._at, self.stamp = monotonic(), None

    def command(self, stamp: int, wanted: Array) -> Array:
        """Publish the reachable input closest to ``wanted`` (m,), or to idle if not finite."""
        if self._closed:
            return self.value
        if not is_finite(wanted):
            return self.release(stamp)
        self._limiter.toward(wanted, self._elapsed(stamp))
        return self._publish(stamp)

    def release(self, stamp: int) -> Array:
        """Publish the reachable input closest to idle, and return it."""
        if self._closed:
            return self.value
        self._limiter.toward_idle(self._elapsed(stamp))
        return self._publish(stamp)

    def close(self, stamp: Callable[[], int]) -> None:
        """Bring the input to idle and then publish nothing.

        Parameters
        ----------
        stamp
            Returns the stamp of each input on the way.
        """
        if self._closed:
            return
        self._closed = True
        step, end = min(self._period, _RAMP_STEP), monotonic() + _LONGEST_RAMP
        while not self.at_idle:
            now = monotonic()
            if now < end:
                self._limiter.toward_idle(min(now - self._at, self._longest))
            else:
                self._limiter.jump_to_idle()
            self._publish(stamp())
            if not self.at_idle:
                sleep(step)

    def deliver(self) -> None:
        """Wait, for a limited time, until all published messages have arrived.

        Call it before the publisher is destroyed, which discards undelivered messages.
        """
        if self.count:
            self._publisher.wait_for_all_acked(_DELIVERY)

    def _elapsed(self, stamp: int) -> float:
        """Return the seconds since the last input that count for the rate limit."""
        if not self._simulated:
            since = monotonic() - self._at
        elif self.stamp is None or stamp < self.stamp:
            since = self._period
        else:
            since = (stamp - self.stamp) * 1e-9
        return min(since, self._longest)

    def _publish(self, stamp: int) -> Array:
        self._publisher.publish(self._write(stamp, self.value))
        self.count += 1
        # afterwards, so that the time between two messages is never shorter than assumed
        self.stamp, self._at = stamp, monotonic()
        return self.value
