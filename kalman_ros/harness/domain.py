# SPDX-License-Identifier: Apache-2.0
"""Reservation of a ROS domain that no other run on this machine uses."""

from __future__ import annotations

import os
import socket

# Domains up to 101 avoid Linux's ephemeral ports; 0 is the default of all.
_DOMAINS = range(1, 102)


class Domain:
    """A reserved domain id; other instances get other ids until it is closed.

    The reservation is a name in the abstract socket namespace of Linux (unix(7)). It is not in the
    file system, so it cannot be replaced by a link or a file. It is shared by all users, and by
    exactly the network namespaces that share the ports of the domain. It ends with the process.
    """

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
        """Release the domain."""
        self._lock.close()


def _lock(domain: int) -> socket.socket | None:
    """Return a lock on a domain; None if the domain or its first port is in use."""
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f'\0kalman_ros/domain/{domain}')
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            # the first participant's unicast port: DDSI-RTPS 2.5, section 9.6.2.4
            probe.bind(('127.0.0.1', 7400 + 250 * domain + 10))
    except OSError:
        lock.close()
        return None
    return lock
