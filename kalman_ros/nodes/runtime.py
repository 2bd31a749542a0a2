# SPDX-License-Identifier: Apache-2.0
"""What every node of the family does alike: start, say what is wrong, spin, and stop."""

from __future__ import annotations

import gc
import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from kalman_ros import models, scenario
from kalman_ros.codecs.wire import learn_layouts
from kalman_ros.core import Option, Value, options_of, refuse_unknown
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.parameter_files import own_section

from . import names, parameters, topics
from .diagnostics import Diagnostics, Level, Report
from .file_arguments import hint, readable
from .interruption import Interruption
from .managed import ACTIVE, ManagedNode, reason
from .priority import take_priority
from .transport import prefer_sockets
from .usage import usage, wants_help
from .watcher import WatcherNode

#: How long the executor is left to itself, in seconds. A signal ends that at once; as each wait
#: leaves some 30 bytes behind, there should be few, and one without an end does not wait at all.
_PATIENCE = 3600.0


class ScenarioNode(WatcherNode, ManagedNode):
    """A managed node that is told a scenario and options of its own by parameters.

    Until it is configured, any parameter may be set and none is checked, but for those that name
    code: they stay as they were at the start. Which ones there are depends on the model. It
    configures and activates itself unless ``autostart`` is false.

    Parameters
    ----------
    name
        Of the node, unless it is remapped.
    options
        The dataclass of the node's own options.

    Raises
    ------
    ValueError
        If it is to start and a parameter is unknown or wrong; nothing runs then.
    """

    #: What it runs when it is told nothing.
    default_model = models.DEFAULT
    #: Whether it reads the control law and the cost.
    with_law = False
    _alone, _scheduling = False, 'normal'

    def __init__(self, name: str, options: type[Any]) -> None:
        super().__init__(name)
        self._kind, self._build_options = name, options
        parameters.free(self, parameters.given(self))
        self._code = parameters.CodeNames(self)
        self.diagnostics = Diagnostics(self, self._report_state)
        # a wrong value is told of by configure
        if parameters.given(self).get('autostart') is not False:
            self.start()

    def configure(self) -> None:
        """Build the scenario and the options from the parameters, and declare them all."""
        given = self._given()
        self._own = {option.name: option for option in options_of(self._build_options)}
        shared = scenario.options(given, with_law=self.with_law)
        chosen = {**{name: option.default for name, option in shared.items()}, **given}
        chosen['sensors'] = shared['sensors'].check(chosen['sensors'])  # one word is a list, too
        self._extra = {option.name: option for option in self.extra_options(chosen)}
        known = {**shared, **self._own, **self._extra}
        sensors = scenario.sensor_names(chosen['sensors'])
        names.check_kinds(shared, sensors)
        driven = 'input.topic' in shared
        refuse_unknown(given, {*known, *names.known(sensors, driven=driven)}, 'parameter')
        values = scenario.complete(given, known)
        self.scenario, self.options, self.extra = self._build(values)
        topics.check(self.scenario, self.get_name(), self.get_namespace())
        self.intake.longest = self.options.max_message_size
        learn_layouts(on=self.options.learn_layouts)
        self._code.trust(values)
        live = parameters.LiveParameters(self, known, values, self._prepare)
        self.at_the_end(live.close)

    def _given(self) -> dict[str, Any]:
        """Return the start-up parameters; if they name no model, with the default file's."""
        given = parameters.given(self)
        if 'model' in given:
            return given
        section = own_section(shipped.file(self.default_model), self._kind)
        return {'model': self.default_model, **section, **given}

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to active."""
        found = super().on_activate(state)
        self._prioritize()
        return found

    def own_process(self) -> None:
        """Take note that the process is this node's alone, so that it may go before others."""
        self._alone = True
        self._prioritize()

    def _prioritize(self) -> None:
        """Take the priority that is wanted in real time, if the system permits it."""
        if not self._alone or self.phase != ACTIVE:
            return
        # who only watches is in no hurry, and has no such option
        wanted = getattr(self.options, 'realtime_priority', 0)
        if wanted and not self.options.lockstep and take_priority(wanted):
            self._scheduling = f'real-time, priority {wanted}'

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; any may be set to the value that it has, read-only too."""
        wanted = [parameters.as_declared(self, parameter) for parameter in parameter_list]
        changed = [each for each in wanted if not parameters.is_kept(self, each)]
        if wanted and not changed:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changed)

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return further options, which depend on what is ``chosen``; none by default."""
        return ()

    def _build(self, values: Mapping[str, Value]) -> tuple[Scenario, Any, dict[str, Value]]:
        own = {name: values[name] for name in self._own}
        extra = {name: values[name] for name in self._extra}
        built = scenario.build(values, with_law=self.with_law)
        return built, self._build_options(**own), extra

    def _prepare(self, values: dict[str, Value]) -> Callable[[], None]:
        built, options, extra = self._build(values)
        apply = self.prepare(built, options, extra)

        def put_in_place() -> None:
            self.scenario, self.options, self.extra = built, options, extra
            self.intake.longest = options.max_message_size
            apply()

        return put_in_place

    def prepare(
        self, scenario: Scenario, options: Any, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Build what a changed scenario needs and return a function that puts it in place.

        Raises
        ------
        ValueError
            If it cannot be built; the node goes on as it was.
        """
        raise NotImplementedError

    def report(self) -> Report:
        """Return what is to be said of the node while it is active."""
        raise NotImplementedError

    def _report_state(self) -> Report:
        if self.phase == ACTIVE:
            level, message, values = self.report()
            return level, message, {**values, 'scheduling': self._scheduling}
        why = f': {self.refusal}' if self.refusal else ''
        return Level.WARN, f'{self.phase}{why}', {}


def main(build: Callable[[], ScenarioNode]) -> None:
    """Run one node until a signal asks for the end; exit 1 with one line if it cannot start.

    With ``--help`` among its arguments it only says what it is, and which parameters it has.
    """
    interruption = Interruption()
    try:
        # what rcl logs when a parameter file cannot be read is said below, once
        set_logger_level('rcl', LoggingSeverity.FATAL)
        prefer_sockets()
        with readable(sys.argv) as arguments:
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.INFO)
        if wants_help(sys.argv[1:]):
            set_logger_level('', LoggingSeverity.WARN)  # what it says once it runs
        elif len(rest := remove_ros_args(sys.argv)) > 1:
            raise ValueError(f"unknown argument '{rest[1]}'; parameters stand behind --ros-args")
        node = build()
    except Exception as error:
        if not reason(error):
            raise
        sys.exit(f'{_program()}: {hint(reason(error))}')
    try:
        if wants_help(sys.argv[1:]):
            print(usage(node))
        else:
            _spin(node, interruption)
    finally:
        interruption.ignore()
        node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: ScenarioNode, interruption: Interruption) -> None:
    """Let a node work until a signal comes, and bring it to rest before anything else."""
    executor = EventsExecutor()
    executor.add_node(node)
    node.own_process()
    # what was built lasts as long as the process: a full collection would look through all of it,
    # which takes tens of milliseconds in the midst of the work
    gc.freeze()
    # the first message that is logged makes `inspect` look at all modules, for as long as that
    inspect.getmodule(inspect.currentframe())
    try:
        while not interruption.asked.done():
            # spin() of this executor neither waits properly nor notices signals; see its issues
            executor.spin_until_future_complete(interruption.asked, _PATIENCE)
    finally:  # a model of a user's own may raise anything; the force goes to zero all the same
        interruption.ignore()
        # before the executor: it waits for its threads, which a busy machine may not let run
        node.rest()
        executor.shutdown()


def _program() -> str:
    return sys.argv[0].rpartition('/')[2]
