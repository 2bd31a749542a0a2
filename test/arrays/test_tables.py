# SPDX-License-Identifier: Apache-2.0
"""A table brings its times by its index, and its readings by the names of its columns."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import kalman_ros as kr

MODEL = kr.continuous_model([[0, 1], [0, 0]], [[0], [1]], W=[0, 0.1], states='x v', inputs='force')
GPS = kr.sensor([[1, 0], [0, 1]], [0.04, 0.01], outputs='x v')
LASER = kr.sensor([[1, 0]], 0.01, outputs='range')
START = ([0, 0], [1, 1])
TIMES = np.arange(20) * 0.1
VALUES = np.column_stack([np.sin(TIMES), np.cos(TIMES)])


@dataclass
class Index:
    """As much of an index as is used, without pandas."""

    values: np.ndarray
    tz: Any = None

    def to_numpy(self):
        return self.values

    def __iter__(self):
        return iter(self.values.tolist())


class Table:
    """As much of a DataFrame as is used."""

    def __init__(self, columns, index):
        self.columns, self.index = list(columns), Index(np.asarray(index))
        self._values = np.column_stack(list(columns.values()))

    def to_numpy(self):
        return self._values


def same(found, expected):
    np.testing.assert_array_equal(found.mean, expected.mean)
    np.testing.assert_array_equal(found.covariance, expected.covariance)


def gps_table(index=TIMES, names=('x', 'v')):
    return Table(dict(zip(names, VALUES.T)), index)


EXPECTED = kr.filter(MODEL, {'gps': GPS}, TIMES, VALUES, initial=START)


@pytest.mark.parametrize('names', [('x', 'v'), ('gps.x', 'gps.v'), (('gps', 'x'), ('gps', 'v'))])
def test_columns_are_found_by_their_names(names):
    same(kr.filter(MODEL, {'gps': GPS}, gps_table(names=names), initial=START), EXPECTED)


def test_the_order_of_columns_does_not_matter_and_others_are_ignored():
    table = Table({'battery': VALUES[:, 1], 'v': VALUES[:, 1], 'x': VALUES[:, 0]}, TIMES)
    same(kr.filter(MODEL, {'gps': GPS}, readings=table, initial=START), EXPECTED)


def test_times_that_are_given_count():
    table = gps_table(index=np.arange(20))
    same(kr.filter(MODEL, {'gps': GPS}, TIMES, table, initial=START), EXPECTED)


def test_dates_are_seconds_since_the_first():
    dates = np.datetime64('2026-03-01T12:00:00') + np.arange(20) * np.timedelta64(100, 'ms')
    found = kr.filter(MODEL, {'gps': GPS}, gps_table(dates), initial=START)
    same(found, EXPECTED)
    assert found.time[0] == 0.0
    spans = np.arange(20) * np.timedelta64(100, 'ms')
    same(kr.filter(MODEL, {'gps': GPS}, gps_table(spans), initial=START), EXPECTED)


def test_several_sensors_in_one_table_or_in_one_each():
    sensors = {'gps': GPS, 'laser': LASER}
    ranges = np.where(np.arange(20) % 2, np.nan, VALUES[:, 0])
    expected = kr.filter(MODEL, sensors, TIMES, {'gps': VALUES, 'laser': ranges}, initial=START)
    whole = Table({'x': VALUES[:, 0], 'v': VALUES[:, 1], 'laser': ranges}, TIMES)
    same(kr.filter(MODEL, sensors, whole, initial=START), expected)
    dates = np.datetime64('2026-03-01') + np.arange(20) * np.timedelta64(100, 'ms')
    each = {'gps': gps_table(dates), 'laser': Table({'range': ranges[::2]}, dates[::2])}
    same(kr.filter(MODEL, sensors, readings=each, initial=START), expected)


def test_inputs_come_by_name_with_their_times():
    inputs = np.linspace(0, 1, 5)
    expected = kr.filter(MODEL, {'gps': GPS}, TIMES, VALUES, inputs, START, input_times=TIMES[::4])
    table = Table({'voltage': inputs, 'force': inputs}, TIMES[::4])
    same(kr.filter(MODEL, {'gps': GPS}, gps_table(), inputs=table, initial=START), expected)


@pytest.mark.parametrize(
    ('table', 'words'),
    [
        (gps_table(names=('a', 'b')), 'expected columns such as gps.x, gps.v, got a, b'),
        (gps_table(names=('x', 'b')), 'gps: no column gps.v or v, got x, b'),
        (gps_table(index=list('abcdefghijklmnopqrst')), 'expected an index of times'),
        (Table({'x': list('ab'), 'v': list('cd')}, [0, 1]), 'gps: expected numbers'),
    ],
)
def test_a_table_that_does_not_fit_is_refused(table, words):
    with pytest.raises(ValueError, match=words):
        kr.filter(MODEL, {'gps': GPS}, table, initial=START)


def test_two_sensors_with_one_output_need_the_name_of_the_sensor():
    sensors = {
        'a': kr.sensor([[1, 0]], 1.0, outputs='x'),
        'b': kr.sensor([[1, 0]], 1.0, outputs='x'),
    }
    with pytest.raises(ValueError, match=r'expected columns such as a\.x, b\.x'):
        kr.filter(MODEL, sensors, Table({'x': VALUES[:, 0]}, TIMES), initial=START)


def test_with_pandas_itself():
    pandas = pytest.importorskip('pandas')
    index = pandas.date_range('2026-03-01 12:00', periods=20, freq='100ms', tz='Europe/Berlin')
    table = pandas.DataFrame(VALUES, index=index, columns=['x', 'v'])
    found = kr.filter(MODEL, {'gps': GPS}, table, initial=START)
    same(found, EXPECTED)
    frame = kr.smooth(found).to_dataframe()
    assert list(frame.columns) == ['x', 'v', 'x std', 'v std']
    pandas.testing.assert_index_equal(frame.index, index, check_names=False, exact='equiv')
    series = pandas.Series(VALUES[:, 0], index=TIMES, name='anything')
    one = kr.filter(MODEL, {'laser': LASER}, series, initial=START)
    same(one, kr.filter(MODEL, {'laser': LASER}, TIMES, VALUES[:, 0], initial=START))
    assert one.to_dataframe().index.tolist() == TIMES.tolist()
    shuffled = table.sample(frac=1.0, random_state=1)
    same(kr.filter(MODEL, {'gps': GPS}, shuffled, initial=START), EXPECTED)


def test_a_dataframe_needs_pandas(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'pandas', None)
    with pytest.raises(ModuleNotFoundError, match='pip install pandas'):
        EXPECTED.to_dataframe()
