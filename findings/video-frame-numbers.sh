#!/usr/bin/env bash
# Frame n of a phone's video is another one for OpenCV's seek, for imageio and for imageio-ffmpeg.
#
# One would expect: the frame that is the n-th when all are read in order, or an error where a format cannot tell; and a seek to the
#   time that the file states for a frame to find that frame.
# What happens: of a video with frames of one length all agree. A phone makes frames longer where light is poor. Then OpenCV's
#   POS_FRAMES is a time at the mean rate: the frame of that time is given, POS_FRAMES tells the number that was asked for, and the
#   last numbers give none. POS_MSEC is off, too. imageio's FFMPEG plugin counts frames that it repeats at the highest rate, 300
#   of 200. Its pyav plugin is right within a stretch and wrong behind it. Reading in order is right with OpenCV and PyAV.
# Packages: opencv-python-headless 5.0.0.93, av 18.1.0, imageio 2.38.1 and imageio-ffmpeg 0.8.1 (PyPI). Date: 2026-11-30.
# Why it matters: sharp frames are picked by one pass and fetched by number in another, or times of frames are matched with a track of
#   poses: other frames come, blurred ones or ones of another pose, a second away. Read in order, and keep frames as they pass.
# Output seen (100 frames of 1/30 s, then 100 of 1/15 s; the frames got for 10, 77, 150 and 199):
#   steady, frames in order: PyAV 200, OpenCV 200, imageio FFMPEG 200
#   steady: OpenCV POS_FRAMES 10 77 150 199, POS_MSEC 10 77 150 199, imageio FFMPEG 10 77 150 199, imageio pyav 10 77 150 199
#   varied, frames in order: PyAV 200, OpenCV 200, imageio FFMPEG 300
#   varied: OpenCV POS_FRAMES 10 98 173 none, POS_MSEC 7 62 158 none, imageio FFMPEG 10 77 162 198, imageio pyav 10 77 150 171
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet opencv-python-headless==5.0.0.93 av==18.1.0 imageio==2.38.1 imageio-ffmpeg==0.8.1 numpy 2>pip.log
tools/bin/python - <<'PY' | tee seen
from fractions import Fraction

import av
import cv2
import imageio.v3 as iio
import numpy as np

TICK = Fraction(1, 600)
ASKED = (10, 77, 150, 199)


def draw(number):
    """A picture that shows its number: eight stripes, white for a bit that is set."""
    bits = (number >> np.arange(8)) & 1
    row = np.where(bits, 235, 20).repeat(32)
    return np.broadcast_to(row[None, :, None], (64, 256, 3)).astype(np.uint8)


def number_of(picture):
    lit = picture[20:44].mean(axis=(0, 2)).reshape(8, 32)[:, 8:24].mean(axis=1) > 127
    return int((lit << np.arange(8)).sum())


def write(path, ticks):
    with av.open(path, "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"g": "50", "bf": "3"})
        stream.width, stream.height, stream.pix_fmt = 256, 64, "yuv420p"
        stream.time_base = stream.codec_context.time_base = TICK
        for number, tick in enumerate(ticks):
            frame = av.VideoFrame.from_ndarray(draw(number), format="rgb24")
            frame.pts, frame.time_base = int(tick), TICK
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def by_opencv(path, position, value):
    video = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    video.set(position, value)
    found, picture = video.read()
    return number_of(picture) if found else "none"


def in_order(path):
    with av.open(path) as file:
        of_pyav = [number_of(frame.to_ndarray(format="rgb24")) for frame in file.decode(video=0)]
    video, of_opencv = cv2.VideoCapture(path, cv2.CAP_FFMPEG), []
    while (read := video.read())[0]:
        of_opencv.append(number_of(read[1]))
    if not of_pyav == of_opencv == list(range(200)):
        raise SystemExit("reading in order is not right")
    return f"PyAV {len(of_pyav)}, OpenCV {len(of_opencv)}, imageio FFMPEG {len(list(iio.imiter(path, plugin='FFMPEG')))}"


for title, lengths in {"steady": [20] * 199, "varied": [20] * 100 + [40] * 99}.items():
    path, ticks = f"{title}.mp4", np.cumsum([0, *lengths])
    write(path, ticks)
    print(f"{title}, frames in order: {in_order(path)}")
    got = {
        "OpenCV POS_FRAMES": [by_opencv(path, cv2.CAP_PROP_POS_FRAMES, number) for number in ASKED],
        "POS_MSEC": [by_opencv(path, cv2.CAP_PROP_POS_MSEC, float(1000 * ticks[number] * TICK)) for number in ASKED],
        "imageio FFMPEG": [number_of(iio.imread(path, index=number, plugin="FFMPEG")) for number in ASKED],
        "imageio pyav": [number_of(iio.imread(path, index=number, plugin="pyav")) for number in ASKED],
    }
    print(f"{title}: {', '.join(f'{name} ' + ' '.join(map(str, numbers)) for name, numbers in got.items())}")
PY
diff seen - <<'END'
steady, frames in order: PyAV 200, OpenCV 200, imageio FFMPEG 200
steady: OpenCV POS_FRAMES 10 77 150 199, POS_MSEC 10 77 150 199, imageio FFMPEG 10 77 150 199, imageio pyav 10 77 150 199
varied, frames in order: PyAV 200, OpenCV 200, imageio FFMPEG 300
varied: OpenCV POS_FRAMES 10 98 173 none, POS_MSEC 7 62 158 none, imageio FFMPEG 10 77 162 198, imageio pyav 10 77 150 171
END
