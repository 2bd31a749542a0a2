# SPDX-License-Identifier: Apache-2.0
"""A plant simulated by MuJoCo: it knows the topics, and nothing of kalman_ros.

    python3 plant.py cart_pole.xml --ros-args -p start:=hanging -p lockstep:=false -p seed:=1

The MJCF file describes all of it. A sensor has its standard deviation as ``noise`` and its period
as ``interval``; the name of an actuator is the field of the command that drives it, and ``user``
the spectral density of a random command beside it.
"""

import math
import sys
from contextlib import suppress
from operator import attrgetter

import mujoco
import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Imu, JointState, TimeReference
from std_srvs.srv import Trigger

COMMANDS = {'wrench': ('force', WrenchStamped), 'twist': ('cmd_vel', TwistStamped)}
AXES = ('x', 'y', 'z')
QUEUE = 1000


def write_joint(message, name, values, variance):
    """Append the angle or the position of a joint."""
    message.name.append(name)
    message.position.append(values[0])


def write_imu(message, name, values, variance):
    """Set the vector that is named like the sensor, and its covariance."""
    for axis, value in zip(AXES, values):
        setattr(getattr(message, name), axis, value)
    getattr(message, f'{name}_covariance')[::4] = variance


def write_position(message, name, values, variance):
    """Set the position, and its covariance."""
    for axis, value in zip(AXES, values):
        setattr(message.pose.pose.position, axis, value)
    message.pose.covariance[0:15:7] = variance


def write_wheels(message, name, values, variance):
    """Set the speed or the yaw rate, and its variance."""
    vector, axis, place = {'forward': ('linear', 'x', 0), 'turn': ('angular', 'z', 35)}[name]
    setattr(getattr(message.twist.twist, vector), axis, values[0])
    message.twist.covariance[place] = variance


#: Topic, message type and writer of each type of sensor.
SENSORS = {
    mujoco.mjtSensor.mjSENS_JOINTPOS: ('joint_states', JointState, write_joint),
    mujoco.mjtSensor.mjSENS_GYRO: ('imu', Imu, write_imu),
    mujoco.mjtSensor.mjSENS_ACCELEROMETER: ('imu', Imu, write_imu),
    mujoco.mjtSensor.mjSENS_FRAMEPOS: ('position', PoseWithCovarianceStamped, write_position),
    mujoco.mjtSensor.mjSENS_TENDONVEL: ('odom', Odometry, write_wheels),
}


class Plant(Node):
    """MuJoCo behind topics: commands in; readings, ground truth and, in lockstep, ticks out."""

    def __init__(self, path):
        super().__init__('plant')
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        options = {'start': '', 'rate': 100.0, 'seed': 0, 'lockstep': False, 'run_until': math.inf}
        for name, value in {**options, 'force_timeout': 0.5}.items():
            setattr(self, name, self.declare_parameter(name, value).value)
        timestep = self.model.opt.timestep
        self.timestep, self.substeps = round(1e9 * timestep), round(1.0 / self.rate / timestep)
        self.periods = np.round(self.model.sensor_interval[:, 0] / timestep).astype(int)
        self.model.sensor_interval[:] = 0.0  # the readings that are due are chosen here
        self.deviation = np.sqrt(self.model.actuator_user[:, 0] / timestep)
        seeds = np.random.SeedSequence(self.seed).spawn(self.model.nsensor + 1)
        self.random = [np.random.default_rng(seed) for seed in seeds]
        self.kinds = [SENSORS[mujoco.mjtSensor(kind)] for kind in self.model.sensor_type]
        types = {(topic, kind) for topic, kind, _ in self.kinds}
        self.sensors = {t: self.create_publisher(kind, t, QUEUE) for t, kind in types}
        self.free = self.model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        kind = Odometry if self.free else JointState
        self.truth_publisher = self.create_publisher(kind, 'ground_truth', QUEUE)
        self.fields = [self.model.actuator(i).name for i in range(self.model.nu)]
        self.command_topic, kind = COMMANDS[self.fields[0].partition('.')[0]]
        subscribe = self.create_subscription
        self.command_subscription = subscribe(kind, self.command_topic, self.on_command, QUEUE)
        subscribe(kind, 'disturbance', self.on_disturbance, QUEUE)
        self.create_service(Trigger, '~/reset', self.on_reset)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.origin, self.steps, self.asked = None, 0, None
        self.asked_at = self.steady.now().nanoseconds
        self.reset()
        if self.lockstep:
            self.tick_publisher = self.create_publisher(TimeReference, 'tick', QUEUE)
            self.clock_publisher = self.create_publisher(ClockMessage, '/clock', QUEUE)
            self.create_timer(0.05, self.watch, clock=self.steady)
        else:
            self.create_timer(1.0 / self.rate, self.advance, clock=self.steady)

    def reset(self):
        """Return to the keyframe ``start``, or to the reference configuration without one."""
        key = self.model.key(self.start).id if self.start else -1
        mujoco.mj_resetDataKeyframe(self.model, self.data, key)
        self.command = self.disturbance = np.zeros(self.model.nu)
        self.commanded_at = None

    def step(self):
        """Advance by one time step with the held command; in real time, rest before the first."""
        if self.lockstep or self.commanded_at is not None:
            noise = self.deviation * self.random[-1].standard_normal(self.model.nu)
            self.data.ctrl = self.command + self.disturbance + noise
            mujoco.mj_step(self.model, self.data)
        self.steps += 1

    @property
    def stamp(self):
        """Time of this step in nanoseconds."""
        return self.origin + self.steps * self.timestep

    def publish(self):
        """Publish the readings that are due, the truth, and in lockstep the tick and the clock."""
        if self.steps * self.timestep > self.run_until * 1e9:
            for publisher in self.publishers:  # what a busy reader has not taken goes with it
                publisher.wait_for_all_acked(Duration(seconds=5))
            raise SystemExit
        mujoco.mj_forward(self.model, self.data)
        now = Time(sec=self.stamp // 10**9, nanosec=self.stamp % 10**9)
        readings = {}
        for i in np.flatnonzero(self.steps % self.periods == 0):
            sensor, deviation = self.model.sensor(i), self.model.sensor_noise[i]
            topic, kind, write = self.kinds[i]
            message = readings.setdefault(topic, kind())
            exact = self.data.sensor(i).data
            values = exact + deviation * self.random[i].standard_normal(exact.size)
            write(message, sensor.name, values.tolist(), deviation**2)
        for message in readings.values():
            message.header.stamp, message.header.frame_id = now, 'map'
        self.sent = [(self.sensors[topic], message) for topic, message in readings.items()]
        self.sent.append((self.truth_publisher, self.truth(now)))
        if self.lockstep:
            tick = TimeReference(source=','.join(readings))
            tick.header.stamp = now
            self.sent += [(self.tick_publisher, tick)]
            self.sent += [(self.clock_publisher, ClockMessage(clock=now))]
        self.send()

    def send(self):
        """Send the messages of this step; where nobody answers, once more."""
        for publisher, message in self.sent:
            publisher.publish(message)

    def truth(self, now):
        """Return the pose and twist of a free body, or else all joints by name."""
        q, v = self.data.qpos, self.data.qvel
        if not self.free:
            message = JointState(position=q.tolist(), velocity=v.tolist())
            message.name = [self.model.joint(i).name for i in range(self.model.njnt)]
        else:
            message = Odometry()
            pose, twist, inverse, local = message.pose.pose, message.twist.twist, *np.zeros((2, 4))
            mujoco.mju_negQuat(inverse, q[3:7])
            mujoco.mju_rotVecQuat(local[:3], v[:3], inverse)
            for axis, x, linear, angular in zip(AXES, q, local, v[3:6]):
                setattr(pose.position, axis, float(x))
                setattr(twist.linear, axis, float(linear))
                setattr(twist.angular, axis, float(angular))
            for axis, value in zip('wxyz', q[3:7]):
                setattr(pose.orientation, axis, float(value))
        message.header.stamp, message.header.frame_id = now, 'map'
        return message

    def on_command(self, message):
        """Hold a command from now on; in lockstep, take the step that it answers."""
        values = self.finite(message)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if values is None or (self.lockstep and stamp != self.asked):
            return
        if not self.lockstep:
            self.advance()
        self.command, self.commanded_at = values, self.steady.now()
        if self.lockstep:
            for _ in range(self.substeps):
                self.step()
            self.ask()

    def on_disturbance(self, message):
        """Hold a disturbance, which is added to the command."""
        values = self.finite(message)
        if values is not None:
            self.disturbance = values

    def finite(self, message):
        """Return the values of a command; None if one is not finite."""
        values = np.array([attrgetter(field)(message) for field in self.fields])
        return values if np.isfinite(values).all() else None

    def on_reset(self, request, response):
        """Return to the initial state; time continues."""
        self.reset()
        response.success = True
        return response

    def advance(self):
        """Take the time steps up to now, in real time; an old command goes to zero."""
        now = self.get_clock().now().nanoseconds
        if self.origin is None or abs(now - self.stamp) > 10**9:
            self.origin = now - self.steps * self.timestep
        if self.commanded_at is not None:
            age = self.steady.now() - self.commanded_at
            if age.nanoseconds > self.force_timeout * 1e9:
                self.command = np.zeros(self.model.nu)
        while self.stamp + self.timestep // 2 <= now:  # the nearest time step
            self.step()
            if self.steps % self.substeps == 0:
                self.publish()

    def ask(self):
        """Publish this step of the lockstep."""
        self.asked, self.asked_at = self.stamp, self.steady.now().nanoseconds
        self.publish()

    def watch(self):
        """Begin a second after the others are connected; ask again where no command answers."""
        now = self.steady.now().nanoseconds
        if self.origin is None:
            counts = [self.command_subscription.get_publisher_count()]
            writers = [self.tick_publisher, *self.sensors.values()]
            if not all(counts + [writer.get_subscription_count() for writer in writers]):
                self.asked_at = now
            elif now - self.asked_at > 10**9:
                self.origin = 10**9
                self.ask()
        elif now - self.asked_at > 2 * 10**9:
            self.get_logger().error(f'step {self.steps}: no {self.command_topic}; asking again')
            self.asked_at = now
            self.send()


def main():
    """Run the plant until Ctrl-C."""
    rclpy.init(args=sys.argv)
    with suppress(KeyboardInterrupt, SystemExit, ExternalShutdownException):
        rclpy.spin(Plant(remove_ros_args(sys.argv)[1]))


if __name__ == '__main__':
    main()
