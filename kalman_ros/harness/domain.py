# SPDX-License-Identifier: Apache-2.0
"""A ROS domain that nobody else on this machine uses."""

from __future__ import annotations

import fcntl
import os
import socket
import tempfile
from pathlib import Path
from typing import IO

# Domains up to 101 keep clear of the ports that Linux hands out by itself; 0 is everybody's.
_DOMAINS = range(1, 102)


class Domain:
    """Holds a domain id until it is closed; others who ask in this way get another one."""

    def __init__(self) -> None:
        start = os.getpid() % len(_DOMAINS)
        for offset in range(len(_DOMAINS)):
            candidate = _DOMAINS[(start + offset) % len(_DOMAINS)]
            lock = _lock(candidate)
            if lock is not None:
                self.id, self._lock = candidate, lock
                return
        raise RuntimeError('all ROS domains of this machine are in use')

    def close(self) -> None:
        """Give the domain back."""
        self._lock.close()


def _lock(domain: int) -> IO[str] | None:
    """Return an open lock on a domain, None if it is taken or its first port is."""
    path = Path(tempfile.gettempdir()) / f'kalman_ros_domain_{os.getuid()}_{domain}.lock'
    lock = path.open('w')
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            # the first participant's unicast port: DDSI-RTPS 2.5, section 9.6.2.4
            probe.bind(('127.0.0.1', 7400 + 250 * domain + 10))
    except OSError:
        lock.close()
        return None
    return lock
