"""Holds the emulated RPLIDARs against the maker's own library: every series, as it connects, what it is told, what it sees.

python rplidar.py GUIDEDOG
"""

import math
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from pyrplidarsdk import RplidarDriver

# Model, speed, and its number as the maker's library tells it.
LIDARS = [
    ("a1", 115200, 0x18),
    ("a1-old", 115200, 0x18),
    ("a2", 115200, 0x28),
    ("a3", 256000, 0x31),
    ("s1", 256000, 0x61),
    ("s2", 1000000, 0x71),
    ("s3", 1000000, 0x81),
    ("c1", 460800, 0x41),
]
# The built-in corridor from its start: clockwise angle, degrees, and range, metres.
WALLS = [(90, 1.2), (180, 3.0), (270, 1.2)]
# Ahead the wall is 40 m away: at the end of what an S1 sees, where noise decides whether it comes back; out of the others' sight.
AHEAD_M = 40.0
SCANS = 10
PATIENCE_S = 20


def until(what, asked):
    """What was asked for, once there is something."""
    ends = time.monotonic() + PATIENCE_S
    while time.monotonic() < ends:
        if found := asked():
            return found
        time.sleep(0.02)
    raise SystemExit(f"never: {what}")


def judge(name, angles_rad, ranges_m):
    """One turn."""
    for wall_deg, expected_m in WALLS:
        seen = [r for a, r in zip(angles_rad, ranges_m) if abs(math.degrees(a) % 360 - wall_deg) < 2]
        assert seen, f"{name}: nothing at {wall_deg} degrees"
        found_m = statistics.median(seen)
        assert abs(found_m - expected_m) < 0.06, f"{name}: {found_m:.3f} m at {wall_deg} degrees, not {expected_m}"
    ahead = [r for a, r in zip(angles_rad, ranges_m) if abs((math.degrees(a) + 180) % 360 - 180) < 1 and r > 0]
    assert all(abs(r - AHEAD_M) < 0.06 for r in ahead), f"{name}: {ahead} ahead, where nothing is nearer than {AHEAD_M} m"


def meet(guidedog, port, name, baud, number):
    """One lidar, from its plug to its farewell."""
    lidar = subprocess.Popen([guidedog, "emulate", "rplidar", "--port", str(port), "--model", name], stderr=subprocess.DEVNULL)
    try:
        until(f"{name}: a port", port.exists)
        driver = RplidarDriver(port=str(port), baudrate=baud)
        assert driver.connect(), f"{name}: the maker's library does not connect"
        info, health = driver.get_device_info(), driver.get_health()
        assert info.model == number, f"{name}: model {info.model:#x}"
        assert health.status == 0, f"{name}: health {health.status}"
        assert driver.start_scan(), f"{name}: no scan begins"
        scans = [until(f"{name}: a turn", driver.get_scan_data) for _ in range(SCANS)]
        # The first may have begun anywhere.
        for angles_rad, ranges_m, _ in scans[1:]:
            judge(name, angles_rad, ranges_m)
        driver.disconnect()
        print(f"{name}: {len(scans)} turns of {statistics.median(len(scan[0]) for scan in scans):.0f} readings")
    finally:
        lidar.kill()
        lidar.wait()


with tempfile.TemporaryDirectory(prefix="gd") as folder:
    for lidar in LIDARS:
        meet(sys.argv[1], pathlib.Path(folder) / f"lidar-{lidar[0]}", *lidar)
