# SPDX-License-Identifier: Apache-2.0
"""How many seeds of each shipped scenario fail the checks of their own demo, without nodes.

    python test/survey.py [NAME ...] [--seeds 100] [--first 0] [--workers 1]

runs the loop in this process for as long as the demo does. The microphones of a scenario are not
simulated: its bearings are those of its sensor. The exit code is 1 if a scenario fails more than
one seed of a hundred, or part of one.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from math import ceil
from pathlib import Path

if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).parents[1]))

import kalman_ros as kr
from kalman_ros import scenario
from kalman_ros.analysis.verdict import judge, least_duration
from kalman_ros.arrays.scenarios import BELIEVED, LIMITS
from kalman_ros.scenario import shipped
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.parameter_files import from_file

#: In seconds, of a scenario that names none, as in the demo.
DURATION = 60.0


def failures(name, seed, **changes):
    """Return the checks that a run fails, as texts; ``changes`` are parameters over the file's."""
    path = shipped.file(name)
    own = demo_section(path)
    usual = DURATION if own.duration is None else own.duration
    values = {**from_file(path, *BELIEVED), **own.parameters, **changes}
    built = scenario.build(values)
    limits = {key: values[key] for key in LIMITS if key in values}
    run = kr.simulate(built, seconds=max(usual, ceil(least_duration(built))), seed=seed, **limits)
    return [
        f'{check.name} = {check.measured:.3g}, expected {check.low:.3g} to {check.high:.3g}'
        for check in judge(built, run).checks
        if check.counts and not check.passed
    ]


def main():
    """Print a line for each failed run, and one for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('names', nargs='*', metavar='NAME', default=shipped.names())
    parser.add_argument('--seeds', type=int, default=100, metavar='N')
    parser.add_argument('--first', type=int, default=0, metavar='N')
    parser.add_argument('--workers', type=int, default=1, metavar='N')
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    too_many = False
    with ProcessPoolExecutor(options.workers) as pool:
        for name in options.names:
            found = list(pool.map(failures, [name] * len(seeds), seeds))
            for seed, failed in zip(seeds, found):
                if failed:
                    print(f'  seed {seed}: {"; ".join(failed)}')
            count = sum(map(bool, found))
            too_many |= count > ceil(len(seeds) / 100)
            print(f'{"FAIL" if count else "PASS"} {name}: {count} of {len(seeds)} seeds failed')
            sys.stdout.flush()
    sys.exit(too_many)


if __name__ == '__main__':
    main()
