# SPDX-License-Identifier: Apache-2.0
"""Whether all who are to hear each other do: what is published before is lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from kalman_ros.nodes.diagnostics import PUBLISHERS, SUBSCRIBERS


def missing(
    names: Iterable[str], said: Mapping[str, DiagnosticStatus], recorded: Iterable[str]
) -> str:
    """Return what is still missing; nothing if every connection is there.

    Parameters
    ----------
    names
        Of the nodes.
    said
        What each of them last said of itself on ``/diagnostics``.
    recorded
        The full names of the topics that are listened to here.
    """
    silent = [name for name in names if name not in said]
    if silent:
        return f'nothing received from {", ".join(silent)}'
    connections = [
        (value.key, int(value.value))
        for name in names
        for value in said[name].values
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
