# SPDX-License-Identifier: Apache-2.0
"""Counts of messages that a node has published, so that receivers can detect losses."""

from __future__ import annotations

import json
from typing import Any

from std_srvs.srv import Trigger

from .host import Host

#: The service of each node that answers with the counts.
SERVICE = 'published'


def counted(publisher: Any) -> Any:
    """Return a publisher that counts messages in its attribute ``published``."""
    publish = publisher.publish
    publisher.published = 0

    def publish_and_count(message: Any) -> None:
        publish(message)
        publisher.published += 1

    publisher.publish = publish_and_count
    return publisher


class PublishedCounts:
    """The service ``~/published`` of a node: a JSON object from full topic names to counts."""

    def __init__(self, node: Host) -> None:
        self._node = node
        node.create_service(Trigger, f'~/{SERVICE}', self._answer)

    def __call__(self) -> dict[str, int]:
        """Return the count of each topic that the node publishes on."""
        counts: dict[str, int] = {}
        for publisher in self._node.publishers:
            name, count = publisher.topic_name, getattr(publisher, 'published', None)
            if count is not None:
                counts[name] = counts.get(name, 0) + count
        return counts

    def _answer(self, _: Any, response: Any) -> Any:
        response.success, response.message = True, json.dumps(self())
        return response
