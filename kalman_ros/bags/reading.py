# SPDX-License-Identifier: Apache-2.0
"""Reader of recordings: of rosbag2, as MCAP or SQLite, in one file or several, and of ROS 1."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from math import inf
from pathlib import Path

from kalman_ros.core.named_options import nearest
from kalman_ros.core.one_line import one_line

from .blocks import Block, Message, Messages, Source, in_order
from .budget import Budget
from .mcap_reader import McapFile
from .ros1_reader import Ros1File
from .sqlite_reader import SqliteFile

_KINDS: dict[str, Callable[[Path, Budget], Source]] = {
    '.mcap': McapFile,
    '.db3': SqliteFile,
    '.bag': Ros1File,
}
#: Number of topics that are named in a message.
_NAMED = 6
#: Seconds that no recording lasts.
_FOREVER = 1e9


class Bag:
    """A recording: a folder of rosbag2, or a file.

    The files of a folder are found by their names, so that it opens without ``metadata.yaml``.
    No code and no message definition of the recording is used.

    Parameters
    ----------
    path
        Path of the folder or the file.

    Raises
    ------
    ValueError
        If it is not a recording, or has no messages.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        #: Message types that each topic has been recorded with.
        self.topics: dict[str, set[str]] = {}
        #: Damage of the recording, one line for each damaged file.
        self.damage: list[str] = []
        self._blocks: list[Block] = []
        files = self._files()
        #: Bytes of the recording on disk.
        self._disk = _on_disk(files)
        budget = Budget(self._disk)
        for file in files:
            self._add(file, budget)
        if not self._blocks:
            why = '; '.join(['it has no messages', *self.damage])
            raise ValueError(f"'{self.path}' is an empty recording: {why}")
        #: Times at which the first and the last message were received, in nanoseconds.
        self.start = min(block.start for block in self._blocks)
        self.end = max(block.end for block in self._blocks)

    def _files(self) -> list[Path]:
        path = self.path
        if path.is_dir():
            files = sorted(file for file in path.iterdir() if file.suffix in _KINDS)
            if files:
                return files
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
            else:  # it is no topic of ROS, and a terminal would interpret it
                damage.append(f'no name of a topic: {one_line(topic)}')
        self._blocks += source.blocks
        self.damage += [f'{file}: {reason}' for reason in damage]

    def check(self, topic: str, kind: str, purpose: str) -> None:
        """Raise ValueError unless a topic is recorded with the type ``package/msg/Name``.

        The message names the ``purpose`` of the topic, and the recorded topics.
        """
        if topic not in self.topics:
            alike = nearest(topic, self.topics)
            names = sorted(self.topics)
            more = f' and {len(names) - _NAMED} more' if len(names) > _NAMED else ''
            recorded = f'{", ".join(names[:_NAMED])}{more}'
            hint = ' '.join(filter(None, (alike, f'recorded are {recorded or "none"}')))
            raise ValueError(f'{purpose}: the recording has no topic {topic}; {hint}')
        kinds = self.topics[topic]
        if kinds != {kind}:
            got = ' and '.join(sorted(kinds))
            raise ValueError(f'{purpose}: expected {kind} on {topic}, recorded is {got}')

    def limits(self, start: float, end: float) -> tuple[float, float]:
        """Return the times of reception in nanoseconds of a part, given in seconds.

        Raises
        ------
        ValueError
            If the part does not end after it begins.
        """
        if not 0.0 <= start < end:
            raise ValueError(f'part: expected 0 <= start < end, got {start:g} and {end:g}')
        first, last = (self.start + round(t * 1e9) if t < _FOREVER else inf for t in (start, end))
        return first if start else -inf, last

    def messages(
        self, topics: Collection[str], start: float = -inf, end: float = inf
    ) -> Iterator[Message]:
        """Yield the messages of some topics, one by one; see `batches`."""
        for batch in self.batches(topics, start, end):
            yield from batch

    def batches(
        self, topics: Collection[str], start: float = -inf, end: float = inf
    ) -> Iterator[Messages]:
        """Yield the messages of some topics in the order in which they were received.

        Parameters
        ----------
        topics
            Full names of the topics.
        start, end
            Limits of the times of reception, in nanoseconds.

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
    """Return the bytes that files take on disk; ValueError if one is no file or a repeated one."""
    names: dict[tuple[int, int], Path] = {}
    total = 0
    for file in files:
        if not file.is_file():  # a pipe would be waited for
            raise ValueError(f"'{file}' is not a file")
        status = file.stat()
        first = names.setdefault((status.st_dev, status.st_ino), file)
        if first is not file:
            raise ValueError(f"'{file}' is the same file as '{first.name}'")
        # a file with holes is longer; a file system that does not count blocks reports 0
        total += min(status.st_size, 512 * status.st_blocks or status.st_size)
    return total
