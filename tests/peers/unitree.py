"""Holds the emulated Go1 against Unitree's own library: what is commanded, and what the robot says of itself.

python unitree.py GUIDEDOG
"""

import socket
import subprocess
import sys
import time

from unitree_legged_sdk import robot_interface as sdk

HIGH_LEVEL = 0xEE
PERIOD_S = 0.002
# Mode, forward, left, turn; the last is the library's own example of a walk.
COMMANDS = [(0, 0.0, 0.0, 0.0), (1, 0.0, 0.0, 0.0), (2, 0.3, -0.1, 0.5), (2, 0.0, 0.25, -0.75), (2, 0.5, 0.0, 0.0)]


def free_port():
    """A port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        return line.getsockname()[1]


def command(udp, cmd, state, mode, forward, left, turn, for_s):
    """Commands, as the library's examples do, and hears what comes back."""
    cmd.mode, cmd.gaitType, cmd.velocity, cmd.yawSpeed = mode, 1 if mode == 2 else 0, [forward, left], turn
    ends = time.monotonic() + for_s
    while time.monotonic() < ends:
        udp.Recv()
        udp.GetRecv(state)
        udp.SetSend(cmd)
        udp.Send()
        time.sleep(PERIOD_S)


def near(a, b, by=1e-3):
    """Whether two numbers are the same, but for the last digits of single precision."""
    return abs(a - b) <= by


def main(guidedog):
    """The whole conversation."""
    port = free_port()
    listen = f"127.0.0.1:{port}"
    robot = subprocess.Popen([guidedog, "emulate", "unitree", "--profile", "go1-3.8", "--listen", listen], stderr=subprocess.PIPE, text=True)
    try:
        assert listen in robot.stderr.readline(), "the robot listens"
        udp = sdk.UDP(HIGH_LEVEL, free_port(), "127.0.0.1", port)
        cmd, state = sdk.HighCmd(), sdk.HighState()
        udp.InitCmdData(cmd)
        for mode, forward, left, turn in COMMANDS:
            command(udp, cmd, state, mode, forward, left, turn, 0.5)
            walks = mode == 2
            told = (state.mode, *state.velocity[:2], state.yawSpeed)
            wanted = (mode, forward * walks, left * walks, turn * walks)
            assert all(near(a, b) for a, b in zip(told, wanted)), f"commanded {wanted}, and the robot says {told}"
        x_before = state.position[0]
        command(udp, cmd, state, 2, 0.5, 0.0, 0.0, 1.0)
        assert state.position[0] != x_before, "it has gone on"
        assert state.bms.SOC == 80, f"charge {state.bms.SOC}"
        w, _, _, z = state.imu.quaternion
        assert near(w * w + z * z, 1.0), f"attitude {state.imu.quaternion}"
        print(f"go1-3.8: {len(COMMANDS)} commands taken, at {state.position[0]:.2f}, {state.position[1]:.2f} m")
        # A robot that keeps its last command: nothing is sent any more, and it walks.
        robot.terminate()
        said = robot.stderr.read()
        assert "Walk: 0.50 m/s ahead" in said, said
    finally:
        robot.kill()
        robot.wait()


main(sys.argv[1])
