# SPDX-License-Identifier: Apache-2.0
"""Kills the nodes of a loop with SIGKILL, one at a time at random, and starts each again.

The nodes run as ``./dev NODE`` starts them. Prints how long it takes until the loop runs again,
and the longest pause in the streams of the nodes that live; exits 1 if a bound is exceeded.

    python test/scenarios/kill_nodes.py --kills 100
"""

import argparse
import random
import sys
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import monotonic

from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from terminals import Terminals
from tools.soak.machine import Withheld

from kalman_ros.codecs.messages import nanoseconds

#: The topic by which each node is watched, and the nodes without which it is silent.
NODES = {
    'plant': ('velocity', TwistWithCovarianceStamped, ()),
    'estimator': ('estimate', Odometry, ('plant',)),
    'controller': ('force', WrenchStamped, ('plant', 'estimator')),
}
#: In seconds, while the machine lets the nodes run.
RECOVERY, PAUSE = 2.0, 0.3


class Loop:
    """When each message of three nodes arrived, and what became of each kill."""

    def __init__(self, nodes):
        self.nodes, self.mapped = nodes, set()
        self.arrivals, self.stamp, self.force = defaultdict(list), {}, 0.0
        #: Of each kill: the node, when it ended and was heard again, seconds until the loop ran
        #: again, and seconds for which the machine kept the nodes from running.
        self.kills = []
        for name, (topic, kind, _) in NODES.items():
            heard = lambda message, name=name: self.hear(name, message)  # noqa: E731
            nodes.node.create_subscription(kind, topic, heard, 1000)

    def hear(self, name, message):
        self.arrivals[name].append(monotonic())
        self.stamp[name] = nanoseconds(message.header.stamp)
        if name == 'controller':
            self.force = abs(message.wrench.force.x) + abs(message.wrench.force.y)

    def until_closed(self):
        """Wait until a force answers an estimate that is newer than this call."""
        now = self.nodes.node.get_clock().now().nanoseconds
        closed = lambda: self.force and self.stamp.get('controller', 0) > now  # noqa: E731
        self.nodes.wait(closed, 60.0, lambda: 'the loop does not run again within 60 s')

    def look_for_shared_memory(self):
        for process in self.nodes.processes.values():
            self.mapped |= shared_memory(process.pid)

    def kill(self, name, delay):
        """Kill a node, start it again after ``delay`` seconds, and wait for the loop."""
        self.look_for_shared_memory()
        killed = monotonic()
        self.nodes.kill(name)
        others = Withheld(process.pid for process in self.nodes.processes.values())
        self.nodes.spin(delay)
        began, count = monotonic(), len(self.arrivals[name])
        self.nodes.start(name)
        own = Withheld([self.nodes.processes[name].pid])
        self.until_closed()
        ended = monotonic()
        back = (self.arrivals[name][count:] or [ended])[0]
        self.kills.append((name, killed, back, ended - began, others() + own()))


def shared_memory(pid):
    """Return the files in /dev/shm that Fast DDS has mapped into a process."""
    lines = Path(f'/proc/{pid}/maps').read_text().splitlines()
    return {line.split()[-1] for line in lines if '/dev/shm/' in line and 'fastrtps' in line}


def pauses(loop, name):
    """Yield the pauses of a node's stream while it and all that it needs were there.

    With each, for how long the machine kept the nodes from running meanwhile.
    """
    times, needs = loop.arrivals[name], {name, *NODES[name][2]}
    for start, end in pairwise(times):
        near = [kill for kill in loop.kills if kill[1] < end and start < kill[2] + kill[3]]
        # a pause in which a node is missing counts from its return
        returns = [back for node, _, back, *_ in near if node in needs and start < back]
        yield end - max([start, *returns]), sum(withheld for *_, withheld in near)


def run(kills, seed=0):
    """Return the loop after N kills of random nodes."""
    chance = random.Random(seed)
    with Terminals() as nodes:
        loop = Loop(nodes)
        for name in NODES:
            nodes.start(name)
        loop.until_closed()
        loop.arrivals.clear()
        names = [name for name in NODES for _ in range(-(-kills // len(NODES)))][:kills]
        chance.shuffle(names)
        for name in names:
            nodes.spin(chance.uniform(0.2, 0.8))
            loop.kill(name, chance.uniform(0.0, 0.8))
        loop.look_for_shared_memory()
    return loop


def faults(loop):
    """Return what is wrong, in sentences."""
    found = [
        f'the loop took {seconds:.2f} s to run again without the {name}'
        for name, _, _, seconds, withheld in loop.kills
        if seconds - withheld > RECOVERY
    ]
    found += [
        f'the living {name} paused for {pause:.2f} s'
        for name in NODES
        for pause, withheld in pauses(loop, name)
        if pause - withheld > PAUSE
    ]
    return found + [f'shared memory: {path}' for path in sorted(loop.mapped)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--kills', type=int, default=100)
    parser.add_argument('--seed', type=int, default=0)
    given = parser.parse_args()
    loop = run(given.kills, given.seed)
    print('seconds from the start of a killed node until the loop runs, and longest pause')
    print(f'{"node":12}{"kills":>6}{"median":>8}{"worst":>8}{"pause":>8}')
    for name in NODES:
        found = [seconds for node, _, _, seconds, _ in loop.kills if node == name]
        pause = max(pause for pause, _ in pauses(loop, name))
        print(f'{name:12}{len(found):6}{median(found):8.2f}{max(found):8.2f}{pause:8.2f}')
    wrong = faults(loop)
    for sentence in wrong:
        print(f'FAIL: {sentence}')
    sys.exit(bool(wrong))


if __name__ == '__main__':
    main()
