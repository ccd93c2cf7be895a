"""Hands a camera's depth frames to guidedog ([depth] source = "device", device = "socket"): depth_socket.py SOCKET zed|wall

What a frame is stands in shared/camera/src/lib.rs. Another camera is another function like zed().
"""

import socket, struct, sys, time


def zed():
    import numpy, pyzed.sl as sl

    camera, depth_mm = sl.Camera(), sl.Mat()
    if camera.open(sl.InitParameters(coordinate_units=sl.UNIT.MILLIMETER)) != sl.ERROR_CODE.SUCCESS:
        sys.exit("no ZED can be opened")
    lens = camera.get_camera_information().camera_configuration.calibration_parameters.left_cam
    while camera.grab() == sl.ERROR_CODE.SUCCESS:
        age_ns = time.time_ns() - camera.get_timestamp(sl.TIME_REFERENCE.IMAGE).get_nanoseconds()
        camera.retrieve_measure(depth_mm, sl.MEASURE.DEPTH)
        pixels = numpy.nan_to_num(depth_mm.get_data(), nan=0, posinf=0, neginf=0).clip(0, 65535).astype("uint16")
        yield time.monotonic_ns() - age_ns, pixels.shape[::-1], (lens.fx, lens.fy, lens.cx, lens.cy), pixels.tobytes()


def wall():  # 2 m ahead of a level camera 0.45 m above the floor, without any camera
    rows_mm = [min(2000, int(450 * 160 / (v - 119.5)) if v > 119.5 else 2000) for v in range(240)]
    pixels = b"".join(struct.pack("=H", mm) * 320 for mm in rows_mm)
    while True:
        yield time.monotonic_ns(), (320, 240), (160, 160, 159.5, 119.5), pixels
        time.sleep(1 / 15)


camera = {"zed": zed, "wall": wall}.get(sys.argv[2]) if len(sys.argv) == 3 else None
if camera is None:
    sys.exit(__doc__)
driver = None
for taken_ns, size, lens, pixels in camera():
    try:  # the driver may come later than this, and come back
        if driver is None:
            driver = socket.socket(socket.AF_UNIX)
            driver.connect(sys.argv[1])
        driver.sendall(struct.pack("=8sQ2I4f", b"GDDEPTH1", taken_ns, *size, *lens) + pixels)
    except OSError:
        driver = None
