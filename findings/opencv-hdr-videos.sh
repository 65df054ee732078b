#!/usr/bin/env bash
# OpenCV since 4.13 cuts the lights of HDR videos: all that is brighter than paper white is 255; 4.12 and PyAV keep them.
#
# One would expect: frames of a video in HLG or PQ, taken as 8 bits without a word about it, to hold the numbers of the file, flat and
#   dark, as older OpenCV and PyAV have it; or a curve that brings the lights into the range.
# What happens: OpenCV 4.13 and 5.0 turn the picture into SDR by its curve, so that white of 203 cd/m2 becomes 255, and cut what is
#   above: a quarter of the codes of HLG, two fifths of those of PQ. Dark and middle greys are right for a screen. 4.12 and PyAV
#   take any curve for that of SDR.
# Packages: opencv-python-headless 4.12.0.88, 4.13.0.92 and 5.0.0.93, av 18.1.0 (PyPI). Date: 2026-11-30.
# Why it matters: phones record HLG. Windows, lamps and sunlit walls become one flat white in the frames that a training gets, and
#   an update of OpenCV changes the exposure of a capture; frames of two tools do not mix. Convert to SDR by a curve of your own.
# Output seen (16 greys from black to white, red of each; 4.13 has the numbers of 5.0):
#   hlg, PyAV: 0 16 32 49 67 83 101 117 134 152 168 186 202 219 237 253
#   hlg, OpenCV 4.12.0: 0 17 34 51 68 85 102 119 136 153 170 187 204 221 238 255
#   hlg, OpenCV 5.0.0: 0 19 38 57 76 95 114 134 153 177 207 243 255 255 255 255
#   pq, OpenCV 4.12.0: 0 17 34 51 68 85 102 119 136 153 170 187 204 221 238 255
#   pq, OpenCV 5.0.0: 0 11 24 40 61 86 118 159 209 255 255 255 255 255 255 255
#   sdr, OpenCV 5.0.0: 0 17 34 51 68 85 102 119 136 153 170 187 204 221 238 255
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 4.12.0.88 4.13.0.92 5.0.0.93; do
    python3 -m venv "opencv-$version"
    "opencv-$version/bin/pip" install --quiet "opencv-python-headless==$version" 2>pip.log
done
python3 -m venv tools
tools/bin/pip install --quiet av==18.1.0 numpy==2.4.6 2>pip.log
cat >make.py <<'PY'
"""Videos of 16 grey bars in 10 bits: curves and primaries by their numbers in H.273."""

import av
import numpy as np

for name, curve, primaries in (("sdr", 14, 9), ("hlg", 18, 9), ("pq", 16, 9)):
    with av.open(f"{name}.mp4", "w") as container:
        stream = container.add_stream("libx265", rate=30)
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p10le"
        stream.options = {"x265-params": "log-level=none:lossless=1"}
        planes = np.full((540, 640), 512, np.uint16)
        planes[:360] = 64 + np.round(876 * (np.arange(640) // 40) / 15)
        for time in range(3):
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p10le")
            for target in (stream.codec_context, frame):
                target.colorspace, target.color_range = primaries, 1
                target.color_primaries, target.color_trc = primaries, curve
            frame.pts = time
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with av.open(f"{name}.mp4") as container:
        frame = next(container.decode(video=0))
        print(f"{name}, PyAV:", *frame.to_ndarray(format="rgb24")[100, 20::40, 0])
PY
cat >read.py <<'PY'
import sys

import cv2

version = cv2.__version__
for name in ("sdr", "hlg", "pq"):
    frame = cv2.VideoCapture(f"{name}.mp4").read()[1]
    print(f"{name}, OpenCV {version}:", *frame[100, 20::40, 2])
PY
{
    tools/bin/python make.py
    for version in 4.12.0.88 4.13.0.92 5.0.0.93; do "opencv-$version/bin/python" read.py; done
} 2>video.log | sort -s -t, -k1,1 | tee greys.txt
tools/bin/python - <<'PY'
import sys

# How many of the brightest greys are 255.
white = {}
for line in open("greys.txt"):
    title, greys = line.split(":")
    white[title] = greys.split().count("255")
new = ("OpenCV 4.13.0", "OpenCV 5.0.0")
as_told = all(white[f"hlg, {reader}"] >= 3 and white[f"pq, {reader}"] >= 6 and white[f"sdr, {reader}"] == 1 for reader in new)
sys.exit(not (as_told and all(white[f"{name}, {reader}"] <= 1 for name in ("hlg", "pq") for reader in ("PyAV", "OpenCV 4.12.0"))))
PY
