# SPDX-License-Identifier: Apache-2.0
"""A node as a process of its own, which does not outlive the one that started it."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier as rmw

from kalman_ros.nodes.transport import PROFILES, PROMPT, RANGE, loopback

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG, linux/prctl.h


class NodeProcess:
    """Starts an executable in a process group of its own and keeps what it prints.

    Parameters
    ----------
    name
        What it is called in messages.
    command
        The program and its arguments.
    environment
        All of its environment.
    log
        The file that takes its output.
    """

    def __init__(
        self, name: str, command: Sequence[str], environment: Mapping[str, str], log: Path
    ) -> None:
        self.name = name
        self.log = log
        with log.open('wb') as output:
            self._process = subprocess.Popen(
                command,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    @property
    def pid(self) -> int:
        """The process id, which is also that of its group."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """The exit code; None while it runs, negative if a signal ended it."""
        return self._process.poll()

    def signal(self, number: int) -> None:
        """Send a signal to the whole group; nothing happens if it is gone."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def wait(self, seconds: float) -> bool:
        """Wait for the end and tell whether it came in time."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self, patience: float = 5.0) -> None:
        """Ask it to end, and insist."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self.exit_code is not None:
                return
            self.signal(number)
            if self.wait(patience):
                return

    def output(self) -> str:
        """Return what it has printed so far."""
        return self.log.read_text(errors='replace')

    def last_words(self) -> str:
        """Return the last line that it printed, or how it ended."""
        lines = self.output().strip().splitlines()
        return lines[-1] if lines else f'exit code {self.exit_code}'


def isolated(domain: int, *, sockets: bool = False) -> dict[str, str]:
    """Have this process stay on this machine; return its environment with a ROS domain.

    Nodes that start together find each other at once there; see ``nodes/prompt.xml``. They may
    be told to use ``sockets`` alone: memory that they share with Fast DDS is quicker, but a
    process that is killed may leave it locked, and who publishes then waits for seconds.
    Your own profile of Fast DDS comes first.
    """
    os.environ[RANGE] = 'LOCALHOST'
    if not any(os.environ.get(name) for name in PROFILES):
        os.environ.update(dict.fromkeys(PROFILES, str(PROMPT)))
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    ours = environment.get(PROFILES[0]) == str(PROMPT) and rmw().startswith('rmw_fastrtps')
    if sockets and ours:
        environment.update(loopback())
    return environment


def _die_with_parent() -> None:
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)
