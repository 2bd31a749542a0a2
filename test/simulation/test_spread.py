# SPDX-License-Identifier: Apache-2.0
"""Work is spread over processes only where there is more than one to do."""

import pytest

from kalman_ros.simulation import spread as spreading
from kalman_ros.simulation.spread import spread


@pytest.mark.parametrize(
    ('items', 'workers', 'processes'),
    [([1, 2, 3], 1, None), ([1, 2, 3], 2, 2), ([1, 2, 3], 9, 3), ([1], 4, None), ([], 4, None)],
)
def test_there_are_no_more_processes_than_items(monkeypatch, items, workers, processes):
    started = []

    def by_processes(task, items, workers):
        started.append(workers)
        yield from ((index, task(item)) for index, item in enumerate(items))

    monkeypatch.setattr(spreading, '_by_processes', by_processes)
    found = dict(spread(lambda item: 10 * item, items, workers))
    assert found == {index: 10 * item for index, item in enumerate(items)}
    assert started == ([] if processes is None else [processes])


def test_by_default_there_is_no_process(monkeypatch):
    monkeypatch.setattr(spreading, '_by_processes', None)
    assert list(spread(str, [1, 2])) == [(0, '1'), (1, '2')]
