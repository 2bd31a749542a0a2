# SPDX-License-Identifier: Apache-2.0
"""What a viewer sends becomes a parameter of the declared type, or is refused in plain words."""

import pytest

pytest.importorskip('rclpy')

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterType
from rclpy.parameter import Parameter

from kalman_ros.live.parameter_values import of_viewer

NUMBER, NUMBERS = ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_DOUBLE_ARRAY
WHOLE, TEXTS = ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_STRING_ARRAY


@pytest.mark.parametrize(
    ('kind', 'value', 'found'),
    [
        (NUMBER, 3, 3.0),
        (NUMBER, '-inf', float('-inf')),
        (NUMBERS, 0.5, [0.5]),
        (NUMBERS, [1, 'inf'], [1.0, float('inf')]),
        (NUMBERS, [], []),
        (WHOLE, 4, 4),
        (TEXTS, 'a', ['a']),
        (ParameterType.PARAMETER_BOOL, True, True),
    ],
)
def test_a_value_has_the_declared_type(kind, value, found):
    parameter = of_viewer('x', value, ParameterDescriptor(name='x', type=kind))
    assert parameter.value == found
    assert parameter.type_ == Parameter.Type(kind)


@pytest.mark.parametrize(
    ('kind', 'value', 'why'),
    [
        (NUMBER, 'abc', "x: expected a number, got 'abc'"),
        (NUMBER, [1.0], 'x: expected a number'),
        (NUMBER, None, 'x: expected a number, got None'),
        (NUMBERS, [True], 'x: expected a list, each a number'),
        (NUMBERS, {}, 'x: expected a list'),
        (WHOLE, 0.5, 'x: expected a whole number'),
        (WHOLE, 2**63, 'x: expected 64 bits'),
        (ParameterType.PARAMETER_BOOL, 1, 'x: expected true or false'),
        (ParameterType.PARAMETER_BYTE_ARRAY, [1], 'x: a viewer cannot change'),
    ],
)
def test_what_it_cannot_be_is_refused(kind, value, why):
    with pytest.raises(ValueError, match=why.replace('[', r'\[')):
        of_viewer('x', value, ParameterDescriptor(name='x', type=kind))


def test_ranges_and_what_is_read_at_the_start_only():
    limits = FloatingPointRange(from_value=0.0, to_value=10.0)
    delay = ParameterDescriptor(name='delay', type=NUMBER, floating_point_range=[limits])
    assert of_viewer('delay', 10, delay).value == 10.0
    with pytest.raises(ValueError, match='delay: expected 0 to 10, got -1'):
        of_viewer('delay', -1, delay)
    bool_type = ParameterType.PARAMETER_BOOL
    for name, read_only in (('use_sim_time', False), ('model', True)):
        known = ParameterDescriptor(name=name, type=bool_type, read_only=read_only)
        with pytest.raises(ValueError, match=f'{name}: it can only be set at the start'):
            of_viewer(name, True, known)
