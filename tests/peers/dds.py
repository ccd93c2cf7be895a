"""Holds what is said on a robot's DDS network against Unitree's own library and Cyclone DDS: requests, answers, states of
a Go2, and velocities and odometry of ROS 2. In a network namespace of its own, whose loopback has multicast.

python dds.py GUIDEDOG
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import types

# The package imports a part that its wheel does not have.
sys.modules["unitree_sdk2py.b2"] = types.ModuleType("unitree_sdk2py.b2")

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from unitree_sdk2py.core.channel import ChannelFactoryInitialize, ChannelSubscriber
from unitree_sdk2py.go2.sport.sport_client import SportClient
from unitree_sdk2py.idl.geometry_msgs.msg.dds_ import Twist_
from unitree_sdk2py.idl.nav_msgs.msg.dds_ import Odometry_
from unitree_sdk2py.idl.unitree_api.msg.dds_ import Request_, Response_
from unitree_sdk2py.idl.unitree_go.msg.dds_ import LowState_, SportModeState_

LOOPBACK = "127.0.0.1"
CONFIG = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces></General></Domain></CycloneDDS>"
WATCHDOG_S = 120
MOVE, STOP_MOVE = 1008, 1003


def until(what, condition):
    """Waits for a condition, but not for ever."""
    ends = time.monotonic() + WATCHDOG_S
    while time.monotonic() < ends:
        if found := condition():
            return found
        time.sleep(0.01)
    raise AssertionError(f"not within {WATCHDOG_S} s: {what}")


def near(a, b):
    """Whether two numbers are the same, but for the last digits of single precision."""
    return abs(a - b) <= 1e-3


def emulated_go2(guidedog):
    """Unitree's own client commands the emulated robot."""
    command = [guidedog, "emulate", "go2", "--network", LOOPBACK]
    robot = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert "Go2" in robot.stderr.readline(), "the robot is there"
        ChannelFactoryInitialize(0, "lo")
        states, low = ChannelSubscriber("rt/sportmodestate", SportModeState_), ChannelSubscriber("rt/lowstate", LowState_)
        states.Init()
        low.Init()
        client = SportClient()
        client.SetTimeout(1.0)
        client.Init()
        until("an answer to BalanceStand", lambda: client.BalanceStand() == 0)
        wanted = (0.3, -0.1, 0.5)

        def walks():
            client.Move(*wanted)
            state = states.Read(0.1)
            return state and all(map(near, (*state.velocity[:2], state.yaw_speed), wanted)) and state

        state = until("it walks as it is told", walks)
        assert state.mode == 3 and near(sum(q * q for q in state.imu_state.quaternion), 1.0), state
        before = state.position
        until("it goes on", lambda: (now := states.Read(0.1)) and now.position[:2] != before[:2])
        assert client.StopMove() == 0
        until("it stands", lambda: (now := states.Read(0.1)) and now.velocity[0] == 0.0)
        assert until("its battery", lambda: low.Read(0.1)).bms_state.soc == 80
        assert client.Hello() == 3203, "what it does not know it says so"
        print("go2: Unitree's client was answered, obeyed and told")
    finally:
        robot.kill()
        robot.wait()


def domain_of(run):
    """The domain that a run has chosen for its emulated robot."""
    with open(run, encoding="utf-8") as settings:
        section = settings.read().split("[locomotion.dds]")[1]
    return int(section.split("domain = ")[1].split()[0])


class Heard:
    """Everything that comes on a topic."""

    def __init__(self, participant, name, kind):
        self.reader = DataReader(participant, Topic(participant, name, kind), Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll))
        self.all = []

    def take(self):
        """What has come."""
        self.all += [sample for sample in self.reader.take(512) if not isinstance(sample, InvalidSample)]
        return self.all


def walk(guidedog, link, topics):
    """A whole walk, whose words Cyclone DDS reads from the network."""
    with tempfile.TemporaryDirectory() as folder:
        config = os.path.join(folder, "robot.toml")
        with open("config/go2.toml", encoding="utf-8") as shipped, open(config, "w", encoding="utf-8") as file:
            file.write(shipped.read().replace('link = "go2"', f'link = "{link}"'))
        run = os.path.join(folder, "peer")
        command = [guidedog, "walk", "--emulated", "--config", config, "--name", "peer", "--json", "--scenario", "corridor", "--time-limit", "12s"]
        process = subprocess.Popen(command, env={**os.environ, "GUIDEDOG_RUNS": folder, "GUIDEDOG_STATE": folder}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            settings = os.path.join(run, "settings.toml")
            until("the run has begun", lambda: os.path.exists(settings) and "[locomotion.dds]" in open(settings, encoding="utf-8").read())
            number = domain_of(settings)
            domain = Domain(number, CONFIG)
            participant = DomainParticipant(number)
            heard = {name: Heard(participant, name, kind) for name, kind in topics.items()}
            while process.poll() is None:
                for topic in heard.values():
                    topic.take()
                time.sleep(0.005)
            out, said = process.communicate()
            report = json.loads(out)
            assert report["distance_m"] > 3.0, (report, said)
            assert domain is not None, "it lives as long as its readers"
            return {name: topic.take() for name, topic in heard.items()}
        finally:
            process.kill()
            process.wait()


def walk_of_a_go2(guidedog):
    """What bridge and emulated Go2 say to each other."""
    kinds = {"rt/api/sport/request": Request_, "rt/api/sport/response": Response_, "rt/sportmodestate": SportModeState_}
    heard = walk(guidedog, "go2", kinds)
    requests = heard["rt/api/sport/request"]
    moves = [request for request in requests if request.header.identity.api_id == MOVE]
    velocities = [json.loads(request.parameter) for request in moves]
    assert len(moves) > 100 and all(request.header.policy.noreply for request in moves), len(moves)
    assert all(set(velocity) == {"x", "y", "z"} for velocity in velocities)
    fastest = max(velocity["x"] for velocity in velocities)
    assert 0.3 < fastest <= 0.8, fastest
    stops = {request.header.identity.id for request in requests if request.header.identity.api_id == STOP_MOVE}
    answers = {answer.header.identity.id for answer in heard["rt/api/sport/response"] if answer.header.status.code == 0}
    assert stops & answers, "a stop was asked for and answered"
    states = heard["rt/sportmodestate"]
    assert max(state.velocity[0] for state in states) > 0.3 and states[-1].velocity[0] == 0.0
    print(f"go2: a walk of {len(moves)} moves, {len(stops)} stops and {len(states)} states")


def walk_of_ros2(guidedog):
    """What bridge and emulated ROS 2 robot say to each other."""
    heard = walk(guidedog, "ros2", {"rt/cmd_vel": Twist_, "rt/odom": Odometry_})
    velocities, poses = heard["rt/cmd_vel"], heard["rt/odom"]
    fastest = max(velocity.linear.x for velocity in velocities)
    assert len(velocities) > 100 and 0.3 < fastest <= 0.8, (len(velocities), fastest)
    last = velocities[-1]
    assert (last.linear.x, last.linear.y, last.angular.z) == (0.0, 0.0, 0.0), last
    place = poses[-1].pose.pose.position
    assert poses[-1].header.frame_id == "odom" and (place.x, place.y) != (0.0, 0.0), place
    print(f"ros2: a walk of {len(velocities)} velocities and {len(poses)} poses")


emulated_go2(sys.argv[1])
walk_of_a_go2(sys.argv[1])
walk_of_ros2(sys.argv[1])
