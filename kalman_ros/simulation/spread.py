# SPDX-License-Identifier: Apache-2.0
"""Work spread over processes of this machine."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

T = TypeVar('T')
R = TypeVar('R')

#: What the workers of this process do; they are forked, so that it need not be sent to them.
_task: Callable[[Any], Any]


def spread(
    task: Callable[[T], R], items: Sequence[T], workers: int = 1
) -> Iterator[tuple[int, R]]:
    """Yield the index and the result of each item, as they are completed.

    Raises
    ------
    ValueError
        If a worker ends before its work does.
    """
    workers = min(workers, len(items))
    if workers <= 1:
        yield from ((index, task(item)) for index, item in enumerate(items))
        return
    global _task
    _task = task
    fork = multiprocessing.get_context('fork')
    with ProcessPoolExecutor(workers, mp_context=fork) as pool:
        waiting = {pool.submit(_do, item): index for index, item in enumerate(items)}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool:
            raise ValueError('workers: a process ended before its work did') from None
        finally:
            for future in waiting:
                future.cancel()


def _do(item: Any) -> Any:
    return _task(item)
