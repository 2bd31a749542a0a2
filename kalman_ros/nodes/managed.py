# SPDX-License-Identifier: Apache-2.0
"""Managed nodes: what exists in which state, and why a transition is refused."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from traceback import format_exception
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from .published import PublishedCounts, counted

#: The most characters of a reason.
_LONGEST = 500
UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'


class ManagedNode(LifecycleNode):  # type: ignore[misc]
    """A node with the states of a managed node, whose entities live as long as a state does.

    Publishers, subscriptions, timers and services that are created in `configure` are destroyed
    at cleanup, and those created in `activate` when it is deactivated. So an inactive node
    receives nothing that it could act upon later, and an active one pays nothing for it. What an
    executor still has queued for them by then is not delivered.

    Parameters
    ----------
    name
        Of the node, unless it is remapped.
    """

    def __init__(self, name: str) -> None:
        #: The state that it is in.
        self.phase = UNCONFIGURED
        #: Why the last transition was refused, in one line; '' if it was not.
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
        #: Of each topic, how many messages it has published.
        self.published = PublishedCounts(self)
        change_state = self._service_change_state
        change_state.callback = partial(self._on_change_state, change_state.callback)

    def configure(self) -> None:
        """Read and check everything, and create what lasts until cleanup.

        Raises
        ------
        ValueError
            If anything is wrong; the node stays unconfigured.
        """

    def activate(self) -> None:
        """Create what lasts until the node is deactivated: whatever makes it act."""

    def deactivate(self) -> None:
        """Publish what is to be published before the node is silent.

        It is called however the active state ends, by an error too, before anything is destroyed.
        """

    def start(self) -> None:
        """Configure and activate.

        Raises
        ------
        Exception
            What prevented it; ValueError if the parameters did.
        """
        self._starting = True
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() is not TransitionCallbackReturn.SUCCESS:
                assert self._error is not None
                raise self._error
        self._starting = False

    def at_the_end(self, undo: Callable[..., object], *arguments: Any) -> None:
        """Have a function called when the state ends that is being entered, in reverse order."""
        assert self._entering is not None
        self._entering.callback(undo, *arguments)

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        """Create a publisher that lives as long as the state that is being entered."""
        created = counted(super().create_publisher(*arguments, **options))
        return self._until_the_end(created, self.destroy_publisher)

    def create_subscription(self, *arguments: Any, **options: Any) -> Any:
        """Create a subscription that lives as long as the state that is being entered."""
        created = super().create_subscription(*arguments, **options)
        return self._until_the_end(created, self.destroy_subscription, _mute)

    def create_timer(self, *arguments: Any, **options: Any) -> Any:
        """Create a timer that lives as long as the state that is being entered."""
        created = super().create_timer(*arguments, **options)
        return self._until_the_end(created, self.destroy_timer, _mute)

    def create_service(self, *arguments: Any, **options: Any) -> Any:
        """Create a service that lives as long as the state that is being entered."""
        created = super().create_service(*arguments, **options)
        return self._until_the_end(created, self.destroy_service)

    def _until_the_end(self, entity: Any, *undo: Callable[[Any], object]) -> Any:
        # what is created between transitions, by rclpy for one, takes care of itself
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
        """Go back to unconfigured after a transition that broke off."""
        while self._lifetimes:
            self._leave(UNCONFIGURED)
        return TransitionCallbackReturn.SUCCESS

    def rest(self) -> None:
        """Deactivate it if it is active, and destroy what its states have created."""
        self._close(FINALIZED)

    def destroy_node(self) -> None:
        """Bring it to rest, and give everything back."""
        self.rest()
        super().destroy_node()

    def _on_change_state(self, answer: Callable[..., Any], request: Any, response: Any) -> Any:
        """Say no to a transition that there is not in this state; in rclpy that ends the node."""
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
                # who starts a node reads its last line, who asks over topics reads its log
                self.get_logger().error(self.refusal or ''.join(format_exception(error)))
            kind = TransitionCallbackReturn
            return kind.FAILURE if self.refusal else kind.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _enter(self, create: Callable[[], None], phase: str) -> None:
        try:
            with ExitStack() as self._entering:
                create()
                if phase == ACTIVE:
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


def _mute(entity: Any) -> None:
    """Have nobody called by what an executor had queued when the entity was destroyed."""
    entity.callback = _do_nothing


def _do_nothing(*_: Any) -> None:
    pass


def reason(error: Exception) -> str:
    """Return in one line what a user did wrong; '' if the fault is not the user's.

    Of a long one, as that which quotes a long value, the middle is left out.
    """
    found = ''.join(map(_printable, _reason(error)))
    return found if len(found) <= _LONGEST else f'{found[: _LONGEST - 100]} ... {found[-90:]}'


def _printable(character: str) -> str:
    return character if character.isprintable() else ascii(character)[1:-1]


def _reason(error: Exception) -> str:
    if isinstance(error, ValueError):
        return str(error)
    if isinstance(error, (ArithmeticError, MemoryError)):
        return f'the parameters give no numbers to compute with: {error or type(error).__name__}'
    # rcl reports bad names and unreadable parameter files by exceptions of its own
    if type(error).__module__.startswith(('rclpy', '_rclpy', 'rpyutils')):
        return str(error).partition('\n')[0].partition(', at ')[0]
    return ''
