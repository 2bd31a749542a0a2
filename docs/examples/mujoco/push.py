# SPDX-License-Identifier: Apache-2.0
"""A hand that pushes the cart back and forth, and towards the middle of the track.

    python3 push.py --ros-args -p seconds:=60.0 -p force:=1.5 -p lockstep:=false

It sees the cart on ``joint_states`` and publishes ``force``: strokes one way and then back, each
for a random time, beside a pull of ``spring`` N/m to the middle. It begins when it has two
``listeners``, the plant and a recorder. In lockstep it answers each reading.
"""

from contextlib import suppress

import rclpy
from geometry_msgs.msg import WrenchStamped
from numpy.random import default_rng
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

PERIOD = 0.01


def strokes(force, seconds, random):
    """Yield the force of every period: one way, back and a rest, then the other way round."""
    elapsed = 0.0
    while elapsed < seconds:
        steps, rest = (random.uniform([0.1, 0.0], [0.3, 0.5]) / PERIOD).astype(int)
        yield from [force] * steps + [-force] * steps + [0.0] * rest
        elapsed += (2 * steps + rest) * PERIOD
        force = -force


class Hand(Node):
    """Publishes the strokes, until they end."""

    def __init__(self):
        super().__init__('hand')
        values = {'force': 1.5, 'seconds': 60.0, 'spring': 2.0, 'lockstep': False, 'listeners': 2}
        for name, value in values.items():
            setattr(self, name, self.declare_parameter(name, value).value)
        self.strokes = strokes(self.force, self.seconds, default_rng(0))
        self.seen, self.begun = None, False
        self.publisher = self.create_publisher(WrenchStamped, 'force', 10)
        self.create_subscription(JointState, 'joint_states', self.on_joints, 10)
        self.wait = self.create_timer(1.0, self.begin)

    def begin(self):
        """Push from now on, if all are there: by the clock, or in answer to readings."""
        if self.publisher.get_subscription_count() < self.listeners or self.seen is None:
            return
        self.destroy_timer(self.wait)
        self.begun = True
        if self.lockstep:
            self.push(self.seen.header.stamp)
        else:
            self.create_timer(PERIOD, lambda: self.push(self.get_clock().now().to_msg()))

    def on_joints(self, message):
        """Look at the cart; in lockstep, push at once."""
        self.seen = message
        if self.lockstep and self.begun:
            self.push(message.header.stamp)

    def push(self, stamp):
        """Publish the next force."""
        stroke = next(self.strokes, None)
        if stroke is None:
            raise SystemExit
        message = WrenchStamped()
        message.header.stamp = stamp
        message.wrench.force.x = stroke - self.spring * self.seen.position[0]
        self.publisher.publish(message)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, SystemExit, ExternalShutdownException):
        rclpy.spin(Hand())
