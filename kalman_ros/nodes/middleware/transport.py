# SPDX-License-Identifier: Apache-2.0
"""How Fast DDS transports messages between the processes of one machine, and discovery."""

from __future__ import annotations

import os
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier as rmw

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
#: The variables with the file of profiles: Fast DDS 2 reads the first, Fast DDS 3 the second.
PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: Nodes that start together discover each other at once; the transport is unchanged.
PROMPT = Path(__file__).with_name('prompt.xml')
#: The same over UDP on the loopback interface alone.
LOOPBACK = Path(__file__).with_name('loopback.xml')

_LOCALHOST_ONLY, _TRANSPORTS = 'ROS_LOCALHOST_ONLY', 'FASTDDS_BUILTIN_TRANSPORTS'
_USERS_VARIABLES = (*PROFILES, _TRANSPORTS, 'ROS_DISCOVERY_SERVER')
#: Fast DDS reads these from the working directory.
_USERS_FILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')


def prefer_sockets() -> None:
    """Make Fast DDS use UDP and announce this process at once; call it before ``rclpy.init``.

    Fast DDS prefers shared memory between processes of one machine. A killed process leaves it
    locked, and publishers to its replacement block for seconds. Messages of this size are as fast
    over UDP.

    If the user has configured Fast DDS, or runs another middleware, nothing changes.
    """
    named = any(os.environ.get(name) for name in _USERS_VARIABLES)
    if named or any(map(os.path.exists, _USERS_FILES)) or not rmw().startswith('rmw_fastrtps'):
        return
    if _stays_local():
        os.environ.pop(_LOCALHOST_ONLY, None)
        os.environ.update(loopback())
    else:
        os.environ.update({_TRANSPORTS: 'UDPv4', **profiles(PROMPT)})


def profiles(path: Path) -> dict[str, str]:
    """Return the environment in which Fast DDS reads a file of profiles.

    Fast DDS 3 warns of the variable of Fast DDS 2, in every process, and has renamed an element:
    its files are those whose names end in 3.
    """
    rmw()  # loads the middleware
    try:
        loaded = Path('/proc/self/maps').read_text()
    except OSError:
        loaded = ''
    if 'libfastdds' in loaded:
        return {PROFILES[1]: str(path.with_stem(f'{path.stem}_3'))}
    return {PROFILES[0]: str(path)}


def loopback() -> dict[str, str]:
    """Return the environment that keeps a process on this machine, over UDP.

    Within the range LOCALHOST rmw_fastrtps adds shared memory to any profile. So the range is
    the system's default, and the profile keeps the messages here.
    """
    return {RANGE: 'SYSTEM_DEFAULT', **profiles(LOOPBACK)}


def _stays_local() -> bool:
    """Return whether the environment asks for this machine alone."""
    if os.environ.get('ROS_STATIC_PEERS'):  # which the range SYSTEM_DEFAULT would ignore
        return False
    return os.environ.get(RANGE) == 'LOCALHOST' or os.environ.get(_LOCALHOST_ONLY) == '1'
