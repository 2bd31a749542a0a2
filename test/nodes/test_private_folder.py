# SPDX-License-Identifier: Apache-2.0
"""Folders of killed processes are removed at the next start, and nothing else."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from kalman_ros.nodes.middleware.private_folder import PrivateFolder

OLD = time.time() - 3600.0


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    return tmp_path


def leftover(place, name='kalman_ros_run_abcd1234'):
    folder = place / name
    (folder / 'in').mkdir(parents=True)
    (folder / 'in' / 'estimator.log').write_text('x')
    os.utime(folder, (OLD, OLD))
    return folder


def test_a_folder_ends_with_its_context(temporary):
    with PrivateFolder() as folder:
        (folder / 'a').write_text('x')
    assert not folder.exists()


def test_a_leftover_is_removed_and_what_is_in_use_or_young_is_not(temporary):
    left = leftover(temporary)
    with PrivateFolder() as used:
        os.utime(used, (OLD, OLD))
        young = temporary / 'kalman_ros_run_zzzz9999'
        young.mkdir()
        with PrivateFolder():
            assert used.exists() and young.exists()
    assert not left.exists()


def test_links_and_folders_of_others_stay(temporary):
    outside = leftover(temporary, 'precious')
    link = temporary / 'kalman_ros_run_link0000'
    link.symlink_to(outside)
    others = [leftover(temporary, name) for name in ('kalman_ros_run_', 'kalman_ros_run_A.cd1234')]
    file = temporary / 'kalman_ros_run_file0000'
    file.write_text('x')
    os.utime(file, (OLD, OLD))
    left = leftover(temporary)
    (left / 'way_out').symlink_to(outside)
    os.utime(left, (OLD, OLD))
    with PrivateFolder():
        assert not left.exists()
    assert (outside / 'in' / 'estimator.log').exists()
    assert all(path.exists() for path in (link, file, *others))


@pytest.mark.slow
def test_the_folder_of_a_killed_process_is_a_leftover(temporary):
    script = (
        'import sys; from kalman_ros.nodes.middleware.private_folder import PrivateFolder\n'
        'print(PrivateFolder().path, flush=True); sys.stdin.read()'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, 'TMPDIR': str(temporary)},
    )  # fmt: skip
    folder = Path(process.stdout.readline().strip())
    os.utime(folder, (OLD, OLD))
    with PrivateFolder():
        assert folder.exists()
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    with PrivateFolder():
        assert not folder.exists()
