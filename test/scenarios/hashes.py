# SPDX-License-Identifier: Apache-2.0
"""One hash per shipped scenario of every byte that a short run in lockstep records.

A change that keeps behaviour keeps these: write them before, compare after.

    . install/setup.sh
    python test/scenarios/hashes.py --write /tmp/before.json
    python test/scenarios/hashes.py --compare /tmp/before.json

Exit code: 0 if nothing differs, 1 if a scenario does, 2 if one could not be run.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from kalman_ros.harness import NodeError, Run
from kalman_ros.scenario import shipped

#: The scenarios of ``config/``, by name.
SCENARIOS = sorted(path.stem for path in shipped.folder().glob('*.yaml'))


def digest(messages: Mapping[str, Sequence[bytes]]) -> str:
    """Return one SHA-256 over the messages of every topic, in their order within a topic."""
    whole = hashlib.sha256()
    for topic in sorted(messages):
        whole.update(f'{topic} {len(messages[topic])}\n'.encode())
        for data in messages[topic]:
            whole.update(len(data).to_bytes(8, 'little') + bytes(data))
    return whole.hexdigest()


def recorded(scenario: str, duration: float, seed: int = 0) -> dict[str, list[bytes]]:
    """Return the bytes of every message of a run in lockstep, by topic."""
    with Run(scenario, seed=seed) as run:
        run.advance(duration)
        return {topic: list(map(bytes, found)) for topic, found in run.recorder.raw.items()}


def main() -> None:
    """Print the table; see the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('scenarios', nargs='*', default=SCENARIOS, help='default: all in config/')
    parser.add_argument('--duration', type=float, default=2.0, help='simulated seconds')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--write', type=Path, metavar='FILE', help='keep the hashes in FILE')
    parser.add_argument('--compare', type=Path, metavar='FILE', help='with hashes kept before')
    options = parser.parse_args()
    before = json.loads(options.compare.read_text()) if options.compare else {}
    found: dict[str, dict[str, str]] = {}
    bad = 0
    for name in options.scenarios:
        start = time.monotonic()
        try:
            messages = recorded(name, options.duration, options.seed)
        except (NodeError, RuntimeError, ValueError) as error:
            print(f'{name:24}{error}', flush=True)
            bad = 2
            continue
        found[name] = {topic: digest({topic: data}) for topic, data in messages.items()}
        found[name]['all'] = digest(messages)
        known = before.get(name)
        differing = (
            sorted(key for key in known if found[name].get(key) != known[key]) if known else []
        )
        note = f'DIFFERS: {", ".join(differing)}' if differing else 'same' if known else ''
        count = sum(map(len, messages.values()))
        taken = time.monotonic() - start
        print(f'{name:24}{found[name]["all"][:32]}{count:8}{taken:7.1f} s  {note}', flush=True)
        bad = max(bad, int(bool(differing)))
    if options.write:
        options.write.write_text(json.dumps(found, indent=2) + '\n')
    sys.exit(bad)


if __name__ == '__main__':
    main()
