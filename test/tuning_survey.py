# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals of fits to simulated recordings cover the truth.

    python test/tuning_survey.py [CASE ...] [--recordings 200] [--workers 1] [--keep FILE]

fits recordings of the cases of `tuned_cases`, each with another seed and from wrong starts. A
line of `--keep FILE` is a recording; those that are there are not fitted again. The exit code is
1 if the share of a parameter is not within 92 to 98 %, as far as that many recordings can tell;
if a parameter that nothing determines is called determined, or another one is not; or if a delay
is wrong by more than a tenth of the period of its sensor in more than 5 % of the recordings.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from math import sqrt
from pathlib import Path

if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from tuned_cases import COVERED, HIDDEN, IDENTIFIED, likelihood, recorded

from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.named_parameters import NamedParameters

CASES = {case.name: case for case in (*COVERED, *HIDDEN, *IDENTIFIED)}
#: What the share of intervals that cover may be, and by how many deviations chance moves it.
LEAST, MOST, CHANCE = 0.92, 0.98, 2.0


@dataclass(frozen=True)
class Estimate:
    """A parameter in one recording: truth, fit, interval, and why it has none."""

    name: str
    true: float
    value: float
    low: float
    high: float
    reason: str

    @property
    def covers(self):
        return self.low <= self.true <= self.high


def fitted(name, seed):
    """Return the estimates of a case's parameters from one recording, and whether it converged."""
    case = CASES[name]
    truths = [each.start for each in NamedParameters(case.values).choose(list(case.fitted))]
    found = fit(likelihood(case, recorded(case, seed)))
    estimates = [
        Estimate(
            each.name, case.errors.get(each.name, true), each.value, each.low, each.high,
            each.reason,
        )
        for true, each in zip(truths, found.parameters)
    ]  # fmt: skip
    return estimates, found.converged


def period(case, name):
    """Return the seconds between the readings of the sensor of a parameter."""
    return 1.0 / case.values[f'{name.partition(".")[0]}.rate']


def complaints(name, rows):
    """Yield what is wrong with the estimates of a parameter (one for each recording)."""
    case, parameter = CASES[name], rows[0].name
    known = [row for row in rows if not row.reason]
    if parameter in case.hidden:
        if known:
            yield f'called determined in {len(known)}'
        return
    if len(known) < len(rows):
        reason = next(row.reason for row in rows if row.reason)
        yield f'not determined in {len(rows) - len(known)}: {reason}'
    if not known:
        return
    share = np.mean([row.covers for row in known])
    slack = CHANCE * sqrt(0.95 * 0.05 / len(known))
    if not LEAST - slack <= share <= MOST + slack:
        yield f'{100.0 * share:.1f} % cover'
    if parameter.endswith('.delay'):
        wrong = [abs(row.value - row.true) > 0.1 * period(case, parameter) for row in known]
        if np.mean(wrong) > 0.05:
            yield f'a delay wrong by more than a tenth of its period in {sum(wrong)}'


def report(name, rows):
    """Print a line for each parameter, and return whether all are right."""
    good = True
    for column in zip(*rows):
        known = [row for row in column if not row.reason]
        wrong = list(complaints(name, column))
        good &= not wrong
        shown = f'{100.0 * np.mean([row.covers for row in known]):.1f} %' if known else '-'
        print(
            f'{"FAIL" if wrong else "PASS"} {name}: {column[0].name} determined in {len(known)} '
            f'of {len(column)}, covered in {shown}{"; " if wrong else ""}{"; ".join(wrong)}'
        )
    return good


def kept(file):
    """Return the estimates of the recordings in a file, by case and seed."""
    lines = file.read_text().splitlines() if file and file.exists() else []
    entries = [json.loads(line) for line in lines]
    return {
        (each['case'], each['seed']): [Estimate(**one) for one in each['estimates']]
        for each in entries
    }


def main():
    """Fit, print a line for each parameter, and end with 1 if one is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('cases', nargs='*', metavar='CASE', default=[c.name for c in COVERED])
    parser.add_argument('--recordings', type=int, default=200, metavar='N')
    parser.add_argument('--first', type=int, default=0, metavar='N')
    parser.add_argument('--workers', type=int, default=1, metavar='N')
    parser.add_argument('--keep', type=Path, metavar='FILE')
    options = parser.parse_args()
    known = kept(options.keep)
    seeds = range(options.first, options.first + options.recordings)
    wanted = [(name, seed) for seed in seeds for name in options.cases]
    left = [each for each in wanted if each not in known]
    names, numbers = [name for name, _ in left], [seed for _, seed in left]
    with ProcessPoolExecutor(options.workers) as pool:
        for (name, seed), (found, converged) in zip(left, pool.map(fitted, names, numbers)):
            known[name, seed] = found
            if not converged:
                print(f'  {name}, seed {seed}: did not converge')
            if options.keep:
                entry = {'case': name, 'seed': seed, 'estimates': list(map(asdict, found))}
                with options.keep.open('a') as file:
                    file.write(json.dumps(entry) + '\n')
    good = [report(name, [known[name, seed] for seed in seeds]) for name in options.cases]
    sys.exit(not all(good))


if __name__ == '__main__':
    main()
