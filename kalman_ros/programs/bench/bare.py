# SPDX-License-Identifier: Apache-2.0
"""A bare rclpy node with the topics of the estimator, which answers each velocity with nothing.

A separate program, which imports only what such a node needs: the reference of the estimator.
"""

import signal

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future


def main() -> None:
    """Relay until a signal arrives."""
    stop = Future()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set_result(None))
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node('bare')
    estimate = Odometry()
    publisher = node.create_publisher(Odometry, 'estimate', 50)

    def answer(velocity: TwistWithCovarianceStamped) -> None:
        estimate.header.stamp = velocity.header.stamp
        publisher.publish(estimate)

    node.create_subscription(TwistWithCovarianceStamped, 'velocity', answer, 50)
    node.create_subscription(PoseWithCovarianceStamped, 'position', lambda _: None, 50)
    node.create_subscription(PoseWithCovarianceStamped, 'initialpose', lambda _: None, 50)
    node.create_subscription(WrenchStamped, 'force', lambda _: None, 50)
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.done():
        executor.spin_until_future_complete(stop, 1.0)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
