# SPDX-License-Identifier: Apache-2.0
"""Nodes as a person starts them: each by ``./dev NODE`` in a terminal, with a parameter file."""

import os
import signal
import tempfile
import time
from pathlib import Path

from kalman_ros.harness import executables
from kalman_ros.harness.isolated_context import IsolatedContext
from kalman_ros.harness.process import NodeProcess
from kalman_ros.nodes.middleware.transport import PROFILES


class Terminals:
    """Processes of one ROS domain by name, and a node that receives their messages."""

    def __init__(self, *arguments):
        self.arguments, self.processes = arguments, {}
        self._context = IsolatedContext('witness', sockets=True)
        self.node = self._context.node
        self._folder = tempfile.TemporaryDirectory()
        keep = {name: value for name, value in os.environ.items() if name not in PROFILES}
        own = {'ROS_DOMAIN_ID': str(self._context.domain)}
        #: What ``./dev`` sets, and no more.
        self.environment = {**keep, **own, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self.processes.values():
            process.signal(signal.SIGTERM)
        for process in self.processes.values():
            process.wait(5.0)
            process.stop()
        self._context.close()
        self._folder.cleanup()

    def start(self, name, *arguments, program=None):
        """Start a node with further arguments; of the program of the same name by default."""
        command = [str(executables.executable(program or name)), *self.arguments, *arguments]
        log = Path(self._folder.name) / f'{name}.log'
        self.processes[name] = NodeProcess(name, command, self.environment, log)

    def kill(self, name):
        """Kill a node at once."""
        process = self.processes.pop(name)
        process.signal(signal.SIGKILL)
        assert process.wait(30.0)  # even that takes processor time

    def said(self, name):
        """Return what a node has printed."""
        return self.processes[name].output()

    def spin(self, seconds):
        """Receive messages; none of the nodes may have ended."""
        self._context.spin(seconds)
        for name, process in self.processes.items():
            assert process.exit_code is None, f'{name}: {process.last_words()}'

    def wait(self, condition, seconds, trouble):
        """Receive messages until ``condition`` holds."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, trouble()
            self.spin(0.02)
