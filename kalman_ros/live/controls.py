# SPDX-License-Identifier: Apache-2.0
"""Sliders and switches of a live page for the parameters of its nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, log10
from typing import Any

from kalman_ros.core import About, Space

from .adjustments import BELIEVERS, Adjustments
from .drawn_path import described

#: The range of a slider of a positive number is from 1 / N to N times its initial value.
_REACH = 100.0
#: The same for paths.
_PATH_REACH = 10.0
#: Length of the longest list with sliders.
_LONGEST = 12
#: Nodes and role of each handle of a parameter, for the actual and for the believed value.
Handles = Sequence[tuple[tuple[str, ...], str]]

#: Sensor faults with a slider or a switch, and the largest value of the slider.
_FAULTS = {'bias': inf, 'outliers': 0.5, 'dropout': 1.0, 'delay': 0.5, 'freeze': 1.0}


@dataclass(frozen=True)
class Control:
    """A number or a truth value that the user may change.

    Parameters
    ----------
    nodes
        Nodes with the parameter; the value of the first node is shown.
    parameter
        Name of the parameter.
    index
        Index in a list; None for a single value.
    group, title, unit, about
        Texts for the user.
    role
        ``'actual'`` or ``'believed'`` if both exist, else ``''``.
    low, high
        Range of the slider; None for a switch.
    scale
        Scale of the slider, ``'log'`` or ``'linear'``.
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
        """Identifier of the control."""
        return '/'.join((self.nodes[0], self.parameter, *map(str, _as_tuple(self.index))))

    def read(self, adjustments: Adjustments) -> Any:
        """Return the current value of the control."""
        value = adjustments.value(self.nodes[0], self.parameter)
        return value if self.index is None else value[self.index]

    def value_of(self, given: Any, adjustments: Adjustments) -> Any:
        """Return the parameter for a new value of the control.

        Raises
        ------
        ValueError
            If the value of a slider is not a finite number, or that of a switch not a truth value.
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
        """Return the description of the control for JSON."""
        names = ('group', 'title', 'unit', 'about', 'role', 'low', 'high', 'scale')
        return {'key': self.key, **{name: getattr(self, name) for name in names}}


_SENSED: Handles = ((('plant',), 'actual'), (('estimator', 'monitor'), 'believed'))
_MODELLED: Handles = ((('plant',), 'actual'), (BELIEVERS, 'believed'))


def _as_tuple(index: int | None) -> tuple[int, ...]:
    return () if index is None else (index,)


def controls(adjustments: Adjustments) -> dict[str, Control]:
    """Return the controls of a scenario by their keys."""
    all_controls = [*_sensor_controls(adjustments), *_model_controls(adjustments)]
    if adjustments.driven:
        all_controls += [*_cost_controls(adjustments), *_actuator_controls(adjustments)]
        all_controls += _path_controls(adjustments)
    all_controls += _fault_controls(adjustments)
    return {control.key: control for control in all_controls}


def _sensor_controls(adjustments: Adjustments) -> Iterator[Control]:
    believed = adjustments.scenario('estimator')
    for name in adjustments.sensors:
        output = believed.sensors[name].sensor.output
        parameter, group = f'{name}.noise', f'Sensor {name}'
        noise = adjustments.value('plant', parameter)
        for index in range(len(noise)):
            title = f'noise of {_coordinate_name(output, index, len(noise))}'
            unit = output.units[index] if len(noise) == output.size else ''
            about = 'standard deviation of a reading'
            for nodes, role in _SENSED:
                yield Control(
                    nodes, parameter, index, group, title, unit, about, role,
                    *_range(noise[index], About('', minimum=0.0)),
                )  # fmt: skip
        rate, readers = (
            adjustments.value('plant', f'{name}.rate'),
            ('plant', 'estimator', 'monitor'),
        )
        highest_rate = adjustments.value('plant', 'rate')
        yield Control(
            readers, f'{name}.rate', None, group, 'rate', adjustments.rate_unit, 'of readings', '',
            min(rate, highest_rate / _REACH), highest_rate, 'log',
        )  # fmt: skip
        yield Control(('plant',), f'{name}.enabled', None, group, 'publishes')


def _coordinate_name(space: Space, index: int, count: int) -> str:
    return space.names[index] if count == space.size else f'all ({", ".join(space.names)})'


def _model_controls(adjustments: Adjustments) -> Iterator[Control]:
    for name, option in adjustments.known('plant').items():
        head, _, rest = name.partition('.')
        if head != 'model_parameters':
            continue
        group = 'Process noise' if 'noise' in rest else 'Model'
        title = rest.replace('_', ' ')
        for nodes, role in _MODELLED if adjustments.driven else _SENSED:
            for index, value in _indexed_numbers(adjustments.value('plant', name)):
                heading = title if index is None else f'{title} [{index}]'
                about = option.about
                yield Control(
                    nodes, name, index, group, heading, about.unit, about.description, role,
                    *_range(value, about),
                )  # fmt: skip


def _indexed_numbers(value: Any) -> Iterator[tuple[int | None, float]]:
    """Yield the numbers of a value with their indices; None for a single number.

    A limit that is infinite, as where there is none, has no slider.
    """
    if isinstance(value, float):
        yield None, value
    elif isinstance(value, list) and len(value) <= _LONGEST:
        numbers = [item for item in value if isinstance(item, float) and isfinite(item)]
        yield from enumerate(numbers) if len(numbers) == len(value) else ()


def _cost_controls(adjustments: Adjustments) -> Iterator[Control]:
    model = adjustments.scenario('controller').model
    for name, space in (('state_cost', model.state), ('input_cost', model.input)):
        weights = adjustments.value('controller', name)
        if len(weights) != space.size:
            continue  # the list has all rows of the matrix
        others = [weight for weight in weights if weight > 0.0] or [1.0]
        for index, weight in enumerate(weights):
            slider = _range(weight or min(others), About('', minimum=0.0))
            if not weight:
                slider = (0.0, max(others), 'linear')
            about = 'weight in the cost that the gain minimises'
            yield Control(
                ('controller', 'monitor'), name, index, 'Cost', f'weight of {space.names[index]}',
                '', about, '', *slider,
            )  # fmt: skip


def _actuator_controls(adjustments: Adjustments) -> Iterator[Control]:
    group, known = 'Plant input', adjustments.known('plant')
    unit = adjustments.scenario('plant').model.input.units[0]
    ranges: Mapping[str, tuple[int | None, str, tuple[float, float, str]]] = {
        'actuator_gain': (0, '', (0.01, 100.0, 'log')),
        'actuator_delay': (None, adjustments.time_unit, (0.0, 0.5, 'linear')),
        'disturbance_constant': (0, unit, (-10.0, 10.0, 'linear')),
    }
    for name, (index, unit, slider) in ranges.items():
        title, about = name.replace('_', ' '), known[name].about.description
        yield Control(('plant',), name, index, group, title, unit, about, '', *slider)


def _path_controls(adjustments: Adjustments) -> Iterator[Control]:
    if described(adjustments)['reason']:
        return
    for name in ('path_speed', 'path_acceleration', 'path_tolerance'):
        about = adjustments.known('controller')[name].about
        value = adjustments.value('controller', name)
        yield Control(
            ('controller',), name, None, 'Path', name.removeprefix('path_'), about.unit,
            about.description, '', *_range(value, about, _PATH_REACH),
        )  # fmt: skip


def _fault_controls(adjustments: Adjustments) -> Iterator[Control]:
    for name in adjustments.sensors:
        scale = max(adjustments.value('plant', f'{name}.noise'))
        units = {'s': adjustments.time_unit}
        output = adjustments.scenario('plant').sensors[name].sensor.output
        for fault, high in _FAULTS.items():
            parameter = f'{name}.{fault}'
            about = adjustments.known('plant')[parameter].about
            value = adjustments.value('plant', parameter)
            index = 0 if isinstance(value, list) else None
            if isinstance(value, bool):
                slider: tuple[Any, ...] = ()
            elif high == inf:
                slider = (-_round(20.0 * scale), _round(20.0 * scale), 'linear')
            else:
                slider = (0.0, high, 'linear')
            yield Control(
                ('plant',), parameter, index, f'Faults of {name}', fault,
                output.units[0] if index == 0 else units.get(about.unit, about.unit),
                about.description, '', *slider,
            )  # fmt: skip


def _range(value: float, about: About, reach: float = _REACH) -> tuple[float, float, str]:
    """Return the range of a slider around a value, and the scale of the slider."""
    if value > 0.0:
        low, high = value / reach, value * reach
        return max(_round(low), about.minimum), min(_round(high), about.maximum), 'log'
    size = _round(5.0 * abs(value)) or 1.0
    return max(-size, about.minimum), min(size, about.maximum), 'linear'


def _round(value: float) -> float:
    """Return a number rounded to two significant digits."""
    return round(value, 1 - floor(log10(abs(value)))) if value and isfinite(value) else 0.0
