# SPDX-License-Identifier: Apache-2.0
"""Check that all nodes are connected, since earlier messages are lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from kalman_ros.nodes.middleware.diagnostics import PUBLISHERS, SUBSCRIBERS


def missing(
    names: Iterable[str], reported: Mapping[str, DiagnosticStatus], recorded: Iterable[str]
) -> str:
    """Return a description of a missing connection; '' if every connection exists.

    Parameters
    ----------
    names
        Names of the nodes.
    reported
        Last ``/diagnostics`` of each node.
    recorded
        Full names of the recorded topics.
    """
    silent = [name for name in names if name not in reported]
    if silent:
        return f'nothing received from {", ".join(silent)}'
    connections = [
        (value.key, int(value.value))
        for name in names
        for value in reported[name].values
        if value.key.startswith((SUBSCRIBERS, PUBLISHERS))
    ]
    listeners = Counter(recorded)
    listeners.update(
        key[len(PUBLISHERS) :] for key, _ in connections if key.startswith(PUBLISHERS)
    )
    for key, count in connections:
        topic = key[len(SUBSCRIBERS) :]
        if key.startswith(SUBSCRIBERS) and count < listeners[topic]:
            return f'{count} of {listeners[topic]} subscribers of {topic} are connected'
    return ''
