# SPDX-License-Identifier: Apache-2.0
"""A domain is held by this process alone, and by nothing that another user could tamper with."""

import os
import subprocess
import sys
import tempfile

import pytest

from kalman_ros.harness.domain import Domain

HOLDER = """
from kalman_ros.harness.domain import Domain
domain = Domain()
print(domain.id, flush=True)
input()
"""


def test_nothing_in_the_temporary_folder_is_followed_or_truncated(tmp_path, monkeypatch):
    """Links and folders stand where there was a lock file once; nothing of them changes."""
    victim = tmp_path / 'victim'
    victim.write_text('precious')
    for domain in range(1, 102):
        trap = tmp_path / f'kalman_ros_domain_{os.getuid()}_{domain}.lock'
        if domain % 2:
            trap.symlink_to(victim)
        else:
            trap.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    before = sorted(tmp_path.iterdir())
    domains = [Domain() for _ in range(4)]
    assert len({domain.id for domain in domains}) == 4
    for domain in domains:
        domain.close()
    assert victim.read_text() == 'precious'
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_a_domain_is_held_until_its_process_ends(monkeypatch):
    process = subprocess.Popen(
        [sys.executable, '-c', HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        taken = int(process.stdout.readline())
        monkeypatch.setattr('kalman_ros.harness.domain._DOMAINS', range(taken, taken + 1))
        with pytest.raises(RuntimeError, match='all ROS domains'):
            Domain()
    finally:
        process.kill()
        process.wait()
    domain = Domain()
    assert domain.id == taken
    domain.close()
