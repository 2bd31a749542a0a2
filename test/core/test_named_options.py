# SPDX-License-Identifier: Apache-2.0
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import pytest

from kalman_ros.core import About, build_with, options_of, refuse_unknown
from kalman_ros.core.named_options import nearest
from kalman_ros.simulation.faults.body import BodyOptions


def thing(
    size: Annotated[float, About('its size', 'm', minimum=0.0)] = 1.0,
    count: Annotated[int, About('how many', minimum=1, maximum=5)] = 2,
    name: str = 'a',
    on: bool = True,
    gains: tuple[float, ...] = (1.0, 2.0),
    words: tuple[str, ...] = ('a',),
    pole: Annotated[float, About('of an error', '1/s', maximum=-0.1)] = -1.0,
):
    return size, count, name, on, gains, words


def test_options_are_the_keyword_arguments():
    options = {option.name: option for option in options_of(thing, 'thing.')}
    assert list(options) == [
        f'thing.{n}' for n in ('size', 'count', 'name', 'on', 'gains', 'words', 'pole')
    ]
    assert options['thing.size'].description == 'its size [m]'
    assert options['thing.name'].description == 'name'


def test_whole_numbers_serve_as_numbers_and_an_item_as_a_list():
    size, *_, gains, words = build_with(thing, {'size': 3, 'gains': [1, 2.5], 'words': 'b'})
    assert size == 3.0
    assert isinstance(size, float)
    assert gains == [1.0, 2.5]
    assert words == ['b']


@pytest.mark.parametrize('given', [{'size': 0.0}, {'count': 1}, {'count': 5}, {'pole': -0.1}])
def test_the_ends_of_a_range_belong_to_it(given):
    build_with(thing, given)


@pytest.mark.parametrize(
    ('given', 'says'),
    [
        ({'size': 'x'}, "size: expected a number, got 'x'"),
        ({'size': True}, 'size: expected a number, got True'),
        ({'size': -1.0}, 'size: expected at least 0 m, got -1'),
        ({'size': float('nan')}, 'size: expected at least 0 m, got nan'),
        ({'count': 2.5}, 'count: expected a whole number, got 2.5'),
        ({'count': 9}, 'count: expected 1 to 5, got 9'),
        ({'pole': 4.0}, 'pole: expected at most -0.1 1/s, got 4'),
        ({'on': 1}, 'on: expected true or false, got 1'),
        ({'gains': ['a']}, "gains: expected a number, got 'a'"),
        ({'siez': 1.0}, "siez: unknown option; did you mean 'size'\\?"),
    ],
)
def test_a_wrong_value_is_named(given, says):
    with pytest.raises(ValueError, match=says):
        build_with(thing, given)


def test_a_default_of_no_word_is_refused_and_of_no_number_counts_as_numbers():
    def words(names: Annotated[Sequence[str], About('names')] = ()): ...

    def numbers(gains: Annotated[Sequence[float], About('gains')] = ()): ...

    with pytest.raises(ValueError, match=r"^names: expected a default of words, such as \('',\)"):
        options_of(words)
    (option,) = options_of(numbers)
    assert option.check([1, 2.5]) == [1.0, 2.5]


def test_a_default_that_no_parameter_can_hold_is_refused():
    def odd(x=None):
        return x

    with pytest.raises(ValueError, match='x: a default must be'):
        options_of(odd)


def test_a_name_of_which_only_parts_are_known():
    known = ['imu.dropout', 'imu.mount.translation', 'imu.mount.rotation']
    with pytest.raises(ValueError, match=r"'imu.mount'; its parts are imu.mount.translation, imu"):
        refuse_unknown(['imu.mount'], known, 'parameter')


def test_fields_inherited_from_another_module_keep_their_descriptions():
    @dataclass(frozen=True)
    class Mine(BodyOptions):
        extra: Annotated[float, About('one more', 'm')] = 1.0

    found = {option.name: option for option in options_of(Mine)}
    assert found['actuator_gain'].description.startswith('factor of each input')
    assert found['extra'].description == 'one more [m]'


def test_a_name_in_another_case_is_nearest():
    assert nearest('EKF', ['ekf', 'ukf']) == "did you mean 'ekf'?"
    assert nearest('a', ['B.a', 'A']) == "did you mean 'B.a'?"
