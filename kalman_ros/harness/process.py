# SPDX-License-Identifier: Apache-2.0
"""Node as a child process that does not outlive its parent."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from rclpy.utilities import get_rmw_implementation_identifier as rmw

from kalman_ros.nodes.middleware.transport import PROFILES, PROMPT, RANGE, loopback, profiles

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG, linux/prctl.h


def spawn(
    command: Sequence[str], environment: Mapping[str, str], output: IO[bytes]
) -> subprocess.Popen[bytes]:
    """Start a command with a complete environment and its output in a file."""
    return subprocess.Popen(
        command,
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        preexec_fn=_lead_a_group,
    )


class NodeProcess:
    """A running executable in a new process group, with its output in a file.

    Parameters
    ----------
    name
        Name in messages.
    command
        Program and its arguments.
    environment
        Complete environment of the process.
    log
        File for the output.
    """

    #: Starts the process.
    start = staticmethod(spawn)

    def __init__(
        self, name: str, command: Sequence[str], environment: Mapping[str, str], log: Path
    ) -> None:
        self.name = name
        self.log = log
        with log.open('wb') as output:
            self._process = self.start(command, environment, output)

    @property
    def pid(self) -> int:
        """Id of the process, which is also the id of its group."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while the process runs, negative if a signal ended it."""
        return self._process.poll()

    def signal(self, number: int) -> None:
        """Send a signal to the whole group; ignored if the group has ended."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def wait(self, seconds: float) -> bool:
        """Wait for the end of the process; return whether it ended within ``seconds``."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def stop(self, patience: float = 5.0) -> None:
        """Terminate the process, with a stronger signal after each ``patience`` seconds."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self.exit_code is not None:
                return
            self.signal(number)
            if self.wait(patience):
                return

    def output(self) -> str:
        """Return the output so far."""
        return self.log.read_text(errors='replace')

    def last_words(self) -> str:
        """Return the signal that ended the process, its last line of output, or its exit code."""
        code = self.exit_code
        if code is not None and code < 0:
            return f'ended by {signal.Signals(-code).name}'
        lines = self.output().strip().splitlines()
        return lines[-1] if lines else f'exit code {code}'


def isolated(domain: int, *, sockets: bool = False) -> dict[str, str]:
    """Restrict this process to this machine; return its environment with a ROS domain.

    Nodes that start together discover each other at once, see ``nodes/middleware/prompt.xml``.
    With ``sockets``, nodes do not use shared memory. It is faster, but a killed process may leave
    it locked, and publishers then block for seconds. The user's Fast DDS profile has priority.
    """
    os.environ[RANGE] = 'LOCALHOST'
    if not any(os.environ.get(name) for name in PROFILES):
        os.environ.update(profiles(PROMPT))
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    prompt = profiles(PROMPT).items() <= environment.items()
    if sockets and prompt and rmw().startswith('rmw_fastrtps'):
        environment.update(loopback())
    return environment


def _lead_a_group() -> None:
    """Lead a process group, and die with the parent.

    The process stays in the session of its parent: Linux distributes processor time among sessions
    first (autogroups, sched(7)), and a node in a separate session starved beside busy nodes of
    another session.
    """
    os.setpgrp()
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)
