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


class RangeIndex:
    """As much of pandas' index without times as is used."""

    start, step, tz = 0, 1, None

    def __init__(self, count):
        self._count = count

    def to_numpy(self):
        return np.arange(self._count)

    def __iter__(self):
        return iter(range(self._count))


def counted(columns):
    table = Table(columns, TIMES)
    table.index = RangeIndex(len(TIMES))
    return table


DATES = np.datetime64('2026-03-01T12:00:00') + np.arange(20) * np.timedelta64(100, 'ms')


def test_an_index_that_counts_rows_is_no_time():
    columns = {'x': VALUES[:, 0], 'v': VALUES[:, 1], 'time': TIMES}
    with pytest.raises(ValueError, match=r'counts rows: give times, or set_index'):
        kr.filter(MODEL, {'gps': GPS}, counted(columns), initial=START)
    # with times it does not matter, as of two columns of a table
    same(kr.filter(MODEL, {'gps': GPS}, TIMES, counted(columns), initial=START), EXPECTED)


def test_rows_of_a_model_in_discrete_time_are_counted():
    walk = kr.discrete_model([[1.0]], Q=[[0.1]])
    series = counted({'y': VALUES[:, 0]})
    expected = kr.filter(walk, kr.sensor([1], 0.1), None, VALUES[:, 0], initial=([0], [1]))
    same(kr.filter(walk, kr.sensor([1], 0.1), series, initial=([0], [1])), expected)


def test_times_of_inputs_have_the_clock_of_the_readings():
    inputs = np.sin(TIMES)
    expected = kr.filter(MODEL, {'gps': GPS}, TIMES, VALUES, inputs, START, input_times=TIMES)
    found = kr.filter(
        MODEL, {'gps': GPS}, gps_table(DATES), inputs=inputs, input_times=DATES, initial=START
    )
    same(found, expected)


@pytest.mark.parametrize(
    ('inputs', 'input_times'),
    [
        (Table({'force': np.sin(TIMES)}, TIMES), None),
        (counted({'force': np.sin(TIMES)}), None),
        (np.sin(TIMES), TIMES),
    ],
)
def test_times_of_two_kinds_are_refused(inputs, input_times):
    with pytest.raises(ValueError, match='expected one kind|counts rows'):
        kr.filter(
            MODEL, {'gps': GPS}, gps_table(DATES), inputs=inputs, input_times=input_times,
            initial=START,
        )  # fmt: skip


@pytest.mark.parametrize('late', [1.91, 1.7e9])
def test_inputs_after_all_readings_are_of_another_clock(late):
    with pytest.raises(ValueError, match='do they have one clock'):
        kr.filter(
            MODEL, {'gps': GPS}, TIMES, VALUES, np.sin(TIMES), START, input_times=TIMES + late
        )
    kr.filter(MODEL, {'gps': GPS}, TIMES, VALUES, np.sin(TIMES), START, input_times=TIMES + 1.9)


def test_a_sensor_without_a_column_is_named():
    sensors = {'gps': GPS, 'laser': LASER}
    table = Table({'x': VALUES[:, 0], 'v': VALUES[:, 1], 'reach': VALUES[:, 0]}, TIMES)
    with pytest.raises(ValueError, match="no column of 'laser', got x, v, reach"):
        kr.filter(MODEL, sensors, table, initial=START)


def test_a_column_that_is_there_twice_is_refused():
    table = Table({'x': VALUES[:, 0], 'v': VALUES[:, 1]}, TIMES)
    table.columns = ['x', 'x']
    with pytest.raises(ValueError, match="the column 'x' is there twice"):
        kr.filter(MODEL, {'gps': GPS}, table, initial=START)


def test_a_table_of_readings_among_the_times_is_refused():
    with pytest.raises(ValueError, match='times: got a table with dates'):
        kr.filter(MODEL, {'gps': GPS}, gps_table(DATES), VALUES, initial=START)


def test_a_date_that_is_none_is_named():
    dates = DATES.copy()
    dates[3] = np.datetime64('NaT')
    with pytest.raises(ValueError, match='got nan in row 3'):
        kr.filter(MODEL, {'gps': GPS}, gps_table(dates), initial=START)


def test_tables_by_sensor_and_times_by_sensor():
    sensors = {'gps': GPS, 'laser': LASER}
    expected = kr.filter(
        MODEL, sensors, TIMES, {'gps': VALUES, 'laser': VALUES[:, 0]}, initial=START
    )
    tables = {'gps': gps_table(), 'laser': VALUES[:, 0]}
    same(kr.filter(MODEL, sensors, dict.fromkeys(sensors, TIMES), tables, initial=START), expected)
    same(kr.filter(MODEL, sensors, TIMES, tables, initial=START), expected)
    with pytest.raises(ValueError, match="times: expected those of 'laser'"):
        kr.filter(MODEL, sensors, {'gps': TIMES}, tables, initial=START)
    with pytest.raises(ValueError, match="times: expected those of 'laser'"):
        kr.filter(MODEL, sensors, None, tables, initial=START)


@pytest.mark.parametrize(
    ('times', 'words'),
    [
        (np.arange(20) * 1e17, 'nanoseconds times 1e-9 are seconds'),
        (np.where(np.arange(20) == 7, np.nan, TIMES), 'got nan in row 7'),
    ],
)
def test_times_that_are_none_say_why(times, words):
    with pytest.raises(ValueError, match=words):
        kr.filter(MODEL, {'gps': GPS}, times, VALUES, initial=START)


def test_two_sensors_with_one_output_need_the_name_of_the_sensor():
    sensors = {
        'a': kr.sensor([[1, 0]], 1.0, outputs='x'),
        'b': kr.sensor([[1, 0]], 1.0, outputs='x'),
    }
    with pytest.raises(ValueError, match=r'expected columns such as a\.x, b\.x'):
        kr.filter(MODEL, sensors, Table({'x': VALUES[:, 0]}, TIMES), initial=START)


@pytest.mark.slow
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
    with pytest.raises(ValueError, match='counts rows'):
        kr.filter(MODEL, {'laser': LASER}, pandas.Series(VALUES[:, 0]), initial=START)
    with pytest.raises(ValueError, match='expected one kind'):
        kr.filter(
            MODEL, {'gps': GPS}, table, inputs=pandas.Series(TIMES, index.tz_localize(None)),
            initial=START,
        )  # fmt: skip
    again = kr.filter(MODEL, {'gps': GPS}, table, inputs=TIMES, input_times=index, initial=START)
    same(again, kr.filter(MODEL, {'gps': GPS}, TIMES, VALUES, TIMES, START))
    shuffled = table.sample(frac=1.0, random_state=1)
    same(kr.filter(MODEL, {'gps': GPS}, shuffled, initial=START), EXPECTED)


def test_a_dataframe_needs_pandas(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'pandas', None)
    with pytest.raises(ModuleNotFoundError, match='pip install pandas'):
        EXPECTED.to_dataframe()


NAMED = kr.continuous_model([[0, 1], [0, 0]], W=0.1, states=['p', 'v'])


class Column:
    """As much of a Series as is used."""

    def __init__(self, values, index):
        self.index, self._values = list(index), np.asarray(values)

    def to_numpy(self):
        return self._values


@pytest.mark.parametrize(
    'initial',
    [
        (Column([1.0, 0.0], 'vp'), Column([9.0, 0.01], 'vp')),
        ({'v': 1.0, 'p': 0.0}, {'v': 9.0, 'p': 0.01}),
        ([0.0, 1.0], Table({'v': [9.0, 0.0], 'p': [0.0, 0.01]}, ['v', 'p'])),
        ([0.0, 1.0], Table({'p': [0.0, 0.01], 'v': [9.0, 0.0]}, ['v', 'p'])),
        (Column([0.0, 1.0], range(2)), Table({0: [0.01, 0.0], 1: [0.0, 9.0]}, range(2))),
    ],
)
def test_a_belief_goes_by_the_names_of_the_states(initial):
    scenario = kr.make_scenario(NAMED, ([1, 0], 0.1), rate=10, initial=initial)
    assert scenario.initial_belief.mean.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(scenario.initial_belief.covariance, np.diag([0.01, 9.0]))


@pytest.mark.parametrize('mean', [Column([1.0, 0.0], 'ap'), {'p': 0.0}])
def test_a_belief_about_other_states_is_refused(mean):
    with pytest.raises(ValueError, match='^initial mean: expected p, v, got '):
        kr.make_scenario(NAMED, ([1, 0], 0.1), rate=10, initial=(mean, 1.0))


@pytest.mark.slow
def test_a_run_is_a_table_of_truth_estimate_and_inputs():
    pytest.importorskip('pandas')
    run = kr.simulate('mass_spring_damper', seconds=0.5)
    frame = run.to_dataframe()
    assert [*frame.columns] == ['x', 'v', 'x estimate', 'v estimate', 'x std', 'v std', 'f']
    assert frame.index.tolist() == run.time.tolist()
    np.testing.assert_array_equal(frame[['x', 'v']], run.truth)
    np.testing.assert_array_equal(frame[['x estimate', 'v estimate']], run.estimate)
    np.testing.assert_array_equal(frame['f'], run.input[:, 0])
    np.testing.assert_allclose(frame['v std'], np.sqrt(run.covariance[:, 1, 1]))
