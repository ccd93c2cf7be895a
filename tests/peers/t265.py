"""Holds the odometry driver against Intel's own library: poses of a tracking camera in software, which the library records,
and plays to the driver; they have to come out in a recording, laid onto the floor.

python t265.py GUIDEDOG
"""

import json
import math
import pathlib
import sys
import tempfile
import time

import pyrealsense2 as rs
from mcap.reader import make_reader

from realsense import Run

POSES, PERIOD_S, SPEED_MPS, MOUNT_M = 200, 0.01, 0.5, 0.2


def vector(x, y, z):
    it = rs.vector()
    it.x, it.y, it.z = x, y, z
    return it


def record(path):
    """A camera that goes straight ahead, turned by 30 degrees to the left: its axes are x right, y up, z backward."""
    stream = rs.pose_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.fps = rs.stream.pose, 0, 0, rs.format.six_dof, 100
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software T265")
    device.register_info(rs.camera_info.serial_number, "54321")
    sensor = device.add_sensor("Tracking")
    profile = sensor.add_pose_stream(stream).as_pose_stream_profile()
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles()[0])
    recorded.start(rs.frame_queue(2 * POSES))
    left = math.radians(30)
    for k in range(POSES):
        pose, rotation = rs.pose(), rs.quaternion()
        way_m = SPEED_MPS * PERIOD_S * k
        pose.translation = vector(-way_m * math.sin(left), 0.0, -way_m * math.cos(left))
        pose.velocity = vector(-SPEED_MPS * math.sin(left), 0.0, -SPEED_MPS * math.cos(left))
        rotation.x, rotation.y, rotation.z, rotation.w = 0.0, math.sin(left / 2), 0.0, math.cos(left / 2)
        pose.rotation = rotation
        # It begins lost.
        pose.tracker_confidence = 0 if k < 20 else 3
        frame = rs.software_pose_frame()
        frame.data, frame.frame_number, frame.profile = pose, k, profile
        frame.timestamp, frame.domain = 1000.0 + k * 1000.0 * PERIOD_S, rs.timestamp_domain.hardware_clock
        sensor.on_pose_frame(frame)
        # It is played as fast as it came.
        time.sleep(PERIOD_S)
    recorded.stop()
    recorded.close()


def configure(folder, name, t265):
    path = folder / f"{name}.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in t265.items()]
    odometry = '[odometry]\nsource = "device"\ndevice = "t265"\n[odometry.robot_from_camera]\n'
    mount = f"x_m = {MOUNT_M}\ny_m = 0.0\nz_m = 0.4\nyaw_rad = 0.0\npitch_rad = 0.0\n[odometry.t265]\n"
    path.write_text(odometry + mount + "\n".join(lines) + f'\n[record]\npath = "{name}.mcap"\n')
    return str(path)


def is_back(status):
    status = json.loads(status)
    odometry = next(service for service in status["services"] if service["name"] == "odometry")
    return odometry["restarts"] > 0 and status["stream_age_ms"].get("odometry", 1000) < 100


def main(guidedog):
    with tempfile.TemporaryDirectory(prefix="gd", dir="/tmp") as folder:
        folder = pathlib.Path(folder)
        run, library = Run(guidedog, folder), rs.pyrealsense2.__file__
        record(folder / "tracked.bag")

        played = configure(folder, "played", {"library": library, "file": "tracked.bag"})
        assert "tracked.bag is there" in run.say("doctor", "--config", played)
        # The file begins again, from where it began: that is a frame of its own.
        status = run.until(played, lambda status: "the tracking camera jumped" in status and is_back(status))
        assert "Software T265, serial number 54321" in status, status
        assert "the tracking camera is lost" in status, status
        poses, left = [], math.radians(30)
        with open(folder / "played.mcap", "rb") as stream:
            for _, _, message in make_reader(stream).iter_messages(topics=["odometry"]):
                odometry = json.loads(message.data)["guidedog"]
                at, twist = odometry["odom_from_robot"], odometry["twist"]
                way_m = at["x_m"] * math.cos(left) + at["y_m"] * math.sin(left) + MOUNT_M
                beside_m = at["y_m"] * math.cos(left) - at["x_m"] * math.sin(left)
                assert 20 * SPEED_MPS * PERIOD_S < way_m + 0.001 < POSES * SPEED_MPS * PERIOD_S, at
                assert abs(beside_m) < 0.001 and abs(at["yaw_rad"] - left) < 1e-5, at
                assert abs(twist["vx_mps"] - SPEED_MPS) < 1e-5 and abs(twist["vy_mps"]) < 1e-5, twist
                poses.append(odometry)
        assert len(poses) > 20 and len({pose["incarnation"] for pose in poses}) > 1, f"{len(poses)} poses"

        none = configure(folder, "none", {"library": library})
        assert "no such camera among those plugged in (0)" in run.say("doctor", "--config", none)
        lacking = configure(folder, "lacking", {"library": "librealsense2.so"})
        said = run.say("doctor", "--config", lacking)
        assert "odometry.t265.library" in said and "2.43 to 2.53" in said, said
    print(f"t265: {len(poses)} poses, as Intel's library plays them", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1])
