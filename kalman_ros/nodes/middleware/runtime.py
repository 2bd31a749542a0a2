# SPDX-License-Identifier: Apache-2.0
"""The common part of all nodes: start, report errors, spin and stop."""

from __future__ import annotations

import faulthandler
import gc
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
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
from kalman_ros.core import Option, Value
from kalman_ros.pipeline.settings import Chosen, choose
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.parameter_files import own_section

from . import bond, parameters, topics
from .diagnostics import Diagnostics, Level, Report
from .file_arguments import hint, overruled, readable
from .interruption import Interruption
from .managed import ACTIVE, UNCONFIGURED, ManagedNode, reason
from .priority import take_priority
from .transport import prefer_sockets
from .usage import usage, wants_help
from .watcher import WatcherNode

#: The timeout of the executor's wait, in seconds. A signal ends it at once; each wait leaks 30
#: bytes, so there should be few, and one without a timeout does not wait at all.
_PATIENCE = 3600.0
#: How long the end of a node may take, in seconds.
_END = 10.0


class ScenarioNode(WatcherNode, ManagedNode):
    """A managed node whose parameters are a scenario and its own options.

    Until it is configured, any parameter may be set and none is checked except those that name
    code: they are fixed at the start. The set of parameters depends on the model. It
    configures and activates itself unless ``autostart`` is false.

    Parameters
    ----------
    name
        Of the node, unless it is remapped.
    options
        The dataclass of the node's options.

    Raises
    ------
    ValueError
        If it starts with an unknown or wrong parameter.
    """

    #: The default scenario.
    default_model = models.DEFAULT
    #: Whether it uses the control law and the cost.
    with_law = False
    _alone, _scheduling = False, 'normal'
    _live: parameters.LiveParameters | None = None

    def __init__(self, name: str, options: type[Any]) -> None:
        super().__init__(name)
        #: The options of the configured node, by name.
        self.known: Mapping[str, Option] = {}
        self._kind, self._build_options = name, options
        parameters.harden(self)
        #: The number of parameters that arguments and parameter files have for this node.
        self.given_count = len(parameters.given(self))
        parameters.free(self, parameters.given(self))
        self._code = parameters.CodeNames(self)
        self.diagnostics = Diagnostics(self, self._report_state)
        # configure reports a wrong value
        if parameters.given(self).get('autostart') is not False:
            self.start()

    def configure(self) -> None:
        """Build the scenario and the options from the parameters, and declare them all."""
        chosen = self._choose(self._with_model(parameters.given(self)))
        self.known = chosen.known
        shared = _of(chosen.shared, chosen.values)
        self.scenario = scenario.assemble(shared, with_law=self.with_law)
        self.options, self.extra = self._own_options(chosen)
        topics.check(self.scenario, self.get_name(), self.get_namespace())
        self.intake.longest = self.options.max_message_size
        learn_layouts(on=self.options.learn_layouts)
        self._code.accept(chosen.values)
        live = parameters.LiveParameters(self, chosen, self._prepare, self._choose_again)
        self.at_the_end(live.close)
        self._live = live

    def _with_model(self, given: Mapping[str, Value]) -> dict[str, Value]:
        """Return start-up parameters; if they name no model, with those of the default file."""
        if 'model' in given:
            return {**given}
        section = own_section(shipped.file(self.default_model), self._kind)
        return {'model': self.default_model, **section, **given}

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go from inactive to active."""
        outcome = super().on_activate(state)
        self._prioritize()
        return outcome

    def accompany(self) -> None:
        """Create the bond with a manager, which there is if the node does not start alone."""
        if parameters.given(self).get('autostart') is False and bond.has_type():
            bond.Bond(self, self.get_name())

    def own_process(self) -> None:
        """Record that this node owns the process, so that it may raise its priority."""
        self._alone = True
        self._prioritize()

    def _prioritize(self) -> None:
        """Set the requested priority in real time, if the system permits it."""
        if not self._alone or self.phase != ACTIVE:
            return
        # the monitor has no such option
        wanted = getattr(self.options, 'realtime_priority', 0)
        if wanted and not self.options.lockstep and take_priority(wanted):
            self._scheduling = f'real-time, priority {wanted}'

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; the current value is accepted, also for read-only ones."""
        wanted = [parameters.as_declared(self, parameter) for parameter in parameter_list]
        changed = [parameter for parameter in wanted if not parameters.is_kept(self, parameter)]
        if wanted and not changed:
            return SetParametersResult(successful=True)
        is_shaping = any(parameter.name in parameters.SHAPING for parameter in changed)
        if self._live is not None and self.phase != UNCONFIGURED and is_shaping:
            new = {
                parameter.name: parameter.value
                for parameter in changed
                if not self.has_parameter(parameter.name)
            }
            self._live.follow(new)
            changed = [parameter for parameter in changed if parameter.name not in new]
        try:
            return super().set_parameters_atomically(changed)
        finally:
            if self._live is not None:
                self._live.follow({})

    def parameter_error(self, parameter: Parameter) -> str:
        """Return why a parameter cannot be set, whatever the others are; '' if it can."""
        live = self._live
        return (
            '' if live is None or self.phase == UNCONFIGURED else live.parameter_error(parameter)
        )

    def extra_options(self, chosen: Mapping[str, Value]) -> Iterable[Option]:
        """Return further options, which depend on the ``chosen`` ones; none by default."""
        return ()

    def _own_options(self, chosen: Chosen) -> tuple[Any, dict[str, Value]]:
        """Return the node's options, as the dataclass of them, and the extra ones."""
        values = chosen.values
        return self._build_options(**_of(chosen.own, values)), _of(chosen.extra, values)

    def _choose(self, given: Mapping[str, Value]) -> Chosen:
        return choose(given, self._build_options, self.extra_options, with_law=self.with_law)

    def _choose_again(
        self, given: Mapping[str, Value], later: Mapping[str, Value], changes: Mapping[str, Value]
    ) -> Chosen:
        """Return the parameters after a change by which there are others.

        Those that have been set, but do not exist with it, are set aside.
        """
        from kalman_ros.scenario import law  # only nodes with a law come here, and have it

        shaping = {name: value for name, value in changes.items() if name in parameters.SHAPING}
        start = law.kept({**self._with_model(given), **shaping})
        known = self._choose(start).known
        since = {name: value for name, value in later.items() if name in known}
        return self._choose({**start, **since, **changes})

    def _prepare(self, chosen: Chosen, changed: Set[str]) -> Callable[[], None]:
        shared = _of(chosen.shared, chosen.values)
        built = scenario.rebuild(self.scenario, shared, changed & shared.keys())
        options, extra = self._own_options(chosen)
        apply = self.prepare(built, options, extra)

        def put_in_place() -> None:
            self.known, self.scenario = chosen.known, built
            self.options, self.extra = options, extra
            self.intake.longest = options.max_message_size
            apply()

        return put_in_place

    def prepare(
        self, scenario: Scenario, options: Any, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Build the objects of a changed scenario and return a function that applies them.

        Raises
        ------
        ValueError
            If that is impossible; the node continues unchanged.
        """
        raise NotImplementedError

    def report(self) -> Report:
        """Return the status of the active node."""
        raise NotImplementedError

    def _report_state(self) -> Report:
        if self.phase == ACTIVE:
            level, message, values = self.report()
            return level, message, {**values, 'scheduling': self._scheduling}
        why = f': {self.refusal}' if self.refusal else ''
        return Level.WARN, f'{self.phase}{why}', {}


def main(build: Callable[[], ScenarioNode]) -> None:
    """Run one node until a signal requests the end; exit 1 with one line if it cannot start.

    With ``--help`` among its arguments it prints its purpose and parameters.
    """
    interruption = Interruption()
    faulthandler.enable()  # a library that crashes shows where, also before the executor's own
    try:
        # rcl's log of an unreadable parameter file is replaced by one line below
        set_logger_level('rcl', LoggingSeverity.FATAL)
        prefer_sockets()
        with readable(sys.argv) as arguments:
            interruption.defer()
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        set_logger_level('rcl', LoggingSeverity.INFO)
        if wants_help(sys.argv[1:]):
            set_logger_level('', LoggingSeverity.WARN)  # messages of a running node
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
            _warn_of_files(node, sys.argv)
            _spin(node, interruption)
    finally:
        interruption.ignore()
        with _bounded():
            node.destroy_node()
            rclpy.try_shutdown()


@contextmanager
def _bounded() -> Iterator[None]:
    """End the process where it is, with exit code 1 and its stack, if that takes too long.

    Fast DDS may wait for itself if another participant leaves while it is destroyed, for ever, and
    holds the interpreter's lock meanwhile; signals are ignored by then.
    """
    faulthandler.dump_traceback_later(_END, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def _warn_of_files(node: ScenarioNode, argv: Sequence[str]) -> None:
    """Warn of files without a section for the node, and of arguments that such a section hides."""
    for name in overruled(argv, parameters.given(node)):
        node.get_logger().warning(
            f'{name}: the section of the parameter file for {node.get_name()} counts, and not '
            f'-p {name}:=VALUE; -p {node.get_name()}:{name}:=VALUE would'
        )
    single = sum(argument in ('-p', '--param') for argument in argv)
    if '--params-file' in argv and node.given_count <= single:
        name = node.get_fully_qualified_name()
        node.get_logger().warning(
            f'no section of the parameter file is for {name}: it has the built-in parameters; a '
            "section '/**' is for every node"
        )


def _spin(node: ScenarioNode, interruption: Interruption) -> None:
    """Spin until a signal arrives, and deactivate before anything else."""
    executor = EventsExecutor()
    executor.add_node(node)
    node.own_process()
    # the objects built last as long as the process: a full collection would visit all of them,
    # which takes tens of milliseconds during the work
    gc.freeze()
    # the first logged message makes `inspect` visit all modules, which takes as long
    inspect.getmodule(inspect.currentframe())
    try:
        while not interruption.asked.done():
            # spin() of this executor neither waits properly nor notices signals; see its issues
            executor.spin_until_future_complete(interruption.asked, _PATIENCE)
    finally:  # a user's model may raise anything; the input must still go to idle
        interruption.ignore()
        # before the executor: it waits for its threads, which a busy machine may not let run
        node.rest()
        with _bounded():
            executor.shutdown()


def _of(known: Iterable[str], values: Mapping[str, Value]) -> dict[str, Value]:
    return {name: values[name] for name in known}


def _program() -> str:
    return sys.argv[0].rpartition('/')[2]
