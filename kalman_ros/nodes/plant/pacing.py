# SPDX-License-Identifier: Apache-2.0
"""When a simulated plant steps: by a clock, or by the answers of the other nodes."""

from __future__ import annotations

from typing import Any

#: Simulated time starts here: ROS takes a stamp of zero for "not set".
FIRST_STAMP = 1_000_000_000
#: A plant that is more than this many steps early or late resumes from the clock.
MOST_BEHIND = 100


class RealTime:
    """Steps on a steady clock, or on simulated time, and counts late steps.

    A step is taken at its end: its input is the last one received during it, which responds to the
    readings at its beginning. It counts as missed when it is taken after the end of the next one.
    When the clock jumps, or the plant is far behind, it resumes from the clock, with stamps of the
    current time. While simulated time is paused, so is the plant.
    """

    def __init__(self, plant: Any) -> None:
        clock = plant.get_clock()
        self.first_stamp: int = clock.now().nanoseconds
        self.missed = 0
        self._plant: Any = plant
        self._next: int | None = None
        self._clock = clock if clock.ros_time_is_active else plant.steady
        self._timer = plant.create_timer(plant.period, self._fire, clock=self._clock)

    def _fire(self) -> None:
        plant = self._plant
        now = self._clock.now().nanoseconds
        period = round(plant.period * 1e9)
        if self._next is not None and abs(now - self._next) > MOST_BEHIND * period:
            self.missed += max(0, (now - self._next) // period)
            self._next = None
        if self._next is None:
            if plant.elapsed <= plant.run_until and plant.may_begin:
                # stamps are the time, also after a pause: the time for which the timer was set, or
                # all that follow would be ahead by the delay of this call
                late = period - (self._timer.time_until_next_call() or 0)
                late = min(max(late, 0), period)
                time: int = plant.get_clock().now().nanoseconds - late
                plant.origin = time - round(plant.elapsed * 1e9)
                plant.publish_step()
                self._next = now - late + period
            return
        self.missed += max(0, (now - self._next) // period)
        # the timer itself may be slightly early
        while self._next <= now + period // 2:
            plant.step()
            self._next += period
            if plant.elapsed > plant.run_until + 1e-9:
                self._next = None
                return
            plant.publish_step()

    def close(self) -> None:
        """Stop; the timer ends with the state of the node."""

    def answered(self) -> None:
        """Do nothing: the clock does not wait for answers."""

    def confirm(self, time: int) -> None:
        """Do nothing: the clock does not wait for the recorder."""

    def changed(self) -> None:
        """Do nothing: the timer reads ``run_until`` anyway."""

    #: It never waits for other nodes.
    held = False

    def trouble(self) -> str:
        """Return '': it never waits for other nodes."""
        return ''


class Lockstep:
    """Steps when the input of this step is received; reports nodes that do not answer in time.

    After half of the timeout it asks again, and subscribes to the estimate from then on, to know
    which node is late. Where answers have no stamp, two answers to one step look like answers to
    two steps, so after asking again it steps only when no further answer arrives in that time.

    With a ``window`` it is never ahead of the step that the recorder confirmed last by more than
    that: writers keep the messages of these steps, so nothing is lost while the recorder gets no
    processor time.

    Parameters
    ----------
    plant
        The plant's node.
    estimate
        Topic and message type of the estimate.
    timeout
        Seconds after which missing answers are reported, repeatedly.
    window
        Steps that the recorder may lag behind; 0 without a recorder.
    stamped
        Whether answers have the stamp of their step.
    """

    first_stamp = FIRST_STAMP
    missed = 0

    def __init__(
        self,
        plant: Any,
        estimate: tuple[str, Any],
        timeout: float,
        window: int = 0,
        *,
        stamped: bool = True,
    ) -> None:
        self._plant: Any = plant
        self._ahead = round(window * plant.period * 1e9) if window else None
        self._confirmed = FIRST_STAMP
        self._held_since: int | None = None
        self._stamped = stamped
        self._asked_again = False
        self._answered_at: int | None = None
        self._estimate = estimate
        self._timeout = timeout
        self._asked_at: int | None = None
        self._silent_since: int | None = None
        self._late = 0
        self._listener: Any = None
        self._estimated = False
        self._timer = plant.create_timer(0.05, self._watch, clock=plant.steady)
        self._matching_since: int | None = None

    def _ask(self) -> None:
        """Publish the step, unless the plant is to pause before it."""
        plant = self._plant
        if plant.elapsed > plant.run_until + 1e-9:
            self._asked_at = None
            return
        self._asked_at = now = plant.steady.now().nanoseconds
        if self._ahead is not None and plant.stamp - self._confirmed > self._ahead:
            self._held_since = self._held_since or now
            return
        self._held_since = None
        plant.publish_step()

    @property
    def held(self) -> bool:
        """Whether only the recorder is missing."""
        return self._held_since is not None

    def confirm(self, time: int) -> None:
        """Record that all up to the step at ``time`` is recorded: published, and not retracted."""
        self._confirmed = max(self._confirmed, min(time, self._plant.stamp))
        if self._held_since is not None:
            self._resume()
            self._ask()

    def close(self) -> None:
        """Destroy the subscription."""
        if self._listener is not None:
            self._plant.destroy_subscription(self._listener)

    def answered(self) -> None:
        """Step, now that all required answers are received."""
        plant = self._plant
        if self._asked_at is None or self._held_since is not None:
            return
        if self._asked_again and not self._stamped:
            self._answered_at = plant.steady.now().nanoseconds
            return
        self._go_on()

    def _go_on(self) -> None:
        self._asked_again, self._answered_at = False, None
        if self._silent_since is not None:
            self._resume()
        self._plant.step()
        self._ask()

    def changed(self) -> None:
        """Resume if ``run_until`` now allows it."""
        if self._asked_at is None and self._matching_since is not None:
            self._ask()

    def _watch(self) -> None:
        plant = self._plant
        now = plant.steady.now().nanoseconds
        if self._asked_at is None:
            if plant.elapsed <= plant.run_until + 1e-9 and self._matched(now):
                self._ask()
            return
        patience = 0.5e9 * self._timeout
        if self._held_since is not None:
            self._report_late(now, self._held_since)
        elif self._answered_at is not None:
            if now - self._answered_at >= patience:
                self._go_on()
        elif now - self._asked_at >= patience:
            if self._silent_since is None:
                self._silent_since = self._asked_at
                topic, kind = self._estimate
                self._listener = plant.create_subscription(kind, topic, self._on_estimate, 10)
            self._report_late(now, self._silent_since)
            self._asked_again = True
            self._ask()

    def _report_late(self, now: int, since: int) -> None:
        """Report, once per timeout, which nodes are late ``since`` then."""
        if now - since > (self._late + 1) * self._timeout * 1e9:
            self._late += 1
            self._plant.get_logger().error(self.trouble())
            self._plant.diagnostics.publish()

    def _on_estimate(self, _: Any) -> None:
        self._estimated = True

    def _resume(self) -> None:
        if self._late:
            self._plant.get_logger().info('lockstep continues')
        self.close()
        self._listener = None
        self._silent_since, self._late, self._estimated = None, 0, False

    def _matched(self, now: int) -> bool:
        """Return whether all nodes that must answer, or at least the certain ones, are there."""
        if not self._plant.endpoints_matched(every_sensor=False):
            self._matching_since = None
            return False
        if self._matching_since is None:
            self._matching_since = now
        return self._plant.endpoints_matched(every_sensor=True) or (
            now - self._matching_since > 1_000_000_000
        )

    def trouble(self) -> str:
        """Return which node did not answer, or ''."""
        if not self._late:
            return ''
        if self._held_since is not None:
            return (
                f'step {self._plant.steps} is further ahead than lockstep_window allows: the '
                f'recorder has not confirmed for {self._late * self._timeout:g} s; waiting for it'
            )
        who, what = ('controller', 'force') if self._estimated else ('estimator', 'estimate')
        return (
            f'no {what} for step {self._plant.steps} within {self._late * self._timeout:g} s: '
            f'the {who} did not answer; asking again'
        )
