# SPDX-License-Identifier: Apache-2.0
"""The sliders and switches of a live page, by the parameters of its nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, log10
from typing import Any

from kalman_ros.core import About, Space

from .adjustments import BELIEVERS, Adjustments

#: A slider of a positive number reaches from 1 / N to N times the value at the start.
_REACH = 100.0
#: Lists that are longer have no sliders.
_LONGEST = 12
#: Nodes and role of a handle: what is, or what is believed.
Handles = Sequence[tuple[tuple[str, ...], str]]

#: Sensor faults with a slider or a switch, and the largest value where the range has none.
_FAULTS = {'bias': inf, 'outliers': 0.5, 'dropout': 1.0, 'delay': 0.5, 'freeze': 1.0}


@dataclass(frozen=True)
class Control:
    """A number, or a truth value, that a person may change.

    Parameters
    ----------
    nodes
        That have the parameter; the first one's is shown.
    parameter
        Its name.
    index
        In a list; None for a single value.
    group, title, unit, about
        For the person.
    role
        ``'actual'`` or ``'believed'`` where both exist, else ``''``.
    low, high
        The range of the slider; None for a switch.
    scale
        ``'log'`` or ``'linear'``.
    """

    nodes: tuple[str, ...]
    parameter: str
    index: int | None
    group: str
    title: str
    unit: str = ''
    about: str = ''
    role: str = ''
    low: float | None = None
    high: float | None = None
    scale: str = 'linear'

    @property
    def key(self) -> str:
        """Its identifier."""
        return '/'.join((self.nodes[0], self.parameter, *map(str, _listed(self.index))))

    def read(self, adjustments: Adjustments) -> Any:
        """Return the current value."""
        value = adjustments.value(self.nodes[0], self.parameter)
        return value if self.index is None else value[self.index]

    def value_of(self, given: Any, adjustments: Adjustments) -> Any:
        """Return the parameter with another value of the control.

        Raises
        ------
        ValueError
            If it is not a finite number, or not a truth value where that is expected.
        """
        switch = self.low is None
        number = isinstance(given, (int, float)) and not isinstance(given, bool)
        if isinstance(given, bool) is not switch or not (switch or (number and isfinite(given))):
            expected = 'true or false' if switch else 'a finite number'
            raise ValueError(f'{self.parameter}: expected {expected}, got {given!r:.40}')
        value = given if switch else float(given)
        if self.index is None:
            return value
        values = list(adjustments.value(self.nodes[0], self.parameter))
        values[self.index] = value
        return values

    def described(self) -> dict[str, Any]:
        """Return it for JSON."""
        names = ('group', 'title', 'unit', 'about', 'role', 'low', 'high', 'scale')
        return {'key': self.key, **{name: getattr(self, name) for name in names}}


_SENSED: Handles = ((('plant',), 'actual'), (('estimator', 'monitor'), 'believed'))
_MODELLED: Handles = ((('plant',), 'actual'), (BELIEVERS, 'believed'))


def _listed(index: int | None) -> tuple[int, ...]:
    return () if index is None else (index,)


def controls(adjustments: Adjustments) -> dict[str, Control]:
    """Return the controls of a scenario by their keys."""
    found = [*_sensors(adjustments), *_model(adjustments)]
    if adjustments.driven:
        found += [*_cost(adjustments), *_actuator(adjustments)]
    found += _faults(adjustments)
    return {control.key: control for control in found}


def _sensors(of: Adjustments) -> Iterator[Control]:
    believed = of.scenario('estimator')
    for name in of.sensors:
        output = believed.sensors[name].sensor.output
        parameter, group = f'{name}.noise', f'Sensor {name}'
        noise = of.value('plant', parameter)
        for index in range(len(noise)):
            title = f'noise of {_name(output, index, len(noise))}'
            unit = output.units[index] if len(noise) == output.size else ''
            about = 'standard deviation of a reading'
            for nodes, role in _SENSED:
                yield Control(
                    nodes, parameter, index, group, title, unit, about, role,
                    *_range(noise[index], About('', minimum=0.0)),
                )  # fmt: skip
        rate, everywhere = of.value('plant', f'{name}.rate'), ('plant', 'estimator', 'monitor')
        most = of.value('plant', 'rate')
        yield Control(
            everywhere, f'{name}.rate', None, group, 'rate', of.rate_unit, 'of readings', '',
            min(rate, most / _REACH), most, 'log',
        )  # fmt: skip
        yield Control(('plant',), f'{name}.enabled', None, group, 'publishes')


def _name(space: Space, index: int, count: int) -> str:
    return space.names[index] if count == space.size else f'all ({", ".join(space.names)})'


def _model(of: Adjustments) -> Iterator[Control]:
    for name, option in of.known('plant').items():
        head, _, rest = name.partition('.')
        if head != 'model_parameters':
            continue
        group = 'Process noise' if 'noise' in rest else 'Model'
        title = rest.replace('_', ' ')
        for nodes, role in _MODELLED if of.driven else _SENSED:
            for index, value in _items(of.value('plant', name)):
                heading = title if index is None else f'{title} [{index}]'
                about = option.about
                yield Control(
                    nodes, name, index, group, heading, about.unit, about.description, role,
                    *_range(value, about),
                )  # fmt: skip


def _items(value: Any) -> Iterator[tuple[int | None, float]]:
    """Yield the numbers of a value with their index in it."""
    if isinstance(value, float):
        yield None, value
    elif isinstance(value, list) and len(value) <= _LONGEST:
        numbers = [item for item in value if isinstance(item, float)]
        yield from enumerate(numbers) if len(numbers) == len(value) else ()


def _cost(of: Adjustments) -> Iterator[Control]:
    model = of.scenario('controller').model
    for name, space in (('state_cost', model.state), ('input_cost', model.input)):
        weights = of.value('controller', name)
        if len(weights) != space.size:
            continue  # all rows
        others = [weight for weight in weights if weight > 0.0] or [1.0]
        for index, weight in enumerate(weights):
            ends = _range(weight or min(others), About('', minimum=0.0))
            if not weight:
                ends = (0.0, max(others), 'linear')
            about = 'weight in the cost that the gain minimises'
            yield Control(
                ('controller', 'monitor'), name, index, 'Cost', f'of {space.names[index]}',
                '', about, '', *ends,
            )  # fmt: skip


def _actuator(of: Adjustments) -> Iterator[Control]:
    group, known = 'Plant input', of.known('plant')
    unit = of.scenario('plant').model.input.units[0]
    ranges: Mapping[str, tuple[int | None, str, tuple[float, float, str]]] = {
        'actuator_gain': (0, '', (0.01, 100.0, 'log')),
        'actuator_delay': (None, of.time_unit, (0.0, 0.5, 'linear')),
        'disturbance_constant': (0, unit, (-10.0, 10.0, 'linear')),
    }
    for name, (index, unit, ends) in ranges.items():
        title, about = name.replace('_', ' '), known[name].about.description
        yield Control(('plant',), name, index, group, title, unit, about, '', *ends)


def _faults(of: Adjustments) -> Iterator[Control]:
    for name in of.sensors:
        scale = max(of.value('plant', f'{name}.noise'))
        for fault, high in _FAULTS.items():
            parameter = f'{name}.{fault}'
            about = of.known('plant')[parameter].about
            value = of.value('plant', parameter)
            index = 0 if isinstance(value, list) else None
            if isinstance(value, bool):
                ends: tuple[Any, ...] = ()
            elif high == inf:
                ends = (-_round(20.0 * scale), _round(20.0 * scale), 'linear')
            else:
                ends = (0.0, high, 'linear')
            yield Control(
                ('plant',), parameter, index, f'Faults of {name}', fault,
                of.time_unit if about.unit == 's' else about.unit,
                about.description, '', *ends,
            )  # fmt: skip


def _range(value: float, about: About) -> tuple[float, float, str]:
    """Return the range of a slider around a value, and its scale."""
    if value > 0.0:
        low, high = value / _REACH, value * _REACH
        return max(_round(low), about.minimum), min(_round(high), about.maximum), 'log'
    size = _round(5.0 * abs(value)) or 1.0
    return max(-size, about.minimum), min(size, about.maximum), 'linear'


def _round(value: float) -> float:
    """Return a number with two significant digits."""
    return round(value, 1 - floor(log10(abs(value)))) if value and isfinite(value) else 0.0
