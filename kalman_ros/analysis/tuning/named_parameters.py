# SPDX-License-Identifier: Apache-2.0
"""The parameters of a scenario that can be fitted, by their names in the parameter file.

A list has one parameter for each coordinate, such as ``odometry.noise.v``. In addition to the
parameters of the file, each sensor has a ``bias`` and a ``delay``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isinf
from typing import Any

import numpy as np

from kalman_ros.compiled.parts import parts
from kalman_ros.core import Option, refuse_unknown
from kalman_ros.estimators import build_filter, default_filter, filter_class
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.scenario import Scenario, build, options
from kalman_ros.scenario.signal_declarations import LONGEST_OFFSET

from .candidate import Candidate
from .free_parameter import FreeParameter, delay_parameter

#: Numerical options that are not parameters of the estimate.
_NOT = (
    'rate', 'gate', 'soft_gate', 'datum', 'initial_state', 'enabled', 'still.below',
    'still.duration', 'stamp_offset',  # fitted as a delay
)  # fmt: skip


@dataclass(frozen=True)
class _Place:
    """The place of a parameter: an option and its element, or a bias or delay of a sensor."""

    option: str
    element: int | None
    free: FreeParameter


class NamedParameters:
    """The parameters of a scenario, and the candidates of their values.

    Parameters
    ----------
    values
        Parameters of the file, flat.
    filter_options
        Options of the filter.

    Raises
    ------
    ValueError
        If no scenario can be built from the values.
    """

    def __init__(
        self, values: Mapping[str, Any], filter_options: Mapping[str, Any] | None = None
    ) -> None:
        self._values, self._filter_options = dict(values), dict(filter_options or {})
        self.scenario: Scenario = build(values, with_law=False)
        self._options = options(values, with_law=False)
        self._current = {
            name: values.get(name, option.default) for name, option in self._options.items()
        }
        self._places = {place.free.name: place for place in self._all_places()}
        self._chosen: list[_Place] = []

    @property
    def names(self) -> list[str]:
        """Names of all parameters that can be fitted."""
        return list(self._places)

    @property
    def usual(self) -> list[str]:
        """Names that are fitted by default: process noise and the noise of judged sensors."""
        unjudged = {name for name, source in self.scenario.sensors.items() if not source.judged}
        return [
            name
            for name, place in self._places.items()
            if 'noise' in place.option.rpartition('.')[2]
            and place.free.start > 0.0
            and place.option.rpartition('.')[0] not in unjudged
        ]

    def choose(
        self,
        names: Sequence[str],
        bounds: Mapping[str, tuple[float, float]] | None = None,
        priors: Mapping[str, tuple[float, float]] | None = None,
    ) -> list[FreeParameter]:
        """Return the parameters to fit.

        A name may be that of a list, or the last part of a longer name. Variances of a list that
        are zero stay so.

        Raises
        ------
        ValueError
            If a name is unknown or ambiguous, or if a bound or a prior is invalid.
        """
        chosen = list(dict.fromkeys(full for name in names for full in self._resolve(name)))
        all_bounds, all_priors = self._resolved('bounds', bounds), self._resolved('priors', priors)
        for kind, constrained in (('bounds', all_bounds), ('priors', all_priors)):
            for name in constrained:
                if name not in chosen:
                    raise ValueError(f'{kind}: {name} is not fitted; name it in fit, too')
        for name in chosen:
            free = self._places[name].free
            if free.is_zero:
                raise ValueError(f'{name}: it is 0; give it a start above 0 to fit it from')
        self._chosen = [
            _constrain(self._places[name], all_bounds.get(name), all_priors.get(name))
            for name in chosen
        ]
        return [place.free for place in self._chosen]

    def _resolved(
        self, kind: str, pairs: Mapping[str, tuple[float, float]] | None
    ) -> dict[str, tuple[float, float]]:
        """Return pairs by full name; raise ValueError if two are of the same parameter."""
        resolved: dict[str, tuple[float, float]] = {}
        for name, pair in (pairs or {}).items():
            for full in self._resolve(name):
                if full in resolved:
                    raise ValueError(f'{kind}: expected one of {full}, got two')
                resolved[full] = pair
        return resolved

    def _resolve(self, name: str) -> list[str]:
        """Return the full names of the parameters to which a name refers."""
        if name in self._places:
            return [name]
        group = [full for full in self._places if full.startswith(f'{name}.')]
        if group:
            return [full for full in group if not self._places[full].free.is_zero] or group
        ends = [full for full in self._places if full.endswith(f'.{name}')]
        inside = {full.partition(f'.{name}.')[0] for full in self._places if f'.{name}.' in full}
        if len(ends) + len(inside) > 1:
            matches = [*ends, *(f'{prefix}.{name}' for prefix in sorted(inside))]
            raise ValueError(f"'{name}' may be {' or '.join(matches)}; write one of them")
        if inside:
            return self._resolve(f'{inside.pop()}.{name}')
        if not ends:
            last = {full.rpartition('.')[2] for full in self._places}
            refuse_unknown([name], [*self._places, *sorted(last)], 'parameter')
        return ends

    def parameter(self, name: str) -> str:
        """Return the parameter of the file that holds the value of a fitted parameter."""
        option = self._places[name].option
        sensor, _, last = option.rpartition('.')
        delay = last == 'delay' and sensor in self.scenario.sensors
        return f'{sensor}.stamp_offset' if delay else option

    def changes(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters of the file for these values, without biases.

        The fitted noise of a sensor replaces the covariance in its messages. A delay becomes an
        offset of the stamps.
        """
        changed: dict[str, Any] = {}
        for place in self._chosen:
            value = values[place.free.name]
            sensor, _, last = place.option.rpartition('.')
            name = self.parameter(place.free.name)
            if last == 'delay' and name != place.option:
                changed[name] = 0.0 - value
            elif last == 'bias' and sensor in self.scenario.sensors:
                continue
            elif place.element is None:
                changed[name] = value
            else:
                items = changed.setdefault(name, list(self._list(name)))
                items[place.element] = value
            if last == 'noise' and sensor in self.scenario.sensors:
                changed[f'{sensor}.covariance_from'] = 'configuration'
        return changed

    def candidate(self, values: Mapping[str, float]) -> Candidate:
        """Return the filter, sensors and initial belief for these values.

        Raises
        ------
        ValueError
            If no scenario can be built from them.
        """
        built = build({**self._values, **self.changes(values)}, with_law=False)
        biases = {n: np.zeros(s.sensor.output.size) for n, s in built.enabled.items()}
        delays = {}
        for place in self._chosen:
            sensor, _, last = place.option.rpartition('.')
            if sensor in biases and last == 'bias':
                biases[sensor][place.element or 0] = values[place.free.name]
            elif sensor in biases and last == 'delay':
                delays[sensor] = values[place.free.name] - self._corrected(sensor)
        return candidate_of(built, biases, delays, self._filter_options)

    def _corrected(self, sensor: str) -> float:
        """Return the delay in seconds that the stamps of a sensor are corrected by."""
        return 0.0 - float(self._current[f'{sensor}.stamp_offset'])

    def configured_noise(self) -> set[str]:
        """Return the sensors whose noise is fitted and replaces the covariance in messages."""
        noise = [place.option.rpartition('.') for place in self._chosen]
        return {sensor for sensor, _, last in noise if last == 'noise'} & {*self.scenario.sensors}

    def _list(self, option: str) -> list[float]:
        value = self._options[option].check(self._current[option])
        assert isinstance(value, list)
        return [float(element) for element in value]

    def _all_places(self) -> Iterable[_Place]:
        for name, option in self._options.items():
            sensor, _, key = name.partition('.')
            disabled = sensor in self.scenario.sensors and sensor not in self.scenario.enabled
            if name not in _NOT and key not in _NOT and not disabled:
                yield from self._places_of(name, option)
        for name, source in self.scenario.enabled.items():
            output, R = source.sensor.output, source.sensor.covariance
            for index, (coordinate, unit) in enumerate(zip(output.names, output.units)):
                label = f'{name}.bias' if output.size == 1 else f'{name}.bias.{coordinate}'
                size = float(np.sqrt(R[index, index]))
                yield _Place(
                    f'{name}.bias', index, FreeParameter(label, 0.0, scale=size, unit=unit)
                )
            if self.scenario.model.is_discrete:
                continue  # a discrete-time model has no step short enough
            delay = delay_parameter(name, self._corrected(name), 0.1 / source.timed.rate)
            yield _Place(f'{name}.delay', None, delay)

    def _places_of(self, name: str, option: Option) -> Iterable[_Place]:
        """Yield the parameters of an option, if it is a number or a list of numbers."""
        about, value = option.about, option.check(self._current[name])
        deviation = name == 'initial_std' or name.endswith('.noise')
        low = max(about.minimum, 0.0) if deviation else about.minimum
        if isinstance(value, float) and not isinf(value):
            yield _Place(name, None, _free(name, value, low, about.maximum, about.unit))
        elif isinstance(value, list) and value and all(isinstance(v, float) for v in value):
            labels, units = self._coordinates(name, len(value))
            scales = self._list('initial_std') if name == 'initial_estimate' else None
            for index, (label, unit) in enumerate(zip(labels, units)):
                full = name if len(value) == 1 else f'{name}.{label}'
                number = float(value[index])
                if isinf(number):  # of a limit, none
                    continue
                scale = None if scales is None or isinf(scales[index]) else scales[index]
                variance = self._is_variance(name, index, len(value))
                least = max(low, 0.0) if variance else low
                yield _Place(name, index, _free(full, number, least, about.maximum, unit, scale))

    def _is_variance(self, name: str, index: int, size: int) -> bool:
        """Return whether an element of a list is one of the diagonal of a spectral density."""
        n = self.scenario.model.state.size
        if name != 'model_parameters.noise_density':
            return False
        return size == n or (size == n * n and index % (n + 1) == 0)

    def _coordinates(self, name: str, size: int) -> tuple[Sequence[str], Sequence[str]]:
        """Return the names and units of the elements of an option."""
        sensor, _, last = name.rpartition('.')
        space = self.scenario.model.state
        if last == 'noise' and sensor in self.scenario.sensors:
            space = self.scenario.sensors[sensor].sensor.output
        if space.size == size and (last == 'noise' or name.startswith('initial_')):
            return space.names, space.units
        unit = self._options[name].about.unit
        return [str(index) for index in range(size)], [unit] * size


def _free(
    name: str, start: float, low: float, high: float, unit: str, scale: float | None = None
) -> FreeParameter:
    positive = low >= 0.0 and start > 0.0
    size = scale or abs(start) or 1.0
    return FreeParameter(
        name, start, min(low, start), max(high, start), positive=positive, scale=size, unit=unit
    )


def _constrain(
    place: _Place, bounds: tuple[float, float] | None, prior: tuple[float, float] | None
) -> _Place:
    """Return a parameter with narrower bounds and a prior; those of a delay may be wider."""
    free = place.free
    low, high = bounds or (free.low, free.high)
    if not free.scan:
        low, high = max(low, free.low), min(high, free.high)
    elif max(-low, high) > LONGEST_OFFSET:
        most = f'{LONGEST_OFFSET:g}'
        raise ValueError(
            f'{free.name}: expected bounds within -{most} and {most} s, got {low:g} and {high:g}'
        )
    return replace(place, free=replace(free, low=low, high=high, prior=prior))


def candidate_of(
    built: Scenario,
    biases: Mapping[str, Any],
    delays: Mapping[str, float],
    filter_options: Mapping[str, Any],
) -> Candidate:
    """Return the candidate of a scenario."""
    believed, plan = built.believed, built.believed_plan
    # a filter whose gain is not optimal has no likelihood
    has_likelihood = issubclass(filter_class(built.filter), SmoothableFilter)
    kind = built.filter if has_likelihood else default_filter(plan)
    chosen = filter_options if kind == built.filter else {}
    sensors = {name: believed.sensors[name] for name in built.enabled}
    fast = parts(believed.model, sensors, one_of_many=True)
    filter = build_filter(kind, plan.computed_by(fast.model, fast.sensors), chosen)
    return Candidate(filter, fast.model, fast.sensors, believed.initial, biases, delays)
