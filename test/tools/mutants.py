# SPDX-License-Identifier: Apache-2.0
"""Share of random mutants that the tests that decide kill: small changes that must fail.

    .venv/bin/pip install -r .ci/mutants.txt
    source install/setup.bash
    nice .venv/bin/python test/tools/mutants.py [--count 40] [--seed 0] [--layer NAME ...]

The changes are those of cosmic-ray: a number by one, a comparison, a sign, an operator. Each is
made in a copy of the checkout, as many at a time as ``--jobs``, and meets the tests that decide
and execute its line, the quickest first: quick ones of any folder, and slow ones outside
``test/scenarios`` that compute in their own process. Which test executes which line is recorded
once, in ``out/mutants.coverage``; remove it to record anew. A mutant that takes longer than the
limit is killed, too. A survivor is either equivalent, or shows what no test holds. The exit code
is 1 if a smaller share than ``--least`` is killed, 2 if a test that killed fails without a mutant.
"""

import argparse
import ast
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from importlib.util import cache_from_source
from itertools import accumulate, chain
from pathlib import Path
from queue import Queue
from random import Random
from typing import NamedTuple

import coverage
import pytest
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).parents[2]
LAYERS = ('linear', 'core', 'models', 'acoustics', 'sensors', 'compiled', 'estimators', 'control',
          'scenario', 'simulation', 'embedded', 'analysis', 'arrays', 'codecs', 'pipeline', 'bags',
          'nodes', 'harness')  # fmt: skip
#: The sample is from these unless others are named.
BELOW_NODES = LAYERS[:-2]
#: Without those that give a TypeError wherever they are applied, as a bitwise operator does.
OPERATORS = [
    'NumberReplacer', 'AddNot', 'ReplaceAndWithOr', 'ReplaceOrWithAnd', 'ReplaceTrueWithFalse',
    'ReplaceFalseWithTrue', 'ReplaceBreakWithContinue', 'ReplaceContinueWithBreak',
    'ZeroIterationForLoop', 'ReplaceUnaryOperator_USub_UAdd', 'ReplaceUnaryOperator_Delete_Not',
    *(f'ReplaceBinaryOperator_{pair}' for pair in
      ('Add_Sub', 'Sub_Add', 'Mul_Div', 'Div_Mul', 'Pow_Mul', 'FloorDiv_Mul', 'Mod_Mul')),
    *(f'ReplaceComparisonOperator_{pair}' for pair in
      ('Lt_LtE', 'LtE_Lt', 'Gt_GtE', 'GtE_Gt', 'Lt_GtE', 'Gt_LtE', 'Eq_NotEq', 'NotEq_Eq',
       'Is_IsNot', 'IsNot_Is')),
]  # fmt: skip
PYTEST = ('-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider', '--hypothesis-profile=fixed')
DECIDE = 'not thorough and not real_time'
#: Which test executes which line, and in how many seconds each test ends.
RECORD = ROOT / 'out' / 'mutants.coverage'
SECONDS = RECORD.with_suffix('.json')
DURATIONS = Counter()
#: In seconds, what the tests may take for one mutant; the quickest run first.
MOST_SECONDS = 90.0
#: The largest number that is changed by one: the effect on a larger one is below any tolerance.
MOST = 1e6
#: In bytes; a mutant must not take the memory of the machine.
MEMORY = 8 << 30


class Mutant(NamedTuple):
    """A change of a file: which operator, and where, as cosmic-ray counts."""

    path: str
    line: int
    operator: str
    occurrence: int


def text_spans(source):
    """Return the spans of what no result depends on: annotations, messages, caches, decorators."""
    nodes = []
    for node in ast.walk(ast.parse(source)):
        called = ast.unparse(node.func) if isinstance(node, ast.Call) else ''
        message = isinstance(node, ast.Raise | ast.JoinedStr) or 'warn' in called
        if message or 'cache' in called or getattr(node, 'name', '') == '__repr__':
            nodes.append(node)
        elif called.endswith('.reshape'):  # any negative number is the one that is left
            nodes += node.args
        elif isinstance(node, ast.keyword) and node.arg == 'initial':  # of a largest number
            nodes.append(node.value)
        elif isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING':
            nodes.append(node.test)
        nodes += filter(None, (getattr(node, 'annotation', None), getattr(node, 'returns', None)))
        nodes += getattr(node, 'decorator_list', ())
    return [
        ((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)) for node in nodes
    ]


def mutants_of(path):
    """Return the mutants of a file."""
    source = (ROOT / path).read_text()
    spans, nodes, mutants = text_spans(source), list(ast_nodes(get_ast(source))), []
    for name in OPERATORS:
        operator, occurrence = get_operator(f'core/{name}')(), -1
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                occurrence += 1
                large = node.type == 'number' and abs(ast.literal_eval(node.value)) > MOST
                if not large and not any(low <= start and end <= high for low, high in spans):
                    mutants.append(Mutant(str(path), start[0], name, occurrence))
    return mutants


def write(path, source):
    """Write a module, and remove its compiled form, whose time may be the same."""
    path.write_text(source)
    Path(cache_from_source(str(path))).unlink(missing_ok=True)


class Tests:
    """The tests that decide, which lines each executes, and how long each takes."""

    def __init__(self):
        self.data = coverage.CoverageData(str(RECORD))
        self.data.read()
        self.seconds = json.loads(SECONDS.read_text())

    def of(self, mutant):
        """Return the tests that execute the line of a mutant, the quickest first."""
        contexts = self.data.contexts_by_lineno(str(ROOT / mutant.path))
        # a statement of several lines may be recorded by its first alone
        line = max((line for line in contexts if line <= mutant.line), default=0)
        tests = set(contexts.get(line, ())) - {''}
        if not tests:  # what runs at import; it concerns all that use the module
            tests = set(chain(*contexts.values())) - {''}
        if not tests:  # declarations alone, which the pages of reference hold
            tests = {test for test in self.seconds if test.startswith('test/docs/test_reference')}
        tests = sorted((test for test in tests if test in self.seconds), key=self.seconds.get)
        total = accumulate(map(self.seconds.get, tests))
        return [test for test, end in zip(tests, total) if end < MOST_SECONDS]

    def failing(self, copy, tests):
        """Return the first of some tests that fails in a copy of the checkout, or None."""
        if not tests:
            return None
        arguments = copy.with_suffix('.tests')
        arguments.write_text('\n'.join(tests))
        process = subprocess.Popen(
            [sys.executable, *PYTEST, '-rfE', '-m', DECIDE, f'@{arguments}'],
            cwd=copy,
            env={**os.environ, 'PYTHONPATH': f'{copy}:{os.environ.get("PYTHONPATH", "")}'},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        )
        try:
            output, _ = process.communicate(timeout=60.0 + 4.0 * sum(map(self.seconds.get, tests)))
        except subprocess.TimeoutExpired:
            return 'too long'
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if process.returncode == 0:
            return None
        found = re.search(r'^(?:FAILED|ERROR) (.*?)(?: - .*)?$', output, re.MULTILINE)
        return found[1] if found and found[1] in self.seconds else 'import'


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart(nodeid):
    """Name the test that executes the lines from now on: while recording, this is a plugin."""
    coverage.Coverage.current().switch_context(nodeid)


def pytest_runtest_logreport(report):
    """Add up how long each test takes, with its fixtures."""
    DURATIONS[report.nodeid] += report.duration


def pytest_sessionfinish():
    """Write these."""
    SECONDS.write_text(json.dumps(DURATIONS))


def record():
    """Run the tests that decide outside ``test/scenarios``, and record what they execute."""
    RECORD.parent.mkdir(exist_ok=True)
    command = [sys.executable, '-m', 'coverage', 'run', '--source=kalman_ros', *PYTEST]
    command += ['-m', DECIDE, '-p', 'mutants', '--ignore=test/scenarios', 'test']
    command.remove('-x')
    path = f'{Path(__file__).parent}:{os.environ.get("PYTHONPATH", "")}'
    env = {**os.environ, 'PYTHONPATH': path, 'COVERAGE_FILE': str(RECORD)}
    subprocess.run(command, cwd=ROOT, env=env)


def change(before, after):
    """Return the lines that differ, in one line."""
    pairs = zip(before.splitlines(), after.splitlines())
    return next((f'{old.strip()}  ->  {new.strip()}' for old, new in pairs if old != new), '')


def copied(folder):
    """Return a copy of the checkout in a folder."""
    copy = Path(folder) / ROOT.name
    left_out = shutil.ignore_patterns('.git', '.venv*', 'build', 'install', 'log', 'out')
    shutil.copytree(ROOT, copy, ignore=left_out)
    return copy


def try_out(mutant, copies, tests):
    """Make a mutant in a free copy; print and return the test that killed it, or None."""
    copy = copies.get()
    path = copy / mutant.path
    before = path.read_text()
    after = mutate_code(before, get_operator(f'core/{mutant.operator}')(), mutant.occurrence)
    write(path, after)
    killer = tests.failing(copy, tests.of(mutant))
    write(path, before)
    copies.put(copy)
    outcome = 'killed  ' if killer else 'SURVIVED'
    print(f'{outcome} {mutant.path}:{mutant.line}: {change(before, after)}', flush=True)
    return killer


def main():
    """Apply a random sample of mutants and print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--count', type=int, default=40, help='how many mutants (40)')
    parser.add_argument('--seed', type=int, default=0, help='seed of the sample (0)')
    parser.add_argument('--layer', nargs='+', choices=LAYERS, default=BELOW_NODES, metavar='NAME')
    parser.add_argument('--least', type=float, default=0.85, help='share to be killed (0.85)')
    parser.add_argument('--jobs', type=int, default=1, help='how many at a time (1)')
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # which stops the tests, too
    files = [
        path for layer in options.layer for path in (ROOT / 'kalman_ros' / layer).rglob('*.py')
    ]
    mutants = [m for path in sorted(files) for m in mutants_of(path.relative_to(ROOT))]
    sample = Random(options.seed).sample(mutants, min(options.count, len(mutants)))
    if not RECORD.exists():
        record()
    tests, copies = Tests(), Queue()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        for job in range(options.jobs):
            copies.put(copied(f'{folder}/{job}'))
        killers = list(pool.map(lambda mutant: try_out(mutant, copies, tests), sample))
        # a test that fails without a mutant, too, kills nothing
        broken = tests.failing(copies.get(), sorted(set(killers) & set(tests.seconds)))
    killed = sum(map(bool, killers))
    share = killed / len(sample)
    print(f'{killed} of {len(sample)} killed, {share:.0%}, of {len(mutants)} mutants possible')
    if broken:
        print(f'{broken} fails without a mutant, too')
        sys.exit(2)
    sys.exit(share < options.least)


if __name__ == '__main__':
    main()
