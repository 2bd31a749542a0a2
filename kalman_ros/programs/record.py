# SPDX-License-Identifier: Apache-2.0
"""Record topics, byte for byte, into a folder that `replay`, ros2 bag and viewers read."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from math import inf
from pathlib import Path
from threading import Event

from kalman_ros.bags.feed import TICK
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import estimator_settings
from kalman_ros.harness.graph_recorder import GraphRecorder
from kalman_ros.pipeline.estimate_topics import published_signals
from kalman_ros.pipeline.initial_pose import POSES
from kalman_ros.programs.common_arguments import Once
from kalman_ros.programs.refusal import refuse


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='record',
        description='Record topics, byte for byte, until Ctrl-C: those of a parameter file, those '
        'that are named, or all.',
        epilog='Exit code: 0 if something was recorded, 1 if nothing was, 2 if it could not run.',
    )
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='names of topics')
    parser.add_argument(
        '--params-file', metavar='FILE', action=Once,
        help='record what an estimator with this parameter file reads and publishes, the input, '
        'and ground_truth',
    )  # fmt: skip
    parser.add_argument('--out', type=Path, required=True, metavar='DIR', help='a new folder')
    parser.add_argument(
        '--duration', type=float, default=inf, metavar='S', help='seconds (default: until Ctrl-C)'
    )
    return parser.parse_args(argv)


def topics_of(file: str) -> list[str]:
    """Return the topics of the estimator with a parameter file, and of the loop around it."""
    scenario = estimator_settings(file).scenario
    topics = [source.signal.topic for source in scenario.enabled.values()]
    if scenario.input.fields:
        topics.append(scenario.input.topic)
    topics += [signal.topic for signal in published_signals(scenario)]
    return [*topics, 'ground_truth', TICK, *POSES, '/clock']


def main(argv: Sequence[str] | None = None) -> None:
    """Record until a signal or the end of the duration."""
    options = arguments(argv)
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    try:
        if not options.duration > 0.0:
            raise ValueError(f'--duration: expected a positive number, got {options.duration:g}')
        if options.params_file and options.topics:
            raise ValueError('expected --params-file or names of topics, got both')
        topics = topics_of(options.params_file) if options.params_file else options.topics
        writer = RecordingWriter(options.out)
    except (ValueError, OSError) as error:
        refuse('record', error)
    recorder = GraphRecorder(writer, topics)
    print(f'recording into {options.out} until Ctrl-C', flush=True)
    try:
        recorder.run(stop, options.duration)
    finally:
        recorder.close()
        writer.close()
    for topic, why in recorder.refused.items():
        print(f'{topic}: not recorded: {why}')
    if recorder.absent and (options.topics or not writer.count):
        print(f'nobody published {", ".join(recorder.absent)}')
    print(f'{writer.count} messages of {len(recorder.topics)} topics in {options.out}')
    sys.exit(0 if writer.count else 1)
