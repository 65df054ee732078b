#!/usr/bin/env bash
# pyrr's matrices hold translations for row vectors and rotations for column vectors: each turns against its own quaternion.
#
# One would expect: q * v and Matrix44.from_quaternion(q) * v to be the same vector, and the matrix in OpenGL, whose columns are the
#   rows of pyrr, to place a model by translation and quaternion, since pyrr's perspective and look_at work there.
# What happens: translations and look_at are for row vectors, and so is the product of matrix and vector. Matrices of a
#   quaternion, an angle or Euler angles are those for column vectors. So they turn the other way, on the CPU and in a shader, while
#   translations are right; the quaternion of a look_at turns against its matrix. Quaternion to matrix and back is q again.
# Package: pyrr 0.10.3 (PyPI). Date: 2026-11-30.
# Why it matters: viewers in Python take cameras and poses from it. Gaussians and cameras have quaternions: models beside a scene turn
#   against it, and directions of view that come from q and from the matrix differ. Take from_inverse_of_quaternion.
# Output seen (1 0 0 turned by 90 degrees about z should be 0 1 0):
#   q * v: 0 1 0
#   Matrix33.from_quaternion(q) * v: 0 -1 0
#   Matrix44.from_quaternion(q) * v: 0 -1 0
#   Matrix44.from_z_rotation(90 degrees) * v: 0 -1 0
#   Matrix44.from_translation(10 0 0) * v: 11 0 0
#   in OpenGL, quaternion, then translation: 10 -1 0
#   Matrix44.from_inverse_of_quaternion(q) * v: 0 1 0
#   look_at from 0 0 0 along x, of 1 0 0: by the matrix 0 0 -1, by its quaternion 0 0 1
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet pyrr==0.10.3 numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import sys

import numpy as np
from pyrr import Matrix33, Matrix44, Quaternion, Vector3

vector = Vector3([1.0, 0.0, 0.0])
q = Quaternion.from_z_rotation(np.pi / 2)
move = Matrix44.from_translation([10.0, 0.0, 0.0])
# OpenGL reads the 16 numbers column by column, and multiplies by a column.
model = np.array(move * Matrix44.from_quaternion(q)).reshape(16).reshape(4, 4, order="F")
# The camera looks along -z of its own.
view = Matrix44.look_at([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
found = {
    "q * v": q * vector,
    "Matrix33.from_quaternion(q) * v": Matrix33.from_quaternion(q) * vector,
    "Matrix44.from_quaternion(q) * v": Matrix44.from_quaternion(q) * vector,
    "Matrix44.from_z_rotation(90 degrees) * v": Matrix44.from_z_rotation(np.pi / 2) * vector,
    "Matrix44.from_translation(10 0 0) * v": move * vector,
    "in OpenGL, quaternion, then translation": (model @ [1, 0, 0, 1])[:3],
    "Matrix44.from_inverse_of_quaternion(q) * v": Matrix44.from_inverse_of_quaternion(q) * vector,
    "look_at": view * vector,
    "its quaternion": view.quaternion * vector,
}
texts = {title: " ".join(f"{number:.0f}" for number in np.round(value) + 0.0) for title, value in found.items()}
for title in list(texts)[:-2]:
    print(f"{title}: {texts[title]}")
print(f"look_at from 0 0 0 along x, of 1 0 0: by the matrix {texts['look_at']}, by its quaternion {texts['its quaternion']}")
expected = ["0 1 0", "0 -1 0", "0 -1 0", "0 -1 0", "11 0 0", "10 -1 0", "0 1 0", "0 0 -1", "0 0 1"]
sys.exit(list(texts.values()) != expected)
PY
