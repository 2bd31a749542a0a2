# SPDX-License-Identifier: Apache-2.0
"""Work spread over processes of this machine, or over the workers of a Dask scheduler."""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

#: Seconds to wait for a scheduler, and then for a worker that takes the work.
_PATIENCE, _FOR_WORKERS = 10.0, 10.0

T = TypeVar('T')
R = TypeVar('R')

#: Task of the workers of this process; they are forked, so that it need not be sent to them.
_task: Callable[[Any], Any]


def spread(
    task: Callable[[T], R], items: Sequence[T], workers: int = 1, dask: str = ''
) -> Iterator[tuple[int, R]]:
    """Yield the index and the result of each item, as they are completed.

    Parameters
    ----------
    task
        Function of one item, without side effects: Dask may repeat it.
    items
        Arguments of the function.
    workers
        Number of processes of this machine.
    dask
        Address of a Dask scheduler, whose workers are used instead.

    Raises
    ------
    ValueError
        If a worker ends before its work does, or there is no such scheduler.
    """
    if dask:
        yield from _by_dask(task, items, dask)
        return
    workers = min(workers, len(items))
    if workers <= 1:
        yield from ((index, task(item)) for index, item in enumerate(items))
        return
    yield from _by_processes(task, items, workers)


def _by_processes(
    task: Callable[[T], R], items: Sequence[T], workers: int
) -> Iterator[tuple[int, R]]:
    """Yield results from processes of this machine."""
    # not everywhere are there processes: in a browser there are none
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from concurrent.futures.process import BrokenProcessPool

    global _task
    _task = task
    fork = multiprocessing.get_context('fork')
    others = multiprocessing.active_children()
    with ProcessPoolExecutor(workers, fork, _end_quietly) as pool:
        waiting = {pool.submit(_do, item): index for index, item in enumerate(items)}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool:
            raise ValueError('workers: a process ended before its work did') from None
        except BaseException:
            # nobody waits for their results
            for process in {*multiprocessing.active_children()} - {*others}:
                process.terminate()
            raise
        finally:
            for future in waiting:
                future.cancel()


def _end_quietly() -> None:
    """Let signals end a worker, which has inherited the handlers of the program."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)


def _by_dask(task: Callable[[T], R], items: Sequence[T], address: str) -> Iterator[tuple[int, R]]:
    """Yield results from the workers of a scheduler, which repeats the work of those that die."""
    try:
        import distributed
    except ModuleNotFoundError:
        raise ValueError('dask: it is not installed: pip install distributed') from None
    # errors are raised, in one line; its log would add tracebacks
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=_PATIENCE)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"dask: no scheduler at '{address}': {_first_line(error)}") from None
    with client:
        try:
            # the task is sent once, not with each item
            whole = client.scatter(task, broadcast=True, timeout=_FOR_WORKERS)
        except Exception as error:
            # a worker may raise any kind of error; the scheduler wraps its message in others
            reason = _first_line(error)
            raise ValueError(f'dask: no worker of {address} takes the work: {reason}') from None
        waiting = {
            client.submit(_call, whole, item, pure=False): index
            for index, item in enumerate(items)
        }
        try:
            for future in distributed.as_completed(waiting):
                yield waiting[future], future.result()
        except (distributed.KilledWorker, distributed.CancelledError) as error:
            reason = _first_line(error)
            raise ValueError(f'dask: the workers of {address} are gone: {reason}') from None


def _first_line(error: BaseException) -> str:
    return str(error).partition('\n')[0] or type(error).__name__


def _call(task: Callable[[T], R], item: T) -> R:
    return task(item)


def _do(item: Any) -> Any:
    return _task(item)
