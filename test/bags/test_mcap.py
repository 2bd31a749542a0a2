# SPDX-License-Identifier: Apache-2.0
"""Parts of MCAP files, and the times that they say they have."""

import struct

import pytest

from kalman_ros.bags import mcap
from kalman_ros.bags.budget import Budget
from kalman_ros.bags.mcap_reader import McapFile
from kalman_ros.bags.mcap_writer import McapWriter

KIND = 'std_msgs/msg/String'
MIB = 1 << 20


def written(path, times):
    """Write a file with an empty message at each of some times."""
    writer = McapWriter(path, 'test')
    number = writer.add('/y', KIND, '', {})
    for time in times:
        writer.write(number, time, b'', time)
    writer.close()
    return writer


@pytest.mark.parametrize('times', [[0], [0, 0], [5], [7, 0, 3], [2**63, 2**63 + 9]])
def test_a_file_begins_and_ends_with_its_messages_even_at_zero(tmp_path, times):
    path = tmp_path / 'a.mcap'
    writer = written(path, times)
    (block,) = McapFile(path, Budget(path.stat().st_size)).blocks
    assert (block.start, block.end) == (min(times), max(times))
    assert (writer.start, writer.end) == (min(times), max(times))
    assert statistics(path.read_bytes()) == (len(times), min(times), max(times))


def statistics(data):
    """Return the number of messages and the first and the last time that the summary has."""
    summary = int.from_bytes(data[-28:-20], 'little')  # the footer, behind its head
    at = summary
    while data[at] != mcap.STATISTICS:
        at += mcap.RECORD.size + mcap.RECORD.unpack_from(data, at)[1]
    count, _, _, _, _, _, start, end = struct.unpack_from('<QHIIIIQQ', data, at + mcap.RECORD.size)
    return count, start, end


def test_a_file_without_messages_has_no_times(tmp_path):
    path = tmp_path / 'a.mcap'
    written(path, [])
    assert McapFile(path, Budget(path.stat().st_size)).blocks == []
    assert statistics(path.read_bytes()) == (0, 0, 0)


def loose(path, size, count):
    """Write a file with messages outside of chunks, at the times 0, 1, 2 and so on."""
    data = mcap.MAGIC + mcap.record(mcap.HEADER, mcap.text('ros2') + mcap.text('test'))
    data += mcap.schema(1, KIND, '') + mcap.channel(0, 1, '/y', {})
    content = bytes(size)
    for time in range(count):
        fields = mcap.MESSAGE_FIELDS.pack(0, time, time, time)
        data += mcap.record(mcap.MESSAGE, fields + content)
    path.write_bytes(data + mcap.record(mcap.DATA_END, bytes(4)))


@pytest.mark.parametrize(
    ('size', 'count', 'times'),
    [(10, 1000, [(0, 999)]), (MIB, 8, [(0, 2), (3, 5), (6, 7)]), (5 * MIB, 2, [(0, 0), (1, 1)])],
)
def test_messages_outside_of_chunks_are_read_together_up_to_four_mebibytes(
    tmp_path, size, count, times
):
    path = tmp_path / 'a.mcap'
    loose(path, size, count)
    found = McapFile(path, Budget(path.stat().st_size))
    assert [(block.start, block.end) for block in found.blocks] == times
    budget = Budget(path.stat().st_size)
    parts = (part for block in found.blocks for part in block.read({'/y'}, budget))
    read = [message for part in parts for message in part]
    assert [message.time for message in read] == [*range(count)]
    assert {len(message.data) for message in read} == {size}
