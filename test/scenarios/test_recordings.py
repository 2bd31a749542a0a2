# SPDX-License-Identifier: Apache-2.0
"""What the nodes said is recorded byte for byte, and a replay says the same."""

import json
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from connected import acknowledged
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64, String

from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.messages import leading_stamp
from kalman_ros.estimators import FILTERS as NAMES
from kalman_ros.estimators import filter_class
from kalman_ros.harness import Run, executables
from kalman_ros.harness.isolated_context import IsolatedContext
from kalman_ros.programs import demo
from kalman_ros.programs.doctor.loading import load
from kalman_ros.programs.replay import program

CONFIGS = sorted(path.stem for path in (Path(__file__).parents[2] / 'config').glob('*.yaml'))
#: Filters, each on a scenario that it can serve and that has another one.
FILTERS = {
    name: (
        'bearing_tracker'
        if filter_class(name).mixture
        else 'mass_spring_damper'
        if filter_class(name).needs_linear or name == 'ekf'
        else 'cart_pole',
        {'observer_poles': [-5.0, -6.0]} if filter_class(name).needs_continuous else {},
    )
    for name in NAMES
}


def said(bag, topic):
    """Return the bytes of a topic; what was said twice, because it was asked for, once."""
    found = []
    for message in bag.messages([topic]):
        if not found or message.data != found[-1]:
            found.append(message.data)
    return found


def assert_the_same(folder, run, *arguments):
    """Replay a recording of a run; every topic of the estimator has the recorded bytes."""
    found = replay(folder / 'live', *arguments, out=folder / 'replayed')
    live, replayed = Bag(folder / 'live'), Bag(folder / 'replayed')
    assert found.lockstep
    assert not live.damage
    topics = [t for t in live.topics if t.startswith('/estimate')]
    assert {'/estimate', '/estimate/covariance'} < set(topics)
    assert any(t.startswith('/estimate/innovation/') for t in topics)
    for topic in topics:
        assert said(live, topic) == said(replayed, topic), topic
        # and what is in the file is what the recorder of the run has
        assert said(live, topic)[-1] == bytes(run.recorder.raw[topic.lstrip('/')][-1])
    assert len(said(live, '/estimate')) > 2


@pytest.mark.parametrize('name', mostly_thorough(CONFIGS, 'mass_spring_damper_2d', 'robot_3d'))
def test_a_replay_of_lockstep_has_the_bytes_of_the_run(tmp_path, name):
    with Run(name, recording=tmp_path / 'live') as run:
        run.advance(2.0)
    assert_the_same(tmp_path, run, name)


@pytest.mark.thorough
def test_the_time_of_a_recording_of_lockstep_is_simulated(tmp_path):
    late = {'plant': {'imu.delay': 0.1}}
    with Run('diff_drive', only=late, recording=tmp_path / 'live') as run:
        run.advance(4.0)
    assert replay(tmp_path / 'live', 'diff_drive').duration == pytest.approx(4.0)
    part = replay(tmp_path / 'live', 'diff_drive', start=1.0, end=3.0)
    assert part.duration == pytest.approx(2.0)
    assert part.beliefs.time[[0, -1]] == pytest.approx([1.0, 3.0])
    evidence = load(tmp_path / 'live', 'diff_drive')
    assert evidence.duration == pytest.approx(4.0)
    diagnosis = diagnose(evidence)
    # a delay by which no reading is lost
    assert not diagnosis.findings
    assert ('delay', 'imu') in [(note.kind, note.subject) for note in diagnosis.notes]


@pytest.mark.parametrize('filter', mostly_thorough(FILTERS, 'ukf'))
def test_a_replay_has_the_bytes_of_every_filter(tmp_path, filter):
    name, options = FILTERS[filter]
    values = {'filter': filter, **options}
    with Run(name, values, recording=tmp_path / 'live') as run:
        run.advance(1.0)
    assert_the_same(tmp_path, run, name, values)


def last_said(folder):
    """Return the last estimate and covariance for each stamp, as bytes."""
    bag = Bag(folder)
    estimates = [message.data for message in bag.messages(['/estimate'])]
    covariances = [message.data for message in bag.messages(['/estimate/covariance'])]
    assert len(estimates) == len(covariances) > 50
    return {leading_stamp(data): (data, P) for data, P in zip(estimates, covariances)}


@pytest.mark.real_time
@pytest.mark.parametrize('name', ['mass_spring_damper_2d', 'diff_drive'])
def test_a_replay_of_real_time_has_the_beliefs_of_the_run(tmp_path, name):
    reliable = {} if name == 'diff_drive' else {'position.delay': 0.03, 'position.jitter': 0.02}
    with Run(name, lockstep=False, only={'plant': reliable}, recording=tmp_path / 'live') as run:
        run.advance(3.0)
    replay(tmp_path / 'live', name, out=tmp_path / 'replayed')
    found = {}
    for message in Bag(tmp_path / 'replayed').messages(['/estimate']):
        found.setdefault(leading_stamp(message.data), set()).add(message.data)
    live = [message.data for message in Bag(tmp_path / 'live').messages(['/estimate'])]
    assert len(live) > 100
    assert all(leading_stamp(data) in found for data in live)
    # two messages that the node received in one order and the recorder in the other make a belief
    # differ until both are fused
    other = [data for data in live if data not in found[leading_stamp(data)]]
    assert len(other) <= 0.02 * len(live)
    assert live[-1] in found[leading_stamp(live[-1])]


@pytest.mark.real_time
@pytest.mark.parametrize('name', ['mass_spring_damper_2d', 'cart_pole', 'diff_drive', 'inertial'])
def test_without_delays_a_replay_has_the_last_belief_of_every_stamp(tmp_path, name):
    with Run(name, lockstep=False, recording=tmp_path / 'live') as run:
        run.advance(4.0)
    replay(tmp_path / 'live', name, out=tmp_path / 'replayed')
    assert last_said(tmp_path / 'live').items() <= last_said(tmp_path / 'replayed').items()


class Recording:
    """The program `record`, and a node of this process that publishes."""

    def __init__(self, folder, *arguments):
        self.folder = folder
        self._context = IsolatedContext('peer')
        self.node = self._context.node
        command = [str(executables.executable('record')), '--out', str(folder), *arguments]
        self._process = subprocess.Popen(
            command, env=self._context.environment, stdout=subprocess.PIPE, text=True
        )
        self.publishers = []

    def publisher(self, kind, topic, profile=QoSProfile(depth=1000)):  # noqa: B008
        """Return a publisher that the recorder has subscribed to."""
        found = self.node.create_publisher(kind, topic, profile)
        self.until(found.get_subscription_count, f'{topic} is not recorded')
        return found

    def until(self, condition, complaint):
        end = time.monotonic() + 30.0
        while not condition():
            assert time.monotonic() < end, complaint
            assert self._process.poll() is None, self._process.communicate()
            self._context.spin(0.02)

    def end(self, number):
        """Send a signal, and return the exit code and what was printed."""
        self._process.send_signal(number)
        printed, _ = self._process.communicate(timeout=20.0)
        return self._process.returncode, printed

    def close(self):
        self._process.kill()
        self._process.wait()
        self._context.close()


@pytest.fixture
def recording(tmp_path):
    """Return a function that starts the program."""
    started = []

    def start(*arguments):
        started.append(Recording(tmp_path / 'recorded', *arguments))
        return started[-1]

    yield start
    for each in started:
        each.close()


@pytest.mark.thorough
def test_record_takes_topics_that_appear_later_and_ends_properly(recording):
    found = recording()
    first = found.publisher(Float64, 'first')
    for k in range(200):
        first.publish(Float64(data=float(k)))
    effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    late = found.publisher(String, 'late', effort)
    for k in range(50):
        late.publish(String(data='x' * k))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    early = found.node.create_publisher(String, 'latched', latched)
    early.publish(String(data='before anybody listens'))
    found.until(early.get_subscription_count, 'latched is not recorded')
    bag = lambda: list(Bag(found.folder).messages(['/first', '/late', '/latched']))  # noqa: E731
    found.until(lambda: len(bag()) == 251, 'not all of it is in the file')
    code, printed = found.end(signal.SIGINT)
    assert code == 0
    assert '251 messages of 3 topics' in printed
    assert not Bag(found.folder).damage
    values = [np.frombuffer(m.data[4:12])[0] for m in bag() if m.topic == '/first']
    assert values == list(map(float, range(200)))
    described = json.loads((found.folder / 'metadata.yaml').read_text())
    topics = described['rosbag2_bagfile_information']['topics_with_message_count']
    qualities = {
        each['topic_metadata']['name']: each['topic_metadata']['offered_qos_profiles'][0]
        for each in topics
    }
    assert qualities['/late']['reliability'] == 'best_effort'
    assert qualities['/latched']['durability'] == 'transient_local'


@pytest.mark.real_time
def test_what_a_killed_recorder_had_a_second_ago_is_in_the_file(recording):
    found = recording('numbers')
    publisher = found.publisher(Float64, 'numbers')
    other = found.node.create_publisher(Float64, 'other', 10)
    for k in range(500):
        publisher.publish(Float64(data=float(k)))
    other.publish(Float64())
    acknowledged(publisher)
    published = time.monotonic()
    found.until(lambda: time.monotonic() - published > 1.0, 'the clock stands')
    code, _ = found.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    bag = Bag(found.folder)
    assert 'not finished' in bag.damage[0]
    assert [*bag.topics] == ['/numbers']
    values = [np.frombuffer(message.data[4:12])[0] for message in bag.messages(['/numbers'])]
    assert values == list(map(float, range(500)))


@pytest.mark.real_time
def test_a_recorder_that_is_killed_under_load_loses_at_most_the_last_second(recording):
    found = recording()
    topics = [f'topic_{k}' for k in range(20)]
    publishers = [found.node.create_publisher(Float64, topic, 1000) for topic in topics]
    taken = lambda: all(each.get_subscription_count() for each in publishers)  # noqa: E731
    found.until(taken, 'not all topics are recorded')
    sent, begin = [], time.monotonic()
    for round in range(600):  # 3 s at 200 Hz
        sent.append(time.monotonic())
        data = bytes(serialize_message(Float64(data=float(round))))
        for publisher in publishers:
            publisher.publish(data)
        time.sleep(max(0.0, begin + 0.005 * (round + 1) - time.monotonic()))
    killed = time.monotonic()
    code, _ = found.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    bag = Bag(found.folder)
    assert 'not finished' in bag.damage[0]
    safe = sum(each < killed - 1.0 for each in sent)
    assert safe > 300
    for topic in topics:
        messages = bag.messages([f'/{topic}'])
        values = [np.frombuffer(message.data[4:12])[0] for message in messages]
        assert len(values) >= safe
        assert values == list(map(float, range(len(values))))


@pytest.mark.thorough
def test_a_demo_is_recorded_and_replayed_with_its_truth(tmp_path, capfd):
    with pytest.raises(SystemExit) as ended:
        demo.main(['level', '--duration', '5', '--record', '--out', str(tmp_path / 'demo')])
    assert ended.value.code in (0, 1)
    recorded, out = tmp_path / 'demo' / 'recording', tmp_path / 'out'
    arguments = [str(recorded), '--params-file', 'level', '--smooth', '--out', str(out)]
    capfd.readouterr()
    with pytest.raises(SystemExit) as ended:
        program.main([*arguments, '--truth', 'ground_truth'])
    printed = capfd.readouterr().out
    assert ended.value.code == 0, printed
    assert 'PASS, 3 of 3 checks: The filter is consistent.' in printed
    assert 'Smoothing changed' in printed
    assert max(map(len, printed.splitlines())) <= 80
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['passed']
    assert summary['sensors']['reading']['fused'] == 51
    assert 0.2 < summary['truth']['nees'] < 3.0
    drawn = {path.name for path in out.glob('*.png')}
    wanted = {'states.png', 'innovations.png', 'consistency.png', 'delays.png'}
    assert wanted <= drawn
    assert not Bag(out / 'estimate').damage
    with pytest.raises(SystemExit) as ended:
        program.main([*arguments, '-p', 'wheels:=3'])
    assert ended.value.code == 2
    assert "replay: unknown parameter 'wheels'" in capfd.readouterr().err
