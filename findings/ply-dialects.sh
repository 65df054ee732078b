#!/usr/bin/env bash
# Valid PLY files that splat tools refuse, or read as other numbers.
#
# One would expect: a reader of INRIA's PLY takes what the format allows: any line ends, comments in UTF-8, doubles, text
#   and big-endian rows.
# What happens: splat-transform refuses headers with CRLF, and takes text and big-endian rows for little-endian ones:
#   other numbers, exit 0. gsply refuses comments that are not ASCII, doubles, text and big-endian rows.
# Packages: @playcanvas/splat-transform 3.7.0 (npm), gsply 0.4.6 and plyfile 1.1.5 (PyPI). Date: 2026-11-27.
# Why it matters: exporters for Windows, georeferenced scenes in doubles and headers with names of people exist. Write
#   LF, ASCII, float and little-endian; read all.
# Output seen:
#   plain: plyfile yes, splat-transform yes, gsply yes
#   crlf: plyfile yes, splat-transform no, gsply yes
#   utf8: plyfile no, splat-transform yes, gsply no
#   double: plyfile yes, splat-transform yes, gsply no
#   big: plyfile yes, splat-transform wrong, gsply no
#   text: plyfile yes, splat-transform wrong, gsply no
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init --yes >npm.log
npm install --silent --no-audit --no-fund @playcanvas/splat-transform@3.7.0 >>npm.log
python3 -m venv tools
tools/bin/pip install --quiet gsply==0.4.6 plyfile==1.1.5 2>pip.log
tools/bin/python - <<'PY'
import numpy as np
names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
names += [f"rot_{i}" for i in range(4)]
rows = np.arange(3 * len(names)).reshape(3, -1) / 8 + 1


def head(kind="float", form="binary_little_endian", comment="made for a test"):
    lines = ["ply", f"format {form} 1.0", f"comment {comment}", "element vertex 3"]
    return "\n".join([*lines, *(f"property {kind} {name}" for name in names), "end_header\n"]).encode()


little = rows.astype("<f4").tobytes()
files = {
    "plain": head() + little,
    "crlf": head().replace(b"\n", b"\r\n") + little,
    "utf8": head(comment="für élève") + little,
    "double": head("double") + rows.astype("<f8").tobytes(),
    "big": head(form="binary_big_endian") + rows.astype(">f4").tobytes(),
    "text": head(form="ascii") + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode(),
}
for name, data in files.items():
    open(f"{name}.ply", "wb").write(data)
PY
for name in plain crlf utf8 double big text; do
  transformed=no
  npx splat-transform -q -w $name.ply $name.csv >log 2>&1 && transformed=yes
  NAME=$name TRANSFORMED=$transformed tools/bin/python - <<'PY'
import csv
import os
import gsply
from plyfile import PlyData
name = os.environ["NAME"]


def reads(read):
    try:
        return "yes" if abs(float(read(f"{name}.ply")) - 1.125) < 1e-6 else "wrong"
    except Exception:
        return "no"


def transformed(_file):
    if os.environ["TRANSFORMED"] == "no":
        raise ValueError
    return next(csv.DictReader(open(f"{name}.csv")))["y"]


by_plyfile = reads(lambda file: PlyData.read(file)["vertex"]["y"][0])
by_gsply = reads(lambda file: gsply.plyread(file).means[0, 1])
print(f"{name}: plyfile {by_plyfile}, splat-transform {reads(transformed)}, gsply {by_gsply}")
PY
done | tee seen
diff seen - <<'END'
plain: plyfile yes, splat-transform yes, gsply yes
crlf: plyfile yes, splat-transform no, gsply yes
utf8: plyfile no, splat-transform yes, gsply no
double: plyfile yes, splat-transform yes, gsply no
big: plyfile yes, splat-transform wrong, gsply no
text: plyfile yes, splat-transform wrong, gsply no
END
