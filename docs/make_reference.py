# SPDX-License-Identifier: Apache-2.0
"""Write the pages parameters.md and api.md of docs/reference from the declarations in the code."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator
from math import isfinite
from pathlib import Path
from typing import get_args, get_type_hints

import kalman_ros as kr
from kalman_ros import models, scenario, sensors
from kalman_ros.control.laws import LAWS, law_options
from kalman_ros.core import Option, options_of
from kalman_ros.elsewhere import ELSEWHERE
from kalman_ros.estimators import FILTERS, filter_options
from kalman_ros.nodes.controller.options import ControllerOptions
from kalman_ros.nodes.markers.options import MarkersOptions
from kalman_ros.nodes.microphone_array.options import MicrophoneArrayOptions
from kalman_ros.nodes.monitor.options import MonitorOptions
from kalman_ros.nodes.plant.options import PlantOptions
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.scenario.parameter_text import yaml_value
from kalman_ros.simulation.faults import fault_options

FOLDER = Path(__file__).with_name('reference')
NOTE = 'Written by `./dev reference` from the declarations in the code.'


def table(found: Iterable[Option]) -> list[str]:
    """Return the rows of a table of options."""
    rows = ['| name | default | range | meaning |', '|---|---|---|---|']
    for option in found:
        mark = '\\*' if option.about.live else ''
        meaning = option.description.replace('|', '\\|')
        default = yaml_value(option.default)
        rows.append(f'| `{option.name}`{mark} | `{default}` | {limits(option)} | {meaning} |')
    return rows


def limits(option: Option) -> str:
    """Return the range of a number, where it has one."""
    low, high = option.about.minimum, option.about.maximum
    if isfinite(low) and isfinite(high):
        return f'{low:g} to {high:g}'
    if isfinite(low):
        return f'at least {low:g}'
    return f'at most {high:g}' if isfinite(high) else ''


def parameters() -> Iterator[str]:
    """Yield the lines of the page of parameters."""
    shared = scenario.options({})
    without_law = scenario.options({}, with_law=False)
    own = [o for n, o in without_law.items() if '.' not in n or n.startswith(('state.', 'input.'))]
    kinds = {name: sensors.options(name) for name in sensors.names()}
    of_sensor = [
        Option(f'SENSOR.{n.partition(".")[2]}', o.default, o.about)
        for n, o in without_law.items()
        if n.startswith('position.')
    ]
    particular = {option.name for found in kinds.values() for option in found}
    common = [o for o in of_sensor if o.name.partition('.')[2] not in particular]
    yield from ['# Parameters', '', NOTE, '']
    yield (
        'Nodes share one parameter file; each reads its own, and refuses a name that no '
        'node has. A parameter with \\* may change at run time: all that are set together, or '
        'none. Defaults are those of the default scenario; a node without a `model` also reads '
        'its own section of `config/mass_spring_damper_2d.yaml`. `--help` lists its values.'
    )
    yield ''
    yield (
        'SENSOR stands for the name of a sensor, such as `position`. While a node runs: '
        '`ros2 param set /estimator position.noise "[0.1, 0.1]"`. Where a message has a '
        'covariance, that counts in place of the noise, unless `SENSOR.covariance_from` is '
        '`configuration`.'
    )
    yield from ['', '## All nodes: the scenario', '', *table(own)]
    yield from ['', '## All nodes: each sensor', '', *table(common)]
    for name, found in kinds.items():
        if found:
            named = [Option(f'SENSOR.{o.name}', o.default, o.about) for o in found]
            yield from ['', f'Of the kind `{name}`:', '', *table(named)]
    yield from ['', '## All nodes: parameters of the models']
    for name in models.names():
        found = scenario.options({'model': name})
        listed = [o for n, o in found.items() if n.startswith('model_parameters.')]
        yield from ['', f'### {name}', '', *table(listed)]
    yield from ['', '## plant', '', *table(options_of(PlantOptions))]
    faulty = [Option(f'SENSOR.{o.name}', o.default, o.about) for o in fault_options()]
    yield from ['', 'Faults of each sensor, off by default:', '', *table(faulty)]
    yield from ['', '## estimator', '', *table(options_of(EstimatorOptions))]
    for kind in FILTERS:
        found = filter_options(kind)
        if found:
            yield from ['', f'With the filter `{kind}`:', '', *table(found)]
    yield from ['', '## controller', '', *table(options_of(ControllerOptions))]
    cost = [shared[name] for name in ('law', 'state_cost', 'input_cost')]
    yield from ['', 'The law and its cost, for the monitor too:', '', *table(cost)]
    for law in LAWS:
        found = law_options(law)
        if found:
            yield from ['', f'With the law `{law}`:', '', *table(found)]
    yield from ['', '## monitor', '', *table(options_of(MonitorOptions))]
    yield from ['', '## markers', '', *table(options_of(MarkersOptions))]
    yield from ['', '## microphone_array', '', *table(options_of(MicrophoneArrayOptions))]


#: The public names by what they are for.
GROUPS = {
    'Systems': (
        'continuous_model discrete_model linearize discretize trim Model DiscreteModel Space '
        'OperatingPoint'
    ),
    'Sensors and beliefs': 'sensor Sensor Gaussian',
    'Estimation': (
        'filter smooth consistency lqe dlqe OnlineEstimator KalmanFilter ExtendedKalmanFilter '
        'UnscentedKalmanFilter Correction'
    ),
    'Control': 'lqr dlqr place margins worst_case loop_shaping mpc motion Regulator DesignError',
    'Loops and scenarios': 'load make_scenario design simulate monte_carlo',
    'Recordings': 'replay tune fit',
    'To C, and to nodes': 'compile export Run',
}


def api() -> Iterator[str]:
    """Yield the lines of the page of the public names, each with a page from its docstring."""
    grouped = [name for names in GROUPS.values() for name in names.split()]
    if sorted(grouped) != sorted(kr.__all__):
        raise ValueError(f'not in one group: {set(grouped) ^ set(kr.__all__)}')
    yield from ['# Python API', '', NOTE, '']
    yield (
        '`import kalman_ros as kr` offers these names; each is imported on first use, and '
        'none but `Run` needs ROS. `help(kr.NAME)` is the same text.'
    )
    for title, listed in GROUPS.items():
        yield from ['', f'## {title}', '']
        yield from autosummary(f'kalman_ros.{name}' for name in listed.split())
    yield from ['', '## Results', '', 'What these functions return, with its attributes.', '']
    yield from autosummary(results())


def autosummary(names: Iterable[str]) -> Iterator[str]:
    """Yield a table of names, each of which gets a page."""
    yield from ['```{eval-rst}', '.. autosummary::', '   :toctree: api', '']
    yield from (f'   {name}' for name in names)
    yield '```'


def results() -> list[str]:
    """Return the classes of this package that the public functions return."""
    functions = [found for name in kr.__all__ if inspect.isfunction(found := getattr(kr, name))]
    returned = [get_type_hints(function).get('return') for function in functions]
    classes = {
        part
        for found in returned
        for part in (found, *get_args(found))
        if inspect.isclass(part) and part.__module__.startswith('kalman_ros.')
    }
    public = {getattr(kr, name) for name in kr.__all__}
    return sorted(f'{each.__module__}.{each.__qualname__}' for each in classes - public)


def names() -> Iterator[str]:
    """Yield the lines of the page of names from elsewhere."""
    yield from ['# Names from elsewhere', '']
    yield 'What python-control, filterpy, scipy and MATLAB call by another name. `kr.NAME` of'
    yield 'the left column is an error that says the same.'
    yield ''
    yield '| there | here |'
    yield '|---|---|'
    for there, here in sorted(ELSEWHERE.items(), key=lambda item: item[0].lower()):
        yield f'| `{there}` | {code(here)} |'


#: Parentheses, with others in them, and in these.
_CALL = r'\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)'


def code(here: str) -> str:
    """Return a name or a call at the start of a phrase as code."""
    found = re.match(rf'[\w.]+({_CALL}(?:\.\w+(?:{_CALL})?)?)?', here)
    assert found is not None
    name, rest = found[0], here[found.end() :]
    separator = ''
    return f'`kr.{name}`{separator}{rest}' if not name.startswith('model.') else f'`{here}`'


PAGES = {'parameters.md': parameters, 'api.md': api, 'names.md': names}


def main() -> None:
    """Write the pages."""
    for name, lines in PAGES.items():
        (FOLDER / name).write_text('\n'.join(lines()) + '\n')


if __name__ == '__main__':
    main()
