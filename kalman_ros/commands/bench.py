# SPDX-License-Identifier: Apache-2.0
"""How fast it is, as ratios to peers measured in the same run."""

from __future__ import annotations

import argparse
import json
import platform
import signal
import statistics
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from kalman_ros.harness import NodeError, Run
from kalman_ros.harness.ring import Ring


@dataclass(frozen=True)
class Result:
    """The median times of a contest in seconds, and the ratio that is good enough."""

    name: str
    ours: float
    peer: float
    ratio: float
    goal: float


#: Measures once and returns seconds per unit of work.
Contestant = Callable[[], float]


def compete(name: str, goal: float, ours: Contestant, peer: Contestant, rounds: int) -> Result:
    """Let two contestants take turns, so that the machine's moods strike both alike."""
    pairs = [(ours(), peer()) for _ in range(rounds)]
    mine, theirs = (statistics.median(times) for times in zip(*pairs))
    ratio = statistics.median(a / b for a, b in pairs)
    return Result(name, mine, theirs, ratio, goal)


@contextmanager
def lockstep() -> Iterator[tuple[str, float, Contestant, Contestant]]:
    """Give a step of the whole loop, monitor and recorder listening, against the bare ring."""
    import time

    with Run() as run, Ring() as ring:
        run.advance(1.0)
        ring.rounds(100)

        def ours() -> float:
            start = time.perf_counter()
            run.advance(5.0)
            # what the harness waits for at the end is no part of a step
            return (time.perf_counter() - start - run.drained) / (5.0 * run.scenario.rate)

        # 60 s at 100 Hz under 8 s, where the ring alone would take 3.5 s
        yield 'lockstep step / bare rclpy ring', 8.0 / 3.5, ours, lambda: ring.rounds(500)


CONTESTS = (lockstep,)


def main(argv: Sequence[str] | None = None) -> None:
    """Run every contest; exit 1 if a goal is missed."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    parser = argparse.ArgumentParser(prog='bench', description=__doc__)
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there, too')
    parser.add_argument('--rounds', type=int, default=7, help='turns of each (default: 7)')
    options = parser.parse_args(argv)
    console = Console()
    results = []
    try:
        for contest in CONTESTS:
            console.print(f'{contest.__name__} ...')
            with contest() as (name, goal, ours, peer):
                results.append(compete(name, goal, ours, peer, options.rounds))
    except (NodeError, RuntimeError) as error:
        sys.exit(f'bench: {error}')
    except KeyboardInterrupt:
        sys.exit(130)
    table = Table(box=box.HORIZONTALS, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column('', no_wrap=True)
    for column in ('ours', 'peer', 'ratio', 'goal'):
        table.add_column(column, justify='right')
    for result in results:
        colour = 'green' if result.ratio <= result.goal else 'red'
        table.add_row(
            result.name,
            f'{result.ours * 1e6:.0f} us',
            f'{result.peer * 1e6:.0f} us',
            f'[{colour}]{result.ratio:.2f}[/]',
            f'{result.goal:.2f}',
        )
    console.print(table)
    console.print(f'{platform.machine()}, Python {platform.python_version()}, medians')
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=2))
    sys.exit(any(result.ratio > result.goal for result in results))


if __name__ == '__main__':
    main()
