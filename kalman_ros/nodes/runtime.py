# SPDX-License-Identifier: Apache-2.0
"""What every node of the family does alike: start, say what is wrong, spin, and stop."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from kalman_ros.core import Option, Value, options_of, refuse_unknown
from kalman_ros.simulation import scenario
from kalman_ros.simulation.scenario import Scenario

from . import options as node_options
from . import parameters

#: How long a signal may wait to be noticed, in seconds.
_PATIENCE = 0.1


class ScenarioNode(Node):  # type: ignore[misc]
    """A node that is told a scenario and options of its own by parameters.

    Parameters
    ----------
    name
        Of the node, unless it is remapped.
    options
        The dataclass of the node's own options.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong; nothing runs then.
    """

    def __init__(self, name: str, options: type[Any]) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        given = parameters.given(self)
        self._own = {option.name: option for option in options_of(options)}
        self._extra = {option.name: option for option in self.extra_options(given)}
        self._build_options = options
        known = {**scenario.options(given), **self._own, **self._extra}
        refuse_unknown(given, {*known, *node_options.names()}, 'parameter')
        values = scenario.complete(given, known)
        parameters.declare(self, known.values(), values)
        self.scenario, self.options, self.extra = self._build(values)
        self._live = parameters.LiveParameters(self, known, self._prepare)

    def extra_options(self, given: Mapping[str, Value]) -> Iterable[Option]:
        """Return further options, which depend on what is ``given``; none by default."""
        return ()

    def _build(self, values: Mapping[str, Value]) -> tuple[Scenario, Any, dict[str, Value]]:
        own = {name: values[name] for name in self._own}
        extra = {name: values[name] for name in self._extra}
        return scenario.build(values), self._build_options(**own), extra

    def _prepare(self, values: dict[str, Value]) -> Callable[[], None]:
        built, options, extra = self._build(values)
        apply = self.prepare(built, options)

        def put_in_place() -> None:
            self.scenario, self.options, self.extra = built, options, extra
            apply()

        return put_in_place

    def prepare(self, scenario: Scenario, options: Any) -> Callable[[], None]:
        """Build what a changed scenario needs and return a function that puts it in place.

        Raises
        ------
        ValueError
            If it cannot be built; the node goes on as it was.
        """
        raise NotImplementedError


def main(build: Callable[[], Node]) -> None:
    """Run one node until SIGINT or SIGTERM; exit 1 with one line if it cannot start."""
    stop = Future()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set_result(None))
    try:
        # what rcl logs when a parameter file cannot be read is said below, once
        set_logger_level('rcl', LoggingSeverity.FATAL)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.INFO)
        node = build()
    except ValueError as error:
        sys.exit(f'{_program()}: {error}')
    except Exception as error:
        # rcl reports an unreadable parameter file by an exception type of its own
        if type(error).__module__.startswith(('rclpy', '_rclpy', 'rpyutils')):
            sys.exit(f'{_program()}: {_first_line(error)}')
        raise
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.done():
        # spin() of this executor neither waits properly nor notices signals; see its issues
        executor.spin_until_future_complete(stop, _PATIENCE)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


def _program() -> str:
    return sys.argv[0].rpartition('/')[2]


def _first_line(error: Exception) -> str:
    return str(error).partition('\n')[0].partition(', at ')[0]
