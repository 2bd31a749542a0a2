# SPDX-License-Identifier: Apache-2.0
"""Every node under hostile but well-typed messages and parameters: no exception, NaN or harm."""

import sys
import time
from collections import Counter

import numpy as np
import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

import rclpy
from builtin_interfaces.msg import Time
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from rosidl_parser.definition import (
    AbstractNestedType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from kalman_ros.codecs.messages import message_type
from kalman_ros.harness.domain import Domain
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.microphone_array.node import MicrophoneArrayNode
from kalman_ros.nodes.monitor.node import MonitorNode
from kalman_ros.nodes.plant.node import PlantNode
from kalman_ros.scenario import shipped

NODES = {
    'plant': PlantNode,
    'estimator': EstimatorNode,
    'controller': ControllerNode,
    'monitor': MonitorNode,
    'microphone_array': MicrophoneArrayNode,
}
SCENARIOS = {'microphone_array': 'sound_tracker'}
#: The topics that they publish at least, in real time and in lockstep.
SAYS = {
    ('plant', False): ['/position', '/velocity'],
    ('plant', True): [],
    ('estimator', False): ['/estimate'],
    ('estimator', True): [],  # which waits for what a hostile tick names
    ('controller', False): ['/force'],
    ('controller', True): ['/force'],
    ('monitor', False): [],
    ('monitor', True): [],
    ('microphone_array', False): [],
    ('microphone_array', True): [],
}
LIMIT = 5.0
#: Of rclpy itself.
NOT_OURS = ('/parameter_events', '/rosout', '/clock')
PATIENT = settings(
    suppress_health_check=list(HealthCheck), max_examples=settings.default.max_examples
)
pytestmark = pytest.mark.slow

HOSTILE = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e155, -1.0, 1e9)
FLOATS = st.sampled_from(HOSTILE) | st.floats() | st.floats(-10.0, 10.0)
WORDS = (
    '',
    'odom',
    '../../etc/passwd',
    '~',
    '!!python/object',
    'position',
    'velocity',
    'position,velocity',
)
TEXTS = st.sampled_from((*WORDS, 'velocity@1', 'position@99999999999999999999', 'NaN')) | st.text(
    st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=8
)
BOUNDS = {
    f'{sign}int{bits}': (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ('', 'u')
    for bits in (8, 16, 32, 64)
}


def mostly(usual, hostile):
    """Return a strategy that takes the hostile one in one case of ten."""
    return st.integers(0, 9).flatmap(lambda number: usual if number else hostile)


def numbers(name):
    """Return a strategy for a basic type."""
    if name == 'double':
        return mostly(st.floats(-1.0, 1.0), FLOATS)
    if name == 'float':
        return st.floats(width=32)
    if name == 'boolean':
        return st.booleans()
    low, high = BOUNDS.get(name, (0, 255))
    return st.sampled_from((low, high, 0, 1)) | st.integers(low, high)


def covariances(size):
    """Return a strategy for the numbers of a matrix, row by row."""
    n = round(size**0.5)
    usual = st.sampled_from((0.01, 1.0)).map(lambda variance: variance * np.eye(n).ravel())
    return mostly(usual, arrays(np.float64, size, elements=FLOATS, fill=FLOATS))


def stamps(start, steps):
    """Return a strategy for stamps: mostly of one of N steps from ``start`` on."""

    def usual(step):
        seconds, nanoseconds = divmod(start + step * 10_000_000, 1_000_000_000)
        return Time(sec=seconds, nanosec=nanoseconds)

    ends = st.sampled_from([(-(2**31), 0), (0, 0), (2**31 - 1, 2**32 - 1)])
    anything = st.tuples(numbers('int32'), numbers('uint32'))
    hostile = (ends | anything).map(lambda pair: Time(sec=pair[0], nanosec=pair[1]))
    return mostly(st.integers(0, steps - 1).map(usual), hostile)


def fields(kind, stamps):
    """Return a strategy for a field of a message, by its declared type."""
    if isinstance(kind, AbstractNestedType):
        item = fields(kind.value_type, stamps)
        if isinstance(kind, Array):
            basic = isinstance(kind.value_type, BasicType) and kind.value_type.typename
            size = kind.size
            return (
                covariances(size)
                if basic == 'double'
                else st.lists(item, min_size=size, max_size=size)
            )
        most = kind.maximum_size if isinstance(kind, BoundedSequence) else 6
        return st.lists(item, max_size=min(most, 6))
    if isinstance(kind, NamespacedType):
        if kind.name == 'Time':
            return stamps
        return messages(message_type(f'{kind.namespaces[0]}/{kind.name}'), stamps)
    return numbers(kind.typename) if isinstance(kind, BasicType) else TEXTS


def messages(kind, stamps):
    """Return a strategy for messages of a type: what may be, with anything in some fields."""
    names = [name for name in kind.get_fields_and_field_types() if not name.startswith('_')]
    return st.builds(
        lambda *values: filled(kind, names, values),
        *(fields(found, stamps) for found in kind.SLOT_TYPES),
    )


def filled(kind, names, values):
    message = kind()
    for name, value in zip(names, values):
        # as the wire would: without the checks of the setters
        setattr(message, f'_{name}', value)
    return message


def floats(message):
    """Yield every floating-point number in a message."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if isinstance(value, float):
            yield value
        elif hasattr(value, 'get_fields_and_field_types'):
            yield from floats(value)
        elif kind.startswith(('double', 'float', 'sequence<double', 'sequence<float')):
            yield from np.ravel(value)


@pytest.fixture
def said(monkeypatch):
    """Return what every publisher of this process has said: topics and messages."""
    found = []

    def publish(publisher, message):
        if isinstance(message, bytes):
            message = deserialize_message(message, publisher.msg_type)
        found.append((publisher.topic_name, message))

    monkeypatch.setattr(Publisher, 'publish', publish)
    return found


@pytest.fixture
def start(monkeypatch):
    """Return a function that has a node in this process."""
    domain, nodes = Domain(), []

    def started(name, **parameters):
        settings = [f'-p {key}:={value}'.split() for key, value in parameters.items()]
        args = ['--ros-args', *(word for pair in settings for word in pair)]
        if name in SCENARIOS:
            args += ['--params-file', str(shipped.file(SCENARIOS[name]))]
        monkeypatch.setattr(sys, 'argv', [name, *args])
        rclpy.init(args=args, domain_id=domain.id)
        nodes.append(NODES[name]())
        return nodes[0]

    yield started
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()
    domain.close()


def harmless(said, heard=None):
    """Check what was said since the last time, count it, and forget it."""
    for topic, message in said:
        if heard is not None:
            heard[topic] += 1
        if topic != '/diagnostics':
            assert np.isfinite(list(floats(message))).all(), (topic, message)
        if topic == '/force':
            force = message.wrench.force
            assert max(abs(force.x), abs(force.y), abs(force.z)) <= LIMIT
    del said[:]


def ears(node):
    """Return the subscriptions of a node that are its own."""
    every = (*node.subscriptions, *node.watched)
    return [found for found in every if found.topic_name not in NOT_OURS]


def reset(node):
    """Call the service ``~/reset`` of a node; return whether it succeeded."""
    service = next(found for found in node.services if found.srv_name.endswith('/reset'))
    return service.callback(Trigger.Request(), Trigger.Response()).success


@pytest.mark.parametrize('lockstep', mostly_thorough([False, True], False))
@pytest.mark.parametrize('name', mostly_thorough(list(NODES), 'estimator', 'controller'))
def test_any_message_on_any_subscription(name, lockstep, start, said):
    limits = {'input_limit': f'[{LIMIT},{LIMIT}]'} if name == 'controller' else {}
    node = start(name, lockstep=str(lockstep).lower(), **limits)
    executor = EventsExecutor()
    executor.add_node(node)
    listening = ears(node)
    assert listening
    # without peers a controller acts after a second, which a fast machine is done before
    while name == 'controller' and not node._meeting.over:
        executor.spin_until_future_complete(Future(), 0.05)
    # in lockstep, what belongs to one step is needed for an answer
    times = stamps(1_000_000_000, 2) if lockstep else stamps(time.time_ns() - 100_000_000, 8)
    strategies = [messages(found.msg_type, times).map(serialize_message) for found in listening]
    choices = st.one_of(
        st.tuples(st.just(found), strategy) for found, strategy in zip(listening, strategies)
    )

    @PATIENT
    @given(st.lists(choices, min_size=1, max_size=12))
    def hostile(given):
        for subscription, data in given:
            subscription.callback(data, {'publication_sequence_number': 0})
        # its timers, too
        executor.spin_until_future_complete(Future(), 0.002)
        node.diagnostics.publish()
        harmless(said, heard)
        # a plant that diverged publishes nothing until it is reset
        if 'diverged' in node.report()[1]:
            assert reset(node)
        # a controller that a message has stopped, too
        if node.report()[1].startswith('stopped'):
            node._on_stop(Bool(data=False))
            assert reset(node)
            node._enable(on=True)

    heard = Counter()
    with np.errstate(all='ignore'):
        hostile()
    executor.shutdown()
    # how often a reading among all that is fused depends on the processor
    assert all(heard[topic] for topic in SAYS[name, lockstep]), heard


VALUES = st.one_of(
    FLOATS,
    st.lists(FLOATS, min_size=1, max_size=6),
    st.integers(-(2**63), 2**63 - 1),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=6),
    st.booleans(),
    st.lists(st.booleans(), min_size=1, max_size=3),
    TEXTS,
    st.lists(TEXTS, min_size=1, max_size=3),
)


def like(value):
    """Return a strategy for values of the type of this one."""
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, (list, tuple)) and value:
        return st.lists(like(value[0]), min_size=len(value), max_size=len(value))
    if isinstance(value, int):
        return st.integers(-3, 10) | st.integers(-(2**63), 2**63 - 1)
    if isinstance(value, float):
        return FLOATS
    return TEXTS


def parameters(node):
    """Return a strategy for changes of the parameters of a node, mostly of the right types."""
    there = {name: found.value for name, found in node.get_parameters_by_prefix('').items()}
    known = st.sampled_from(sorted(there)).flatmap(
        lambda name: st.tuples(st.just(name), like(there[name]) | VALUES)
    )
    return st.lists(known | st.tuples(st.just('nonsense'), VALUES), min_size=1, max_size=3)


@pytest.mark.parametrize('name', mostly_thorough(list(NODES), 'estimator', 'controller'))
def test_any_value_of_a_parameter_while_it_runs(name, start, said):
    node = start(name)

    @PATIENT
    @given(parameters(node))
    def hostile(changes):
        wanted = [Parameter(key, value=value) for key, value in dict(changes).items()]
        result = node.set_parameters_atomically(wanted)
        assert result.successful or (result.reason and '\n' not in result.reason), result
        node.diagnostics.publish()
        harmless(said)

    with np.errstate(all='ignore'):
        hostile()


@pytest.mark.parametrize('name', mostly_thorough(list(NODES), 'estimator', 'plant'))
def test_any_value_of_a_parameter_before_it_is_configured(name, start, said):
    complete = start(name, autostart='true')
    strategy = parameters(complete)
    assert complete.trigger_deactivate() is TransitionCallbackReturn.SUCCESS
    assert complete.trigger_cleanup() is TransitionCallbackReturn.SUCCESS

    @PATIENT
    @given(strategy)
    def hostile(changes):
        wanted = [Parameter(key, value=value) for key, value in dict(changes).items()]
        complete.set_parameters(wanted)
        if complete.trigger_configure() is TransitionCallbackReturn.SUCCESS:
            assert complete.trigger_cleanup() is TransitionCallbackReturn.SUCCESS
        else:
            assert complete.refusal, changes
            assert '\n' not in complete.refusal
        complete.set_parameters([Parameter(key) for key in dict(changes)])
        harmless(said)

    with np.errstate(all='ignore'):
        hostile()
