# SPDX-License-Identifier: Apache-2.0
"""Starts nodes in milliseconds: one process imports the package, and forks a node for each order.

Four nodes take 0.6 s of processor time to start in this way, and 2.5 s as executables. Tests whose
subject is the start or the end of a process run the executables. As a program, this file is the
nursery, with a socket as its standard input.
"""

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path

#: Largest order in bytes: the command and the environment of a node.
_LARGEST = 1 << 20
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG, linux/prctl.h
NODES = ('plant', 'estimator', 'controller', 'monitor', 'microphone_array')
#: What nodes import once they know their parameters.
LATER = (
    'geometry_msgs.msg', 'nav_msgs.msg', 'sensor_msgs.msg', 'std_msgs.msg', 'service_msgs.msg',
    'type_description_interfaces.msg', 'scipy.special',
)  # fmt: skip


def choose(executables):
    """Let the harness start executables, or fork nodes."""
    from kalman_ros.harness.process import NodeProcess, spawn

    NodeProcess.start = staticmethod(spawn if executables else spawn_node)


def spawn_node(command, environment, output):
    """Start a command as `kalman_ros.harness.process.spawn` does; fork it if it is a node."""
    from kalman_ros.harness.process import spawn

    if Path(command[0]).name not in NODES:
        return spawn(command, environment, output)
    return nursery().fork(command, environment, output)


@cache
def nursery():
    """Return the nursery of this process, and end it with this process."""
    found = Nursery()
    atexit.register(found.close)
    return found


class Nursery:
    """A process that forks nodes; it ends with this one."""

    def __init__(self):
        self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, str(Path(__file__))], stdin=theirs, preexec_fn=os.setpgrp
            )

    def fork(self, command, environment, output):
        """Return a node that runs ``command``, with its output in a file."""
        order = {'command': command, 'environment': dict(environment), 'folder': os.getcwd()}
        ours, theirs = socket.socketpair()
        with theirs:
            socket.send_fds(
                self._orders, [json.dumps(order).encode()], [output.fileno(), theirs.fileno()]
            )
        return Child(ours)

    def close(self):
        """End the nursery, and with it the nodes that still run."""
        self._orders.close()
        self._process.wait(10.0)


class Child:
    """A node that was forked elsewhere, with the methods of `subprocess.Popen` that are used."""

    def __init__(self, link):
        self._link = link.makefile('r')
        self.pid = int(self._link.readline())
        self.returncode = None

    def poll(self):
        """Return the exit code, or None while the node runs."""
        return self._read(0.0)

    def wait(self, timeout=None):
        """Return the exit code once there is one; raise TimeoutExpired without one in time."""
        code = self._read(timeout)
        if code is None:
            raise subprocess.TimeoutExpired('node', timeout)
        return code

    def _read(self, timeout):
        if self.returncode is None and select.select([self._link], [], [], timeout)[0]:
            # without a word if the nursery ended before it
            self.returncode = int(self._link.readline() or -signal.SIGKILL)
            self._link.close()
        return self.returncode


def serve():
    """Fork a node for each order; return its command in the fork, None after the last order."""
    orders = socket.socket(fileno=os.dup(0))
    links = {}
    wake, waker = os.pipe()
    os.set_blocking(waker, False)
    signal.set_wakeup_fd(waker)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    while True:
        ready = select.select([orders, wake], [], [])[0]
        if wake in ready:
            os.read(wake, 4096)
            report_ended(links)
        if orders in ready:
            text, fds, _, _ = socket.recv_fds(orders, _LARGEST, 2)
            if not text:
                return None
            order, (output, link) = json.loads(text), fds
            pid = os.fork()
            if not pid:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                become(order, output)
                os.close(output)
                for each in (link, wake, waker, *links.values()):
                    os.close(each)
                orders.close()
                return order['command']
            os.write(link, f'{pid}\n'.encode())
            os.close(output)
            links[pid] = link


def report_ended(links):
    """Tell the exit codes of the nodes that have ended."""
    while links:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if not pid:
            return
        with contextlib.suppress(BrokenPipeError):
            os.write(links[pid], f'{os.waitstatus_to_exitcode(status)}\n'.encode())
        os.close(links.pop(pid))


def become(order, output):
    """Be as a process that was started with the environment, the folder and the output."""
    os.setpgrp()
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)
    devnull = os.open(os.devnull, os.O_RDONLY)
    for ours, standard in ((devnull, 0), (output, 1), (output, 2)):
        os.dup2(ours, standard)
    os.close(devnull)
    os.chdir(order['folder'])
    before = [entry for entry in os.environ.get('PYTHONPATH', '').split(os.pathsep) if entry]
    os.environ.clear()
    os.environ.update(order['environment'])
    now = [entry for entry in os.environ.get('PYTHONPATH', '').split(os.pathsep) if entry]
    rest = [entry for entry in sys.path[1:] if entry not in before]
    sys.path[:] = [str(Path(order['command'][0]).parent), *now, *rest]
    importlib.invalidate_caches()
    sys.argv[:] = order['command']


def prepare():
    """Import what nodes import."""
    from kalman_ros import entry, scenario
    from kalman_ros.scenario.regulator import feedback

    for name in (*(f'kalman_ros.nodes.{node}.node' for node in NODES), *LATER):
        importlib.import_module(name)
    feedback(scenario.build({}))  # some imports are late
    gc.collect()
    gc.freeze()
    return entry


def main():
    """Prepare, then serve; a fork runs the node of its command."""
    entry = prepare()
    command = serve()
    if command is not None:
        sys.exit(getattr(entry, Path(command[0]).name)())


if __name__ == '__main__':
    main()
