# SPDX-License-Identifier: Apache-2.0
"""Find what is wrong with a recording and its parameters: causes, proofs, lines to change.

Without a parameter file: describe the recording, and propose one.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.diagnosis import first_look
from kalman_ros.analysis.diagnosis.diagnose import PROOF, Diagnosis, diagnose
from kalman_ros.analysis.diagnosis.evidence import Evidence
from kalman_ros.bags.reading import Bag
from kalman_ros.programs.common_arguments import Once, add_parameters, add_part
from kalman_ros.programs.refusal import interruptible, refuse
from kalman_ros.programs.results import of_recording, ready
from kalman_ros.scenario.parameter_files import overrides

from .loading import failed_checks, load
from .proposal import describe, propose
from .proposal_tables import matches_table, topics_table
from .tables import findings_table, first_sight, sentences, summary, unexplained, verdict


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='doctor', description=__doc__,
        epilog='Exit code: 0 if nothing was found or a file proposed, 1 if something was found, '
        '2 for a bad argument or if no scenario fits.',
    )  # fmt: skip
    parser.add_argument(
        'bag',
        type=Path,
        metavar='BAG',
        help='a folder of rosbag2, one of its files, or a bag of ROS 1',
    )
    parser.add_argument(
        '--params-file', type=Path, metavar='FILE', action=Once,
        help="the estimator's parameter file, or the name of a scenario",
    )  # fmt: skip
    add_parameters(parser, 'a parameter, over those of the file')
    add_part(parser)
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/BAG/doctor)'
    )
    return parser.parse_args(argv)


@interruptible('doctor')
def main(argv: Sequence[str] | None = None) -> None:
    """Diagnose a bag; exit with 1 if there is a finding."""
    options = arguments(argv)
    console = Console(highlight=False)
    try:
        if not options.bag.exists():
            raise FileNotFoundError(2, 'no such file or folder', str(options.bag))
        folder = ready(options.out or of_recording(options.bag, 'doctor'))
        changes = overrides(options.parameters)
        if options.params_file is None and not changes:
            sys.exit(describe_and_propose(options.bag, folder, console))
        with _without_collector(), _show_progress(console) as progress:
            progress('replaying the recording')
            part = options.start, options.end
            evidence = load(options.bag, options.params_file, changes, part)
            show_first_look(evidence, progress, console)
            diagnosis = diagnose(evidence, progress)
            failed = [] if diagnosis.findings else failed_checks(evidence)
    except (ValueError, OSError) as error:
        refuse('doctor', error)
    show(diagnosis, failed, options.bag.name, folder, console)
    sys.exit(1 if diagnosis.findings else 0)


def describe_and_propose(path: Path, folder: Path, console: Console) -> int:
    """Print the topics of a recording, write a parameter file for it, and return the exit code."""
    bag = Bag(path)
    with _show_progress(console) as progress:
        progress('reading the recording')
        topics = describe(bag)
        progress('comparing it with the shipped scenarios')
        proposals = propose(bag)
    console.print('What it has:', style='bold')
    console.print(topics_table(topics))
    if not proposals:
        console.print()
        console.print('No topic fits a sensor of a shipped scenario. How to describe a robot of')
        console.print("one's own: docs/how_to/own_robot.md")
        return 2
    console.print('\nWhat fits it best, with rates and noise as measured:', style='bold')
    console.print(matches_table(proposals))
    file = folder / 'proposal.yaml'
    file.write_text(proposals[0].yaml())
    console.print(f'\n{file}: {proposals[0].scenario} with these topics, rates and noise.')
    console.print('Check its model_parameters, then:', markup=False)
    console.print(f'    ./dev doctor {path} --params-file {file}', markup=False, soft_wrap=True)
    return 0


def show_first_look(evidence: Evidence, progress: Callable[[str], None], console: Console) -> None:
    """Print the findings in a short part of a long recording, before the whole is examined."""
    first = first_look.part(evidence)
    if first is None:
        return
    part, begin, end = first
    progress(f'a first look, from t = {begin:.3g} to {end:.3g} s')
    try:
        diagnosis = diagnose(part, proofs=False)
    except (ValueError, np.linalg.LinAlgError):
        return  # it is too short for this recording, and the whole is examined next
    console.print(first_sight(diagnosis, begin, end), style='dim')


@contextmanager
def _without_collector() -> Iterator[None]:
    """Disable the garbage collector: filter passes create many objects but no cycles."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextmanager
def _show_progress(console: Console) -> Iterator[Callable[[str], None]]:
    """Show the current task and the elapsed time."""
    columns = SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task('')
        yield lambda text: bar.update(task, description=text)


def show(
    diagnosis: Diagnosis, failed: Sequence[Check], name: str, folder: Path, console: Console
) -> None:
    """Print the diagnosis of a recording, draw it, and write ``summary.json``.

    The checks that ``failed`` in its replay are printed as a note.
    """
    from kalman_ros.report import diagnosis_pictures, style  # matplotlib is slow to load

    if diagnosis.findings:
        console.print(findings_table(diagnosis))
        replayed = f'the first {PROOF:g} s in which its sensor moves, with this change alone'
        console.print(f'By replay: {replayed}.', style='dim')
        console.print()
    for sentence in (*sentences(diagnosis), *unexplained(failed)):
        console.print(sentence, markup=False)
    with style.caption(f'doctor, {name}'):
        drawn = diagnosis_pictures.draw(diagnosis.findings, folder)
    (folder / 'summary.json').write_text(json.dumps(summary(diagnosis), indent=2) + '\n')
    names = ', '.join(['summary.json', *(path.name for path in drawn)])
    console.print(f'In {folder}: {names}', style='dim')
    console.print(verdict(diagnosis, failed))
