"""Holds the depth driver against Intel's own library: frames of a camera in software, which the library records, and plays
to the driver; pixels, lens and unit have to come out in a recording, which is read by a reader that is none of ours.

python realsense.py GUIDEDOG
"""

import array
import json
import os
import pathlib
import subprocess
import sys
import sysconfig
import tempfile
import time

import pyrealsense2 as rs
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

WIDTH, HEIGHT, FRAMES, RATE_HZ = 64, 48, 30, 30
UNIT_M = 0.0001
LENS = {"fx_px": 50.0, "fy_px": 51.0, "cx_px": 31.5, "cy_px": 23.5}


def pixels(frame):
    """What the camera sees, in its unit: near, far and nothing."""
    return [(i * 40503 >> 3) % 65536 for i in range(frame * WIDTH * HEIGHT, (frame + 1) * WIDTH * HEIGHT)]


def record(path):
    """Frames of a camera in software, recorded by the library."""
    lens = rs.intrinsics()
    lens.width, lens.height, lens.model, lens.coeffs = WIDTH, HEIGHT, rs.distortion.brown_conrady, [0.0] * 5
    lens.fx, lens.fy, lens.ppx, lens.ppy = LENS.values()
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.depth, 0, 0, rs.format.z16
    stream.width, stream.height, stream.fps, stream.bpp, stream.intrinsics = WIDTH, HEIGHT, RATE_HZ, 2, lens
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software")
    device.register_info(rs.camera_info.serial_number, "12345")
    sensor = device.add_sensor("Depth")
    profile = sensor.add_video_stream(stream).as_video_stream_profile()
    sensor.add_read_only_option(rs.option.depth_units, UNIT_M)
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles()[0])
    recorded.start(rs.frame_queue(2 * FRAMES))
    for k in range(FRAMES):
        frame = rs.software_video_frame()
        frame.pixels = memoryview(array.array("H", pixels(k))).cast("B").cast("H", (HEIGHT, WIDTH))
        frame.stride, frame.bpp, frame.frame_number, frame.profile, frame.depth_units = 2 * WIDTH, 2, k, profile, UNIT_M
        frame.timestamp, frame.domain = 1000.0 + k * 1000.0 / RATE_HZ, rs.timestamp_domain.hardware_clock
        sensor.on_video_frame(frame)
        # The library writes from a queue of its own.
        time.sleep(0.01)
    recorded.stop()
    recorded.close()


class Run:
    """guidedog in a folder of its own. This library is a Python module too, and finds Python only where it is there already."""

    def __init__(self, guidedog, folder):
        self.guidedog, self.folder = os.path.abspath(guidedog), folder
        name = sysconfig.get_config_var("INSTSONAME")
        python = pathlib.Path(sysconfig.get_config_var("LIBDIR"), name)
        self.env = {**os.environ, "GUIDEDOG_RUNS": str(folder / "r"), "GUIDEDOG_STATE": str(folder / "s"), "LD_PRELOAD": str(python if python.exists() else name)}

    def configure(self, name, realsense):
        path = self.folder / f"{name}.toml"
        lines = [f"{key} = {json.dumps(value)}" for key, value in realsense.items()]
        depth = '[depth]\nsource = "device"\ndevice = "realsense"\nrange_m = [0.001, 65.0]\n[depth.realsense]\n'
        path.write_text(depth + "\n".join(lines) + f'\n[record]\npath = "{name}.mcap"\n')
        return str(path)

    def say(self, *args):
        done = subprocess.run([self.guidedog, *args], env=self.env, capture_output=True, text=True)
        return done.stdout + done.stderr

    def until(self, config, told):
        """Runs until the status says it: what it said."""
        up = [self.guidedog, "up", "--name", "it", "--scenario", "corridor", "--config", config]
        run = subprocess.Popen(up, env=self.env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            ends, status = time.monotonic() + 60, ""
            while not told(status):
                assert run.poll() is None, f"it ended ({run.returncode}): {run.stderr.read()}"
                assert time.monotonic() < ends, f"never told: {status}"
                status = self.say("status", "--json", "--run", "it")
            return status
        finally:
            run.send_signal(2)
            run.wait()


def a_second_of_frames():
    """Of a status: whether a second of frames has come since a cue could first be given, when the recorder was there."""
    first = None

    def told(status):
        nonlocal first
        try:
            status = json.loads(status)
        except json.JSONDecodeError:
            return False
        frames = status["published"].get("depth/frame", 0)
        if first is None and status["mode"]["ready_for_cue"]:
            first = frames
        return first is not None and frames >= first + 30

    return told


def main(guidedog):
    with tempfile.TemporaryDirectory(prefix="gd", dir="/tmp") as folder:
        folder = pathlib.Path(folder)
        run, library = Run(guidedog, folder), rs.pyrealsense2.__file__
        record(folder / "seen.db3")

        played = run.configure("played", {"library": library, "file": "seen.db3"})
        assert "seen.db3 is there" in run.say("doctor", "--config", played)
        status = run.until(played, a_second_of_frames())
        assert "Software, serial number 12345" in status, status
        wanted = [pixels(k) for k in range(FRAMES)]
        seen = set()
        with open(folder / "played.depth.mcap", "rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for _, _, _, image in reader.iter_decoded_messages(topics=["depth/frame"]):
                assert (image.width, image.height, image.encoding) == (WIDTH, HEIGHT, "16UC1")
                beside = json.loads(image.guidedog)
                assert all(beside[key] == value for key, value in LENS.items()), beside
                mm = array.array("H", image.data)
                near = lambda units: all(abs(a - b * UNIT_M * 1000) <= 0.501 for a, b in zip(mm, units))
                seen.add(next(k for k, units in enumerate(wanted) if near(units)))
        assert len(seen) > 3, f"of {FRAMES} frames these arrived: {seen}"

        none = run.configure("none", {"library": library})
        assert "no such camera among those plugged in (0)" in run.say("doctor", "--config", none)
        missing = run.configure("missing", {"library": library, "file": "nothing.db3"})
        run.until(missing, lambda status: "nothing.db3 is no file" in status)
        lacking = run.configure("lacking", {"library": "librealsense2.so"})
        assert "depth.realsense.library" in run.say("doctor", "--config", lacking)
        status = run.until(lacking, lambda status: "librealsense2.so cannot be opened" in status)
        assert "apt: librealsense2" in status, status
    print(f"realsense: {len(seen)} of {FRAMES} frames, as Intel's library {rs.__version__} plays them", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1])
