# SPDX-License-Identifier: Apache-2.0
"""Publishes on N topics at a rate for some seconds, to those who have subscribed to all of them.

usage: traffic.py TOPICS RATE SECONDS
"""

from __future__ import annotations

import sys
import time

import rclpy
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message


def main() -> None:
    """Publish, and wait until everything has been received."""
    count, rate, seconds = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    rclpy.init()
    node = rclpy.create_node('traffic', start_parameter_services=False)
    topics = [node.create_publisher(Odometry, f'traffic_{k}', 1000) for k in range(count)]
    while not all(topic.get_subscription_count() for topic in topics):
        time.sleep(0.02)
    data = bytes(serialize_message(Odometry()))
    start = time.monotonic()
    for step in range(round(rate * seconds)):
        for topic in topics:
            topic.publish(data)
        time.sleep(max(0.0, start + (step + 1) / rate - time.monotonic()))
    for topic in topics:
        topic.wait_for_all_acked()


if __name__ == '__main__':
    main()
