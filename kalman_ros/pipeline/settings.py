# SPDX-License-Identifier: Apache-2.0
"""Checked values of a node's parameters, and the settings of an estimator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from kalman_ros import scenario
from kalman_ros.core import Array, Option, Value, options_of
from kalman_ros.core.geodesy import Origin
from kalman_ros.estimators import filter_options
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation
from kalman_ros.scenario.idle import idle_input

from . import names
from .datum_file import read_datum
from .estimator_options import EstimatorOptions
from .fusion import check_start, fusion
from .input_timeout import InputTimeout

#: Parameters that rclpy itself reads from the same files.
OF_RCLPY = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


class Chosen(NamedTuple):
    """Values of a node's parameters, its known parameters, and their names by owner.

    ``shared`` names those of the scenario, ``own`` those of the node, and ``extra`` further ones.
    """

    values: dict[str, Value]
    known: dict[str, Option]
    shared: tuple[str, ...]
    own: tuple[str, ...]
    extra: tuple[str, ...]


def choose(
    parameters: Mapping[str, Value],
    options: type[Any],
    extra: Callable[[Mapping[str, Value]], Iterable[Option]],
    *,
    with_law: bool,
) -> Chosen:
    """Return the checked parameters of a node, with defaults for those that are not set.

    Parameters
    ----------
    parameters
        Values by name, without the parameters of rclpy.
    options
        Dataclass of the node's own options.
    extra
        Function that returns further options, which depend on the chosen values.
    with_law
        Whether the control law and the cost belong to the node's scenario.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """
    node_options = {option.name: option for option in options_of(options)}
    shared = scenario.options(parameters, with_law=with_law)
    chosen: dict[str, Any] = {
        **{name: option.default for name, option in shared.items()},
        **parameters,
    }
    chosen['sensors'] = shared['sensors'].check(chosen['sensors'])  # one string is a list, too
    more = {option.name: option for option in extra(chosen)}
    known = {**shared, **node_options, **more}
    sensors = scenario.sensor_names(chosen['sensors'])
    names.check_kinds(shared, sensors)
    driven = 'input.topic' in shared
    everything = {*known, *names.known(sensors, parameters, known, driven=driven)}
    names.refuse(parameters, everything, sensors)
    values = scenario.complete(parameters, known)
    return Chosen(values, known, tuple(shared), tuple(node_options), tuple(more))


def estimator_extra(chosen: Mapping[str, Value]) -> Iterable[Option]:
    """Return the options of the filter that is chosen."""
    return filter_options(str(chosen['filter']), str(chosen.get('implementation', 'native')))


@dataclass(frozen=True)
class Settings:
    """Scenario and options with which an estimator is configured."""

    scenario: Scenario
    options: EstimatorOptions
    extra: Mapping[str, Value]
    simulated_time: bool = False

    def in_lockstep(self, lockstep: bool) -> Settings:
        """Return the same settings in lockstep, or in real time."""
        return replace(self, options=replace(self.options, lockstep=lockstep))

    def origin(self) -> Origin:
        """Return the datum: of the parameters, of the file that keeps it, or not known yet.

        Raises
        ------
        ValueError
            If both are configured, or the file does not hold a datum.
        """
        datum, file = self.scenario.datum, self.options.datum_file
        if datum is not None and file:
            raise ValueError('datum_file: expected none beside a datum, which does not change')
        return Origin(read_datum(file) if file else datum)

    def idle(self) -> Array:
        """Return the input (m,) while no controller acts."""
        return idle_input(self.scenario.model, self.options.idle_input)

    def input_timeout(self) -> InputTimeout:
        """Return the timeout of inputs that are not renewed."""
        return InputTimeout(self.options.input_timeout, self.idle())

    def fusion(self, *, wait: bool = True, many: bool = False) -> Estimation:
        """Return the filter, the sensors and the policy of an estimator, which can start.

        See `fusion.fusion` for the arguments.

        Raises
        ------
        ValueError
            If the filter cannot serve the scenario.
        """
        estimation = fusion(self.scenario, self.options, self.extra, wait=wait, many=many)
        # this also imports the modules of the first step, which takes longer than a step
        check_start(estimation, self.scenario)
        return estimation

    def estimator(self, estimation: Estimation | None = None) -> OnlineEstimator:
        """Return a new estimator, of an estimation by `fusion` or of a new one."""
        return (estimation or self.fusion()).online(self.idle())


def settings(parameters: Mapping[str, Any]) -> Settings:
    """Return the settings by an estimator's parameters, as in a parameter file.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """
    ours = {name: value for name, value in parameters.items() if not name.startswith(OF_RCLPY)}
    values, _, shared, node_names, extra = choose(
        ours, EstimatorOptions, estimator_extra, with_law=False
    )
    return Settings(
        scenario.assemble({name: values[name] for name in shared}, with_law=False),
        EstimatorOptions(**{name: values[name] for name in node_names}),  # type: ignore[arg-type]
        {name: values[name] for name in extra},
        bool(parameters.get('use_sim_time', False)),
    )
