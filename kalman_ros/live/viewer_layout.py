# SPDX-License-Identifier: Apache-2.0
"""Layout of panels for Foxglove and Lichtblick: states, innovations and inputs of a scenario."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import cycle
from typing import Any

from kalman_ros.codecs.messages import message_type
from kalman_ros.codecs.paths import ANGLES, VECTOR, is_quaternion, parse, walk
from kalman_ros.core import Signal, Space
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal, state_signal
from kalman_ros.scenario import Scenario, SensorSource
from kalman_ros.sensors.states import States

from .map_extent import extent, is_drawn

#: Colours that are distinct without colour vision (M. Okabe and K. Ito, Color universal design,
#: 2008).
_COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
_GREY = '#888888'
#: The most names in a title.
_MOST_NAMES = 5
#: Time range of a plot, in seconds.
_WIDTH = 30


class LayoutPanels:
    """The panels of a layout by identifier, in the order in which they were added."""

    def __init__(self) -> None:
        self.configurations: dict[str, dict[str, Any]] = {}

    def add(self, kind: str, configuration: Mapping[str, Any]) -> str:
        """Add a panel and return its identifier."""
        name = f'{kind}!{len(self.configurations) + 1}'
        self.configurations[name] = dict(configuration)
        return name

    def plot(self, title: str, series: Iterable[dict[str, Any]]) -> str:
        """Add a plot over time."""
        return self.add('Plot', {
            'title': title, **_titled(title), 'paths': list(series),
            'showXAxisLabels': True, 'showYAxisLabels': True, 'showLegend': True,
            'legendDisplay': 'left', 'showPlotValuesInLegend': True, 'isSynced': True,
            'xAxisVal': 'timestamp', 'sidebarDimension': 260, 'followingViewWidth': _WIDTH,
        })  # fmt: skip


def layout(scenario: Scenario, frame: str, *, ordered: bool = False) -> dict[str, Any]:
    """Return the layout of a scenario, for an import as JSON.

    Parameters
    ----------
    scenario
        Scenario of the estimator.
    frame
        Frame in which the node ``markers`` draws the scenario, if it can.
    ordered
        Whether messages with names, such as joints, have the order of the parameters, as those of
        the node ``plant`` have; else their readings have no path.
    """
    panels = LayoutPanels()
    tabs = {
        'States': _add_states(panels, scenario, ordered=ordered),
        'Innovations': _add_innovations(panels, scenario),
        'Standard deviations': _add_deviations(panels, scenario),
    }
    readings = _add_readings(panels, scenario, ordered=ordered)
    if readings:
        tabs['Readings'] = readings
    if scenario.input.fields:
        tabs['Input'] = [panels.plot('input', _input_series(scenario))]
    report = panels.add('DiagnosticSummary', {'topicToRender': '/diagnostics'})
    log = panels.add('RosOut', {'topicToRender': '/rosout'})
    tabs['Nodes'] = [report, log]
    plots = panels.add('Tab', {
        'activeTabIdx': 0,
        'tabs': [{'title': title, 'layout': stacked(tab)} for title, tab in tabs.items()],
    })  # fmt: skip
    side = [panels.add('3D', _map_panel(scenario, frame))] if is_drawn(scenario) else []
    side.append(panels.add('Parameters', {}))
    return {
        'configById': panels.configurations,
        'globalVariables': {},
        'userNodes': {},
        'playbackConfig': {'speed': 1},
        'layout': {
            'direction': 'row', 'first': stacked(side), 'second': plots, 'splitPercentage': 40,
        },
    }  # fmt: skip


def stacked(panels: Sequence[str]) -> Any:
    """Return panels one above the other, all with the same height."""
    first, *others = panels
    if not others:
        return first
    share = 100.0 / len(panels)
    return {
        'direction': 'column', 'first': first, 'second': stacked(others), 'splitPercentage': share,
    }  # fmt: skip


def message_paths(signal: Signal) -> list[str | None]:
    """Return the path of each field of a signal in a viewer; None for a field without a path.

    A viewer does not compute angles of a quaternion, and finds a value by its name only if the
    names are in the order of the signal.
    """
    kind = message_type(signal.type)
    paths: list[str | None] = []
    names: list[str] = []
    for field in signal.fields:
        try:
            path = parse(field, kind())
        except ValueError:  # a satellite fix in metres has no path
            paths.append(None)
            continue
        is_angle = path.attribute in (*ANGLES, *VECTOR) and is_quaternion(
            walk(kind(), path.parent)
        )
        if path.name is not None and path.name not in names:
            names.append(path.name)
        index = path.index if path.name is None else names.index(path.name)
        steps = ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path.way)
        end = '' if index is None else f'[{index}]'
        paths.append(None if is_angle else f'/{signal.topic.lstrip("/")}{steps}{end}')
    return paths


def _series(
    path: str, label: str, color: str, *, width: float = 1.5, line: bool = True
) -> dict[str, Any]:
    return {
        'value': path, 'enabled': True, 'timestampMethod': 'receiveTime', 'label': label,
        'color': color, 'lineSize': width, 'showLine': line,
    }  # fmt: skip


def _titled(title: str) -> dict[str, str]:
    """Return the title of a panel, as Foxglove and Lichtblick call it."""
    return {'foxglovePanelTitle': title, 'lichtblickPanelTitle': title}


def _title(names: Sequence[str], unit: str) -> str:
    """Return the title of a plot of coordinates with the same unit."""
    shown = ', '.join(names if len(names) <= _MOST_NAMES else [*names[: _MOST_NAMES - 1], '...'])
    return f'{shown} [{unit}]' if unit else shown


def _add_states(panels: LayoutPanels, scenario: Scenario, *, ordered: bool) -> list[str]:
    """Add a plot for each unit with estimates, truth, and direct readings of the states."""
    space, signal = scenario.model.state, scenario.state
    estimates = message_paths(state_signal(signal, space))
    truths = message_paths(Signal('ground_truth', signal.type, signal.fields))
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    colors: dict[str, Iterator[str]] = defaultdict(lambda: cycle(_COLORS))
    for index, (name, unit) in enumerate(zip(space.names, space.units)):
        color = next(colors[unit])
        groups[unit].append(_series(str(estimates[index]), name, color, width=2.0))
        truth = truths[index]
        if truth is not None:
            groups[unit].append(_series(truth, f'{name} true', _GREY, width=1.0))
        for path, label in _reading_paths(scenario, name, ordered=ordered):
            groups[unit].insert(0, _series(path, label, _pale(color), width=1.0, line=False))
    return [
        panels.plot(_title(_names_of(space, unit), unit), series)
        for unit, series in groups.items()
    ]


def _pale(color: str) -> str:
    """Return a colour half way to white."""
    return '#' + ''.join(f'{(int(color[k : k + 2], 16) + 255) // 2:02x}' for k in (1, 3, 5))


def _names_of(space: Space, unit: str) -> list[str]:
    """Return the names of the coordinates with a unit."""
    return [name for name, unit_of_name in zip(space.names, space.units) if unit_of_name == unit]


def _paths_of_readings(source: SensorSource, *, ordered: bool) -> list[str | None]:
    """Return the path of each coordinate of a sensor; None where it has none."""
    signal = source.signal
    paths = message_paths(signal)
    if ordered:
        return paths
    # a robot may publish its joints in another order
    return [None if '[' in field else path for field, path in zip(signal.fields, paths)]


def _reading_paths(scenario: Scenario, state: str, *, ordered: bool) -> Iterator[tuple[str, str]]:
    """Yield the path and the label of each direct reading of a state."""
    for name, source in scenario.enabled.items():
        output = source.sensor.output.names
        if state not in output or not isinstance(source.sensor, States):
            continue
        path = _paths_of_readings(source, ordered=ordered)[output.index(state)]
        if path is not None:
            yield path, f'{state} by {name}'


def _add_readings(panels: LayoutPanels, scenario: Scenario, *, ordered: bool) -> list[str]:
    """Add a plot of the readings of each sensor, as points."""
    plots = []
    for name, source in scenario.enabled.items():
        output = source.sensor.output
        paths = _paths_of_readings(source, ordered=ordered)
        series = [
            _series(path, f'{coordinate} [{unit}]', color, width=1.0, line=False)
            for path, coordinate, unit, color in zip(
                paths, output.names, output.units, cycle(_COLORS)
            )
            if path is not None
        ]
        if series:
            plots.append(panels.plot(f'readings of {name}', series))
    return plots


def _add_innovations(panels: LayoutPanels, scenario: Scenario) -> list[str]:
    """Add a plot of the innovations and deviations of each sensor, and a plot of all NIS."""
    plots, nis = [], []
    for number, (name, source) in enumerate(scenario.enabled.items()):
        output = source.sensor.output
        paths = message_paths(innovation_signal(scenario.state, name, output))
        series = []
        for index, coordinate in enumerate(output.names):
            color = _COLORS[index % len(_COLORS)]
            deviation = paths[output.size + index]
            series.append(_series(str(paths[index]), coordinate, color))
            series.append(
                _series(str(deviation), f'+ deviation of {coordinate}', _GREY, width=1.0)
            )
            series.append(
                _series(f'{deviation}.@negative', f'- deviation of {coordinate}', _GREY, width=1.0)
            )
        plots.append(panels.plot(f'innovation of {name}', series))
        nis.append(_series(str(paths[-1]), name, _COLORS[number % len(_COLORS)], line=False))
    return [*plots, panels.plot('NIS', nis)]


def _add_deviations(panels: LayoutPanels, scenario: Scenario) -> list[str]:
    """Add a plot of the standard deviations for each unit."""
    space = scenario.model.state
    paths = message_paths(covariance_signal(scenario.state))
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for index, (name, unit) in enumerate(zip(space.names, space.units)):
        color = _COLORS[len(groups[unit]) % len(_COLORS)]
        path = f'{paths[index * (space.size + 1)]}.@sqrt'
        groups[unit].append(_series(path, name, color))
    return [
        panels.plot(f'standard deviations of {_title(_names_of(space, unit), unit)}', series)
        for unit, series in groups.items()
    ]


def _input_series(scenario: Scenario) -> Iterator[dict[str, Any]]:
    space = scenario.model.input
    for index, path in enumerate(message_paths(scenario.input)):
        if path is not None:
            label = f'{space.names[index]} [{space.units[index]}]'
            yield _series(path, label, _COLORS[index % len(_COLORS)])


def _map_panel(scenario: Scenario, frame: str) -> dict[str, Any]:
    """Return the configuration of the panel that shows the markers from above."""
    across = extent(scenario)
    return {
        **_titled('map'),
        'cameraState': {
            'perspective': False, 'distance': 1.5 * across, 'phi': 0, 'thetaOffset': 90,
            'targetOffset': [0, 0, 0], 'target': [0, 0, 0], 'targetOrientation': [0, 0, 0, 1],
            'fovy': 45, 'near': 0.01 * across,
            'far': 100.0 * across,
        },
        'followMode': 'follow-none',
        'followTf': frame,
        'fixedFrame': frame,
        'scene': {},
        'transforms': {},
        'topics': {'/markers': {'visible': True}},
        'layers': {
            'grid': {
                'instanceId': 'grid', 'layerId': 'foxglove.Grid', 'label': 'Grid',
                'visible': True, 'frameLocked': True, 'frameId': frame, 'size': across,
                'divisions': 10, 'lineWidth': 1, 'color': '#888888ff', 'position': [0, 0, 0],
                'rotation': [0, 0, 0], 'order': 1,
            },
        },
        'publish': {}, 'imageMode': {},
    }  # fmt: skip
