# SPDX-License-Identifier: Apache-2.0
"""A bag of a simulated scenario, with faults if any, written without a node."""

from __future__ import annotations

from pathlib import Path

from rclpy.serialization import serialize_message

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file

from .recordings import Injection, simulated


def write_bag(
    folder: str | Path, name: str, injection: Injection, seconds: float, seed: int
) -> None:
    """Write a recording of a shipped scenario as a bag."""
    readings, inputs = simulated(name, injection, seconds, seed)
    scenario = build(from_file(shipped.file(name), 'estimator'))
    rows = []
    with RecordingWriter(folder) as writer:
        for sensor, each in readings.items():
            source = scenario.sensors[sensor]
            R = source.sensor.covariance
            columns = zip(each.received, each.stamp, each.value)
            rows += [(source.signal, *row, R) for row in columns]
        rows += [(scenario.input, *row, None) for row in zip(*vars(inputs).values())]
        for signal in {id(row[0]): row[0] for row in rows}.values():
            writer.add(f'/{signal.topic}', full_type(signal.type))
        codecs = {row[0].topic: SignalCodec(row[0]) for row in rows}
        for signal, received, stamp, value, R in rows:
            message = codecs[signal.topic].encode(round(stamp * 1e9), value, R)
            data = bytes(serialize_message(message))
            writer.write(f'/{signal.topic}', round(received * 1e9), data)
