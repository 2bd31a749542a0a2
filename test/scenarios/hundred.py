# SPDX-License-Identifier: Apache-2.0
"""Many runs side by side, beside busy processes: each complete, each with the quiet run's bytes.

    . install/setup.sh
    python test/scenarios/hundred.py --runs 100 --together 7 --busy 8

Exit code: 0 if every run is complete and has the bytes of the run that was alone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hashes import SCENARIOS

_HASHES = Path(__file__).with_name('hashes.py')
#: Seconds after which a run is taken to stand still.
_LONGEST = 600.0
_BUSY = (sys.executable, '-c', 'while True: pass')


def one(name: str, duration: float, quiet: Path) -> tuple[str, str, float]:
    """Return a scenario's name, what became of its run, and how long it took in seconds."""
    start = time.monotonic()
    command = [sys.executable, str(_HASHES), name, '--duration', str(duration)]
    try:
        done = subprocess.run(
            [*command, '--compare', str(quiet)], capture_output=True, text=True, timeout=_LONGEST
        )
    except subprocess.TimeoutExpired:
        return name, 'stands still', time.monotonic() - start
    fates = {0: 'same bytes', 1: 'other bytes'}
    fate = fates.get(
        done.returncode, (done.stdout + done.stderr).strip().replace('\n', ' ')[-200:]
    )
    return name, fate, time.monotonic() - start


def main() -> None:
    """Run them and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=100)
    parser.add_argument('--together', type=int, default=7)
    parser.add_argument('--busy', type=int, default=8)
    parser.add_argument('--duration', type=float, default=4.0, help='simulated seconds')
    parser.add_argument(
        '--quiet', type=Path, metavar='FILE', help='hashes that hashes.py wrote for this duration'
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        quiet = options.quiet or Path(folder) / 'quiet.json'
        if options.quiet is None:
            command = [sys.executable, str(_HASHES), '--duration', str(options.duration)]
            subprocess.run([*command, '--write', str(quiet)], check=True)
        assert json.loads(quiet.read_text()).keys() == {*SCENARIOS}
        busy = [subprocess.Popen(_BUSY) for _ in range(options.busy)]
        try:
            with ThreadPoolExecutor(options.together) as pool:
                jobs = [
                    pool.submit(one, SCENARIOS[i % len(SCENARIOS)], options.duration, quiet)
                    for i in range(options.runs)
                ]
                found = []
                for job in jobs:
                    found.append(job.result())
                    name, fate, seconds = found[-1]
                    print(f'{len(found):4} {name:24}{seconds:7.1f} s  {fate}', flush=True)
        finally:
            for process in busy:
                process.kill()
    same = sum(fate == 'same bytes' for _, fate, _ in found)
    print(f'{same} of {len(found)} complete, with the bytes of the run that was alone')
    sys.exit(same != len(found))


if __name__ == '__main__':
    main()
