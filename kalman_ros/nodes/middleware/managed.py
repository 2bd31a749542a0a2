# SPDX-License-Identifier: Apache-2.0
"""Managed nodes: entities that exist per state, and reasons why a transition is refused."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from traceback import format_exception
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from kalman_ros.core.one_line import one_line

from . import private
from .published import PublishedCounts, counted

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'


class ManagedNode(LifecycleNode):  # type: ignore[misc]
    """A node with the states of a managed node, whose entities live as long as a state does.

    Publishers, subscriptions, timers and services that are created in `configure` are destroyed
    at cleanup, and those created in `activate` when it is deactivated. So an inactive node
    receives nothing to act upon later, and an active one has no overhead. Callbacks that are
    still queued in an executor by then are not called.

    Parameters
    ----------
    name
        Of the node, unless it is remapped.
    """

    def __init__(self, name: str) -> None:
        #: The current state.
        self.phase = UNCONFIGURED
        #: Why the last transition was refused, in one line; '' if it was accepted.
        self.refusal = ''
        self._entering: ExitStack | None = None
        self._lifetimes: list[ExitStack] = []
        self._error: Exception | None = None
        self._starting = False
        super().__init__(
            name,
            allow_undeclared_parameters=True,
            automatically_declare_parameters_from_overrides=True,
        )
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        #: The number of messages published, by topic.
        self.published = PublishedCounts(self)
        private.wrap_transitions(self, self._on_change_state)

    def configure(self) -> None:
        """Read and check everything, and create the entities that last until cleanup.

        Raises
        ------
        ValueError
            If a parameter is wrong; the node stays unconfigured.
        """

    def activate(self) -> None:
        """Create the entities that last until the node is deactivated."""

    def accompany(self) -> None:
        """Create what an active node has whatever it does; nothing by default."""

    def deactivate(self) -> None:
        """Publish the last messages before the node is deactivated.

        It is called however the active state ends, also by an error, before anything is destroyed.
        """

    def start(self) -> None:
        """Configure and activate.

        Raises
        ------
        Exception
            Its cause; ValueError for wrong parameters.
        """
        self._starting = True
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() is not TransitionCallbackReturn.SUCCESS:
                assert self._error is not None
                raise self._error
        self._starting = False

    def at_the_end(self, undo: Callable[..., object], *arguments: Any) -> None:
        """Call a function when the state that is being entered ends, in reverse order."""
        assert self._entering is not None
        self._entering.callback(undo, *arguments)

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        """Create a publisher for the state that is being entered."""
        created = counted(super().create_publisher(*arguments, **options))
        return self._until_the_end(created, self.destroy_publisher)

    def create_subscription(self, *arguments: Any, **options: Any) -> Any:
        """Create a subscription for the state that is being entered."""
        created = super().create_subscription(*arguments, **options)
        return self._until_the_end(created, self.destroy_subscription, mute)

    def create_timer(self, *arguments: Any, **options: Any) -> Any:
        """Create a timer for the state that is being entered."""
        created = super().create_timer(*arguments, **options)
        return self._until_the_end(created, self.destroy_timer, mute)

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        """Create a service for the state that is being entered."""
        created = super().create_service(*arguments, **options)
        return self._until_the_end(created, self.destroy_service)

    def _until_the_end(self, entity: Any, *undo: Callable[[Any], object]) -> Any:
        # entities created between transitions, for example by rclpy, are not tracked
        if self._entering is not None:
            for function in undo:
                self.at_the_end(function, entity)
        return entity

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go from unconfigured to inactive."""
        return self._attempt(lambda: self._enter(self.configure, INACTIVE))

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to active."""
        return self._attempt(lambda: self._enter(self.activate, ACTIVE))

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go from active to inactive."""
        return self._attempt(lambda: self._leave(INACTIVE))

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to unconfigured."""
        return self._attempt(lambda: self._leave(UNCONFIGURED))

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go from any state to finalized."""
        return self._attempt(lambda: self._close(FINALIZED))

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured after a failed transition."""
        while self._lifetimes:
            self._leave(UNCONFIGURED)
        return TransitionCallbackReturn.SUCCESS

    def rest(self) -> None:
        """Deactivate the node if it is active, and destroy the entities of its states."""
        self._close(FINALIZED)

    def destroy_node(self) -> None:
        """Deactivate, clean up and destroy the node."""
        self.rest()
        super().destroy_node()
        private.release_state_machine(self)

    def _on_change_state(self, answer: Callable[..., Any], request: Any, response: Any) -> Any:
        """Refuse a transition that does not exist in this state; in rclpy that ends the node."""
        try:
            return answer(request, response)
        except Exception as error:
            if not reason(error):
                raise
            response.success = False
            return response

    def _attempt(self, transition: Callable[[], None]) -> TransitionCallbackReturn:
        self._error, self.refusal = None, ''
        try:
            transition()
        except Exception as error:
            self._error, self.refusal = error, reason(error)
            if not self._starting:
                # users of the command line read the last line, users of services the log
                words = self.refusal or ''.join(format_exception(error))
                for line in words.splitlines():
                    self.get_logger().error(line)
            kind = TransitionCallbackReturn
            return kind.FAILURE if self.refusal else kind.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _enter(self, create: Callable[[], None], phase: str) -> None:
        try:
            with ExitStack() as self._entering:
                create()
                if phase == ACTIVE:
                    self.accompany()
                    self.at_the_end(self.deactivate)
                self._lifetimes.append(self._entering.pop_all())
        finally:
            self._entering = None
        self.phase = phase

    def _leave(self, phase: str) -> None:
        self.phase = phase
        self._lifetimes.pop().close()

    def _close(self, phase: str) -> None:
        while self._lifetimes:
            self._leave(phase)
        self.phase = phase


def mute(entity: Any) -> None:
    """Suppress callbacks that an executor had queued when the entity was destroyed."""
    entity.callback = _do_nothing


def _do_nothing(*_: Any) -> None:
    pass


def reason(error: Exception) -> str:
    """Return in one line what a user did wrong; '' if it is not the user's error."""
    return one_line(_reason(error))


def _reason(error: Exception) -> str:
    if isinstance(error, ValueError):
        return str(error)
    if isinstance(error, (ArithmeticError, MemoryError)):
        return f'the parameters give no numbers to compute with: {error or type(error).__name__}'
    if private.is_of_rclpy(error):
        return str(error).partition('\n')[0].partition(', at ')[0]
    return ''
