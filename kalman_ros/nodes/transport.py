# SPDX-License-Identifier: Apache-2.0
"""Which way messages take between the processes of one machine."""

from __future__ import annotations

import os


def prefer_sockets() -> None:
    """Have Fast DDS use sockets, unless the environment names a transport.

    Where a process was killed that shared memory with this one, publishing would wait for up to
    some seconds when it returns: a plant or a controller could do nothing meanwhile. Messages as
    small as these are as fast by socket. Within ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST Fast DDS
    takes no notice of this.
    """
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
