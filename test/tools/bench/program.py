# SPDX-License-Identifier: Apache-2.0
"""Speed as ratios to peers measured in the same run."""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.table import Table

from kalman_ros.core import refuse_unknown
from kalman_ros.harness import NodeError
from kalman_ros.programs.refusal import refuse
from kalman_ros.report.run_tables import plain_table

from .benchmark import Benchmark

#: The groups of benchmarks, by their modules.
GROUPS = {
    'filters': 'filters',
    'limits': 'limits',
    'monte_carlo': 'ensembles',
    'estimator': 'relay',
    'real_time': 'real_time',
    'lockstep': 'lockstep',
    'export': 'exports',
    'replay': 'replays',
    'record': 'recording_cost',
    'tune': 'fits',
    'doctor': 'diagnoses',
    'arrays': 'arrays',
}


@dataclass(frozen=True)
class Result:
    """The median times of a benchmark in seconds, and the acceptable ratio."""

    name: str
    ours: float
    peer: float
    ratio: float
    goal: float


def compete(benchmark: Benchmark, rounds: int) -> Result:
    """Measure both alternately, so that the machine's load affects both."""
    pairs = [(benchmark.ours(), benchmark.peer()) for _ in range(rounds)]
    mine, theirs = (statistics.median(times) for times in zip(*pairs))
    ratio = statistics.median(a / b for a, b in pairs)
    return Result(benchmark.name, mine, theirs, ratio, benchmark.goal)


def results_table(results: Sequence[Result]) -> Table:
    """Return the results for people; a ratio that misses its goal is red."""
    table = plain_table('', ('ours', 'peer', 'ratio', 'goal'))
    table.columns[0].no_wrap = False
    for result in results:
        colour = 'green' if result.ratio <= result.goal else 'red'
        table.add_row(
            result.name,
            _duration(result.ours),
            _duration(result.peer),
            f'[{colour}]{result.ratio:.3f}[/]',
            f'{result.goal:.3f}',
        )
    return table


def _duration(seconds: float) -> str:
    if seconds < 0.01:
        return f'{seconds * 1e6:.0f} us'
    return f'{seconds * 1e3:.0f} ms' if seconds < 1.0 else f'{seconds:.2f} s'


def main(argv: Sequence[str] | None = None) -> None:
    """Run every benchmark; exit 1 if a goal is missed."""
    parser = argparse.ArgumentParser(prog='bench', description=__doc__)
    parser.add_argument('groups', nargs='*', default=tuple(GROUPS), help=f'of {", ".join(GROUPS)}')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there, too')
    parser.add_argument('--rounds', type=int, default=7, help='turns of each (default: 7)')
    options = parser.parse_args(argv)
    console = Console()
    results = []
    try:
        refuse_unknown(options.groups, GROUPS, 'group')
        for group in options.groups:
            with import_module(f'{__package__}.{GROUPS[group]}').benchmarks() as benchmarks:
                for benchmark in benchmarks:
                    console.print(f'{benchmark.name} ...', style='dim')
                    results.append(compete(benchmark, options.rounds))
    except (ValueError, NodeError, RuntimeError, ModuleNotFoundError) as error:
        refuse('bench', error)
    console.print(results_table(results))
    console.print(f'{platform.machine()}, Python {platform.python_version()}, medians')
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=2))
    good = sum(result.ratio <= result.goal for result in results)
    passed = good == len(results)
    word = '[green]PASS' if passed else '[bold red]FAIL'
    console.print(f'{word}, {good} of {len(results)} goals[/]')
    sys.exit(0 if passed else 1)
