# SPDX-License-Identifier: Apache-2.0
"""The loop in real time with faults on; `soak` goes on for longer."""

import json
import subprocess
import sys

import pytest
from tools.paths import with_tools


@pytest.mark.real_time
@pytest.mark.timeout(200)
def test_the_loop_endures(tmp_path):
    command = [sys.executable, '-m', 'tools', 'soak', '--minutes', '1', '--out', str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=160, env=with_tools())
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'Every promise holds.' in done.stdout
    assert json.loads((tmp_path / 'summary.json').read_text())
    assert (tmp_path / 'soak.png').stat().st_size > 10_000
