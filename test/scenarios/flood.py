# SPDX-License-Identifier: Apache-2.0
"""A program that publishes velocities at a rate, with stamps that lag; it prints how many."""

import sys
import time

import connected
import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy

from kalman_ros import scenario
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter

#: Seconds between two bursts.
BURST = 0.005
#: They know so little that, however many they are, the estimate is as good as without them.
STD = 50.0


def main(rate, seconds, lag, reliable):
    rng = np.random.default_rng(0)
    rclpy.init()
    node = rclpy.create_node('flood')
    write = WireWriter(SignalCodec(scenario.build({}).sensors['velocity'].signal))
    # of the estimator, the monitor and the harness, which does not match one of best effort
    qos = QoSProfile(
        depth=5000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
    )
    publisher = connected.publisher(
        node, write.message_type, 'velocity', qos, subscribers=3 if reliable else 2
    )
    R = STD**2 * np.eye(2)
    start, sent = time.time(), 0
    while sent < rate * seconds:
        time.sleep(BURST)
        due = (time.time() - start) * rate
        while sent < min(due, rate * seconds):
            # as a sensor's: the time at which it is read, however slowly this program gets on
            stamp = time.time_ns() - round(lag * 1e9)
            publisher.publish(write(stamp, STD * rng.standard_normal(2), R))
            sent += 1
    connected.acknowledged(publisher)
    print(sent, start, time.time())
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main(*map(float, sys.argv[1:]))
