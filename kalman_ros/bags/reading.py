# SPDX-License-Identifier: Apache-2.0
"""Reads recordings: of rosbag2, as MCAP or SQLite, in one file or several, and of ROS 1."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from math import inf
from pathlib import Path

from kalman_ros.core.named_options import nearest
from kalman_ros.core.one_line import one_line

from .blocks import Block, Message, Source, in_order
from .budget import Budget
from .mcap_reader import McapFile
from .ros1_reader import Ros1File
from .sqlite_reader import SqliteFile

_KINDS: dict[str, Callable[[Path, Budget], Source]] = {
    '.mcap': McapFile,
    '.db3': SqliteFile,
    '.bag': Ros1File,
}
#: Topics that are named in a message.
_NAMED = 6


class Bag:
    """A recording: a folder of rosbag2, or a file.

    The files of a folder are found by their names, so that it opens without ``metadata.yaml``.
    No code and no message definition of the recording is used.

    Parameters
    ----------
    path
        Of the folder or the file.

    Raises
    ------
    ValueError
        If it is no recording, or has no messages.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        #: The message types that each topic has been recorded with.
        self.topics: dict[str, set[str]] = {}
        #: What of the recording cannot be read, a line a file.
        self.damage: list[str] = []
        self._blocks: list[Block] = []
        files = self._files()
        #: The bytes of the recording on disk.
        self._disk = _on_disk(files)
        budget = Budget(self._disk)
        for file in files:
            self._add(file, budget)
        if not self._blocks:
            why = '; '.join(['it has no messages', *self.damage])
            raise ValueError(f"'{self.path}' is an empty recording: {why}")
        #: When the first and the last message were received, in nanoseconds.
        self.start = min(block.start for block in self._blocks)
        self.end = max(block.end for block in self._blocks)

    def _files(self) -> list[Path]:
        path = self.path
        if path.is_dir():
            found = sorted(each for each in path.iterdir() if each.suffix in _KINDS)
            if found:
                return found
            if any(path.glob('*.zstd')):
                raise ValueError(f"'{path}' is compressed: unzstd its files first")
            raise ValueError(f"'{path}' is no recording: no {', '.join(_KINDS)} file is in it")
        if not path.exists():
            raise ValueError(f"there is no recording '{path}'")
        if path.suffix not in _KINDS:
            expected = f'expected a folder of rosbag2, or a file {", ".join(_KINDS)}'
            raise ValueError(f"bag: {expected}, got '{path}'")
        return [path]

    def _add(self, file: Path, budget: Budget) -> None:
        try:
            source = _KINDS[file.suffix](file, budget)
        except ValueError as error:
            raise ValueError(f'{file}: {error}') from None
        damage = [source.damage] if source.damage else []
        for topic, kinds in source.topics.items():
            if topic.isprintable():
                self.topics.setdefault(topic, set()).update(map(one_line, kinds))
            else:  # it is no topic of ROS, and a terminal would obey it
                damage.append(f'no name of a topic: {one_line(topic)}')
        self._blocks += source.blocks
        self.damage += [f'{file}: {each}' for each in damage]

    def check(self, topic: str, kind: str, what: str) -> None:
        """Raise ValueError unless a topic is there with the message type ``package/msg/Name``.

        ``what`` it is needed for is named, and the topics that are there.
        """
        if topic not in self.topics:
            alike = nearest(topic, self.topics)
            names = sorted(self.topics)
            more = f' and {len(names) - _NAMED} more' if len(names) > _NAMED else ''
            there = f'{", ".join(names[:_NAMED])}{more}'
            hint = ' '.join(filter(None, (alike, f'recorded are {there or "none"}')))
            raise ValueError(f'{what}: the recording has no topic {topic}; {hint}')
        found = self.topics[topic]
        if found != {kind}:
            got = ' and '.join(sorted(found))
            raise ValueError(f'{what}: expected {kind} on {topic}, recorded is {got}')

    def messages(
        self, topics: Collection[str], start: float = -inf, end: float = inf
    ) -> Iterator[Message]:
        """Yield the messages of some topics in the order in which they were received.

        Parameters
        ----------
        topics
            Full names.
        start, end
            In nanoseconds.

        Raises
        ------
        ValueError
            If a part of the recording is damaged, or takes more than a `Budget`.
        """
        try:
            budget = Budget(self._disk)
            yield from in_order(self._blocks, frozenset(topics), budget, start, end)
        except ValueError as error:
            raise ValueError(f'{self.path}: {error}') from None


def _on_disk(files: Sequence[Path]) -> int:
    """Return the bytes that files take on disk; ValueError if one is no file, or there twice."""
    names: dict[tuple[int, int], Path] = {}
    total = 0
    for file in files:
        if not file.is_file():  # a pipe would be waited for
            raise ValueError(f"'{file}' is not a file")
        status = file.stat()
        first = names.setdefault((status.st_dev, status.st_ino), file)
        if first is not file:
            raise ValueError(f"'{file}' is the same file as '{first.name}'")
        # a file with holes is longer; a file system that does not count blocks says 0
        total += min(status.st_size, 512 * status.st_blocks or status.st_size)
    return total
