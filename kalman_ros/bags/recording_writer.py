# SPDX-License-Identifier: Apache-2.0
"""Writer of recordings: folders of rosbag2 with one MCAP file and `metadata.yaml`.

The bytes of messages are written as they are, never decoded. The writer of rosbags is not used,
since its files have neither an index nor metadata before they are closed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from .definitions import definition
from .mcap_writer import McapWriter

_LIBRARY = 'kalman_ros'
#: Name of the metadata, and of the file that replaces it once it is complete.
_METADATA, _NEW_METADATA = 'metadata.yaml', 'metadata.tmp'
#: Quality of service of a topic about which nothing is known, as rosbag2 writes it.
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}
_QUALITY = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _FOREVER,
    'lifespan': _FOREVER,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _FOREVER,
    'avoid_ros_namespace_conventions': False,
}


class _Topic(NamedTuple):
    name: str
    kind: str
    qualities: str
    digest: str


class RecordingWriter:
    """A folder of rosbag2 that can be read at any time, up to the last flush.

    Use as a context manager, or `close` it.

    Parameters
    ----------
    folder
        Folder that is created, with its parents; it must be empty if it exists.
    replace
        Whether a recording that was written into the same folder before is replaced.

    Raises
    ------
    ValueError
        If the folder is not empty, or cannot be created.
    """

    def __init__(self, folder: str | Path, *, replace: bool = False) -> None:
        self._folder = Path(folder)
        self._name = f'{self._folder.resolve().name}_0.mcap'
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if replace and {file.name for file in self._folder.iterdir()} <= self._files:
                for name in self._files:
                    (self._folder / name).unlink(missing_ok=True)
            if any(self._folder.iterdir()):
                raise ValueError(f"'{self._folder}' is not empty: expected a new folder")
        except OSError as error:
            raise ValueError(f"cannot make '{self._folder}': {error.strerror}") from None
        self._file = McapWriter(self._folder / self._name, _LIBRARY)
        self._topics: list[_Topic] = []
        self._numbers: dict[str, int] = {}
        self._waiting: list[tuple[int, int, bytes, int]] = []
        self._closed = False
        self._describe()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _files(self) -> set[str]:
        """Names of the files that are written."""
        return {self._name, _METADATA, _NEW_METADATA}

    def __contains__(self, topic: str) -> bool:
        return topic in self._numbers

    @property
    def waiting(self) -> int:
        """Number of messages that are not written yet."""
        return len(self._waiting)

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self._file.counts) + len(self._waiting)

    def add(
        self, topic: str, kind: str, qualities: Sequence[Mapping[str, Any]] = (), digest: str = ''
    ) -> None:
        """Add a topic, whose messages can then be written; `flush` puts it on record.

        Parameters
        ----------
        topic
            Full name.
        kind
            Type, ``package/msg/Name``.
        qualities
            Quality of service that each publisher offers, in the terms of rosbag2.
        digest
            Hash of the type, if it is known.
        """
        offered = json.dumps([{**_QUALITY, **quality} for quality in qualities or ({},)])
        metadata = {'offered_qos_profiles': offered, 'topic_type_hash': digest}
        self._numbers[topic] = self._file.add(topic, kind, definition(kind), metadata)
        self._topics.append(_Topic(topic, kind, offered, digest))

    def write(self, topic: str, time: int, data: bytes, published: int | None = None) -> None:
        """Add a message with its time of reception, and of publication if that is known.

        Both are in nanoseconds.
        """
        sent = time if published is None else max(published, 0)
        self._waiting.append((time, self._numbers[topic], data, sent))

    def flush(self) -> None:
        """Write all messages in order, so that they are in the file if this process is killed."""
        self._waiting.sort(key=itemgetter(0))
        for time, number, data, published in self._waiting:
            self._file.write(number, time, data, published)
        self._waiting.clear()
        self._file.flush()
        self._describe()

    def close(self) -> None:
        """Write the remaining messages, the index of the file and the metadata."""
        if not self._closed:
            self._closed = True
            self.flush()
            self._file.close()

    def _describe(self) -> None:
        """Replace `metadata.yaml`, in JSON, which is YAML."""
        file = self._file
        total = sum(file.counts)
        start = {'nanoseconds_since_epoch': file.start if total else 0}
        duration = {'nanoseconds': file.end - file.start if total else 0}
        times = {'starting_time': start, 'duration': duration, 'message_count': total}
        described = {
            'version': 9,
            'storage_identifier': 'mcap',
            **times,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.kind,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': json.loads(topic.qualities),
                        'type_description_hash': topic.digest,
                    },
                    'message_count': count,
                }
                for topic, count in zip(self._topics, file.counts)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._name],
            'files': [{'path': self._name, **times}],
            'custom_data': None,
            'ros_distro': os.environ.get('ROS_DISTRO', 'jazzy'),
        }
        text = json.dumps({'rosbag2_bagfile_information': described}, indent=1)
        new = self._folder / _NEW_METADATA
        new.write_text(f'{text}\n')
        new.replace(self._folder / _METADATA)
