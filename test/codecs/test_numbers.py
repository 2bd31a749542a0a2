# SPDX-License-Identifier: Apache-2.0
"""Declared types of message fields, and real numbers as the nearest of a kind."""

from math import inf, nan

import pytest

from kalman_ros.codecs.numbers import array_of, converter, number_kind


@pytest.mark.parametrize('bits', [8, 16, 32])
def test_whole_numbers_are_the_nearest_within_their_range(bits):
    signed, unsigned = converter(f'int{bits}'), converter(f'uint{bits}')
    low, high = -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
    for value, expected in (
        (low, low), (low - 1.0, low), (-inf, low), (high, high), (high + 1.0, high), (inf, high),
        (-1.4, -1), (-1.6, -2), (2.6, 3), (nan, 0),
    ):  # fmt: skip
        assert signed(value) == expected
    for value, expected in (
        (-1.0, 0), (0.4, 0), (0.6, 1), (2**bits - 1, 2**bits - 1), (2.0**bits, 2**bits - 1),
        (nan, 0),
    ):  # fmt: skip
        assert unsigned(value) == expected
    assert isinstance(signed(1.0), int)


def test_the_widest_whole_numbers_keep_every_digit():
    assert converter('int64')(2**63 - 1) == converter('int64')(inf) == 2**63 - 1
    assert converter('int64')(-inf) == -(2**63)
    assert converter('uint64')(inf) == 2**64 - 1
    assert converter('uint64')(-1) == 0


def test_real_numbers_stay_and_a_half_is_true():
    assert converter('double') is converter('float') is None
    boolean = converter('boolean')
    assert [boolean(value) for value in (0.0, 0.499, 0.5, 1.0, nan)] == [
        False, False, True, True, False,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('declared', 'kind', 'array'),
    [
        ('double', 'double', ('', None)),
        ('uint16', 'uint16', ('', None)),
        ('boolean', 'boolean', ('', None)),
        ('string', '', ('', None)),
        ('std_msgs/Header', '', ('', None)),
        ('sequence<double>', '', ('double', None)),
        ('sequence<float, 12>', '', ('float', 12)),
        ('double[36]', '', ('double', 36)),
        ('geometry_msgs/Point[3]', '', ('geometry_msgs/Point', 3)),
    ],
)
def test_a_declaration_is_a_number_or_an_array(declared, kind, array):
    assert number_kind(declared) == kind
    assert array_of(declared) == array
