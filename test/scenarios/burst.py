# SPDX-License-Identifier: Apache-2.0
"""A program that publishes N velocities at a rate, and prints how many."""

import sys
import time

import connected
import numpy as np
import rclpy
from rclpy.qos import QoSProfile

from kalman_ros import scenario
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter

#: At the end some come in pairs: a loss shows by the number of a message that comes after it.
PAIRS = 20


def main(rate, count):
    rclpy.init()
    node = rclpy.create_node('burst')
    write = WireWriter(SignalCodec(scenario.build({}).sensors['velocity'].signal))
    # of the estimator and the harness
    publisher = connected.publisher(
        node, write.message_type, 'velocity', QoSProfile(depth=1), subscribers=2
    )

    def publish():
        publisher.publish(write(time.time_ns(), np.zeros(2), 2500.0 * np.eye(2)))

    start = time.monotonic()
    for sent in range(count):
        publish()
        time.sleep(max(0.0, start + sent / rate - time.monotonic()))
    for _ in range(PAIRS):
        connected.acknowledged(publisher)
        for _ in range(5):
            publish()
    print(count + 5 * PAIRS)
    connected.acknowledged(publisher)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main(float(sys.argv[1]), int(sys.argv[2]))
