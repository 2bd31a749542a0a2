# SPDX-License-Identifier: Apache-2.0
"""The parameters of a scenario that can be fitted, by the names that its file uses.

A list has one parameter for each coordinate: ``odometry.noise.v``. Beside the parameters of the
file, each sensor has a ``bias`` and a ``delay``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from kalman_ros.compiled.parts import parts
from kalman_ros.core import Option, refuse_unknown
from kalman_ros.estimators import build_filter, default_filter, filter_class
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.scenario import Scenario, build, options

from .candidate import Candidate
from .free_parameter import FreeParameter

#: The longest delay of a sensor that is looked for, in seconds.
LONGEST_DELAY = 1.0
#: Options that are numbers and no parameter of the estimate.
_NOT = (
    'rate', 'gate', 'datum', 'initial_state', 'enabled', 'still.below', 'still.duration',
    'stamp_offset',  # fitted as a delay
)  # fmt: skip
#: What other filters are fitted as: the likelihood needs their own covariance.


@dataclass(frozen=True)
class _Place:
    """Where a parameter is: an option and its element, or the bias or delay of a sensor."""

    option: str
    element: int | None
    free: FreeParameter


class NamedParameters:
    """The parameters of a scenario, and the candidates of their values.

    Parameters
    ----------
    values
        The parameters of the file, flat.
    filter_options
        Of the filter.

    Raises
    ------
    ValueError
        If the values build no scenario.
    """

    def __init__(
        self, values: Mapping[str, Any], filter_options: Mapping[str, Any] | None = None
    ) -> None:
        self._given, self._filter_options = dict(values), dict(filter_options or {})
        self.scenario: Scenario = build(values, with_law=False)
        self._options = options(values, with_law=False)
        self._current = {
            name: values.get(name, option.default) for name, option in self._options.items()
        }
        self._places = {place.free.name: place for place in self._found()}
        self._chosen: list[_Place] = []

    @property
    def names(self) -> list[str]:
        """All that can be fitted."""
        return list(self._places)

    @property
    def usual(self) -> list[str]:
        """Process noise, and the noise of sensors that read more than zeros: the default."""
        known = {name for name, each in self.scenario.sensors.items() if not each.judged}
        return [
            name
            for name, place in self._places.items()
            if 'noise' in place.option.rpartition('.')[2]
            and place.free.start > 0.0
            and place.option.rpartition('.')[0] not in known
        ]

    def choose(
        self,
        names: Sequence[str],
        bounds: Mapping[str, tuple[float, float]] | None = None,
        priors: Mapping[str, tuple[float, float]] | None = None,
    ) -> list[FreeParameter]:
        """Return the parameters to fit; a name may be that of a list or the end of a longer one.

        Raises
        ------
        ValueError
            If a name is unknown or ambiguous, or a bound or a prior does not fit.
        """
        wanted = list(dict.fromkeys(one for name in names for one in self._resolved(name)))
        limited = {one: pair for n, pair in (bounds or {}).items() for one in self._resolved(n)}
        known = {one: pair for n, pair in (priors or {}).items() for one in self._resolved(n)}
        for what, given in (('bounds', limited), ('priors', known)):
            for name in given:
                if name not in wanted:
                    raise ValueError(f'{what}: {name} is not fitted; name it in fit, too')
        for name in wanted:
            free = self._places[name].free
            if free.low >= 0.0 and not free.positive:
                raise ValueError(f'{name}: it is 0; give it a start above 0 to fit it from')
        self._chosen = [
            _with(self._places[name], limited.get(name), known.get(name)) for name in wanted
        ]
        return [place.free for place in self._chosen]

    def _resolved(self, name: str) -> list[str]:
        """Return the parameters that a name stands for."""
        if name in self._places:
            return [name]
        group = [each for each in self._places if each.startswith(f'{name}.')]
        if group:
            return group
        ends = [each for each in self._places if each.endswith(f'.{name}')]
        inside = {each.partition(f'.{name}.')[0] for each in self._places if f'.{name}.' in each}
        if len(ends) + len(inside) > 1:
            every = [*ends, *(f'{one}.{name}' for one in sorted(inside))]
            raise ValueError(f"fit: '{name}' may be {' or '.join(every)}; write one of them")
        if inside:
            return self._resolved(f'{inside.pop()}.{name}')
        if not ends:
            last = {each.rpartition('.')[2] for each in self._places}
            refuse_unknown([name], [*self._places, *sorted(last)], 'parameter to fit')
        return ends

    def parameter(self, name: str) -> str:
        """Return the parameter of the file in which a fitted one is written."""
        option = self._places[name].option
        sensor, _, last = option.rpartition('.')
        delay = last == 'delay' and sensor in self.scenario.sensors
        return f'{sensor}.stamp_offset' if delay else option

    def changes(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters of the file at these values, biases left out.

        Where the noise of a sensor is fitted, it replaces that of its messages; a delay becomes an
        offset of its stamps.
        """
        changed: dict[str, Any] = {}
        for place in self._chosen:
            value = values[place.free.name]
            sensor, _, last = place.option.rpartition('.')
            name = self.parameter(place.free.name)
            if last == 'delay' and name != place.option:
                changed[name] = float(self._current[name]) - value
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
        """Return the filter, sensors and first belief at these values.

        Raises
        ------
        ValueError
            If they build no scenario.
        """
        built = build({**self._given, **self.changes(values)}, with_law=False)
        biases = {n: np.zeros(s.sensor.output.size) for n, s in built.enabled.items()}
        delays = {}
        for place in self._chosen:
            sensor, _, last = place.option.rpartition('.')
            if sensor in biases and last == 'bias':
                biases[sensor][place.element or 0] = values[place.free.name]
            elif sensor in biases and last == 'delay':
                delays[sensor] = values[place.free.name]
        return candidate_of(built, biases, delays, self._filter_options)

    def configured_noise(self) -> set[str]:
        """Return the sensors whose noise is fitted: that of their messages does not count."""
        noise = [place.option.rpartition('.') for place in self._chosen]
        return {sensor for sensor, _, last in noise if last == 'noise'} & {*self.scenario.sensors}

    def _list(self, option: str) -> list[float]:
        value = self._options[option].check(self._current[option])
        assert isinstance(value, list)
        return [float(each) for each in value]

    def _found(self) -> Iterable[_Place]:
        for name, option in self._options.items():
            sensor, _, own = name.partition('.')
            disabled = sensor in self.scenario.sensors and sensor not in self.scenario.enabled
            if name not in _NOT and own not in _NOT and not disabled:
                yield from self._of(name, option)
        for name, source in self.scenario.enabled.items():
            output, R = source.sensor.output, source.sensor.covariance
            for index, (coordinate, unit) in enumerate(zip(output.names, output.units)):
                label = f'{name}.bias' if output.size == 1 else f'{name}.bias.{coordinate}'
                size = float(np.sqrt(R[index, index]))
                yield _Place(
                    f'{name}.bias', index, FreeParameter(label, 0.0, scale=size, unit=unit)
                )
            if self.scenario.model.is_discrete:
                continue  # in discrete time no step is short enough
            yield _Place(
                f'{name}.delay', None,
                FreeParameter(
                    f'{name}.delay', 0.0, -LONGEST_DELAY, LONGEST_DELAY,
                    scale=0.1 / source.timed.rate, unit='s',
                ),
            )  # fmt: skip

    def _of(self, name: str, option: Option) -> Iterable[_Place]:
        """Yield the parameters of an option, if it is a number or a list of them."""
        about, value = option.about, option.check(self._current[name])
        deviation = name == 'initial_std' or name.endswith('.noise')
        low = max(about.minimum, 0.0) if deviation else about.minimum
        if isinstance(value, float):
            yield _Place(name, None, _free(name, value, low, about.maximum, about.unit))
        elif isinstance(value, list) and value and all(isinstance(v, float) for v in value):
            labels, units = self._coordinates(name, len(value))
            scales = self._list('initial_std') if name == 'initial_estimate' else None
            for index, (label, unit) in enumerate(zip(labels, units)):
                full = name if len(value) == 1 else f'{name}.{label}'
                number = float(value[index])
                scale = None if scales is None else scales[index]
                yield _Place(name, index, _free(full, number, low, about.maximum, unit, scale))

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


def _with(
    place: _Place, bounds: tuple[float, float] | None, prior: tuple[float, float] | None
) -> _Place:
    """Return a parameter within narrower bounds and with a prior."""
    free = place.free
    low, high = bounds or (-inf, inf)
    return _Place(
        place.option, place.element,
        FreeParameter(
            free.name, free.start, max(low, free.low), min(high, free.high), free.positive,
            free.scale, free.unit, prior,
        ),
    )  # fmt: skip


def candidate_of(
    built: Scenario,
    biases: Mapping[str, Any],
    delays: Mapping[str, float],
    filter_options: Mapping[str, Any],
) -> Candidate:
    """Return the candidate of a scenario."""
    believed, plan = built.believed, built.believed_plan
    # a gain that is not optimal has no likelihood
    has_likelihood = issubclass(filter_class(built.filter), SmoothableFilter)
    kind = built.filter if has_likelihood else default_filter(plan)
    chosen = filter_options if kind == built.filter else {}
    sensors = {name: believed.sensors[name] for name in built.enabled}
    fast = parts(believed.model, sensors, one_of_many=True)
    filter = build_filter(kind, plan.computed_by(fast.model, fast.sensors), chosen)
    return Candidate(filter, fast.model, fast.sensors, believed.initial, biases, delays)
