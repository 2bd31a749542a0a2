# SPDX-License-Identifier: Apache-2.0
"""A program that publishes one estimate at a rate, stamped now, and never stops by itself."""

import sys
import time

import numpy as np
import rclpy
from rclpy.qos import QoSProfile

from kalman_ros import scenario
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter


def main(rate):
    rclpy.init()
    node = rclpy.create_node('estimate_flood')
    write = WireWriter(SignalCodec(scenario.build({}).state))
    publisher = node.create_publisher(write.message_type, 'estimate', QoSProfile(depth=100))
    x, P = np.array([1.0, 0.0, 0.0, 0.0]), 1e-4 * np.eye(4)
    due = time.monotonic()
    while True:
        publisher.publish(write(time.time_ns(), x, P))
        due = max(due + 1.0 / rate, time.monotonic() - 0.05)
        time.sleep(max(due - time.monotonic(), 0.0))


if __name__ == '__main__':
    main(float(sys.argv[1]))
