# SPDX-License-Identifier: Apache-2.0
"""Nodes know each other's parameters by name, and load only what they need themselves."""

import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.control.laws import LAWS, law_options
from kalman_ros.core import options_of
from kalman_ros.estimators import FILTERS, filter_options
from kalman_ros.nodes.controller.options import ControllerOptions
from kalman_ros.nodes.markers.options import MarkersOptions
from kalman_ros.nodes.microphone_array.options import MicrophoneArrayOptions
from kalman_ros.nodes.monitor.options import MonitorOptions
from kalman_ros.nodes.plant.options import PlantOptions
from kalman_ros.pipeline import names
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.simulation import faults

OPTIONS = {
    'plant': PlantOptions,
    'estimator': EstimatorOptions,
    'controller': ControllerOptions,
    'monitor': MonitorOptions,
    'markers': MarkersOptions,
    'microphone_array': MicrophoneArrayOptions,
}


@pytest.mark.parametrize('node', OPTIONS)
def test_the_names_are_those_of_the_options(node):
    assert names.NAMES[node].split() == sorted(o.name for o in options_of(OPTIONS[node]))


def test_the_names_of_filters_laws_and_faults_are_those_of_their_options():
    options = {option.name for kind in FILTERS for option in filter_options(kind)}
    assert options and options <= names.known([], ['alpha'], (), driven=False)
    assert not options & names.known([], ['rate'], ['rate'], driven=False)
    found = {option.name for law in LAWS for option in law_options(law)}
    with_law = {*scenario.options({})} - {*scenario.options({}, with_law=False)}
    assert names.NAMES['laws'].split() == sorted(found | with_law)
    assert names.FAULTS.split() == sorted(option.name for option in faults.fault_options())


def test_a_kind_of_sensor_has_no_option_with_the_name_of_a_fault():
    with pytest.raises(ValueError, match="gps.kind: its option 'bias' is the name of a fault"):
        names.check_kinds({'gps.noise', 'gps.bias'}, ['gps'])


def test_what_no_model_without_an_input_has_is_no_name_of_it():
    assert 'state_cost' in names.known([], (), (), driven=True)
    assert not {'state_cost', 'input_cost', 'law', 'tracked'} & names.known(
        [], (), (), driven=False
    )


#: Modules that take a third of a second to import.
SLOW = ['scipy.special', 'scipy.linalg', 'numpy.testing']


@pytest.mark.parametrize(
    ('node', 'foreign'),
    [
        ('estimator', ['kalman_ros.simulation.faults', 'kalman_ros.control']),
        ('controller', ['kalman_ros.simulation.faults', 'kalman_ros.estimators.filters.ekf']),
        ('plant', ['kalman_ros.control', 'kalman_ros.estimators.filters.ekf']),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_a_node_loads_nothing_that_is_anothers_or_slow(node, foreign):
    code = (
        'import sys; from kalman_ros import scenario; '
        f'import kalman_ros.nodes.{node}.node as node; '
        "values = {'state_cost': [1.0, 1.0, 1.0, 1.0], 'position.dropout': 0.1}; "
        "kind = getattr(node, '" + node.title() + "Node'); "
        'scenario.build(values, with_law=kind.with_law); '
        f'print([name for name in {foreign + SLOW} if name in sys.modules])'
    )
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert out.stdout.strip() == '[]', out.stdout + out.stderr
