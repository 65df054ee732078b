"""Chunks of a scene are, one after the other, what a reader of everything gives."""

from __future__ import annotations

import os
import pickle
from functools import partial
from pathlib import Path

import fsspec
import numpy as np
import pytest

from reference_encoder.out_of_core.source import Inputs, find_inputs, read, read_positions
from scarfmt import formats
from scarfmt.errors import InputWarning
from scarfmt.formats.export_ply import ply_header, ply_rows
from scarfmt.scene.gaussians import GaussianScene, concatenate
from tests.formats.scene_files import compressed_ply, inria_names, inria_ply, ply, read_scene, sog_files, splat, spz
from tests.formats.test_streamed_sog import streamed
from tests.reference_encoder.out_of_core.scenes import clusters, equal, ply_of
from tests.samples.codec_samples import refuses


def all_of(inputs: Inputs) -> GaussianScene:
    """Every chunk, as a worker reads it that got the descriptor from elsewhere."""
    chunks = pickle.loads(pickle.dumps(inputs.chunks))
    assert [chunk.number for chunk in chunks] == list(range(len(chunks)))
    parts = [part for chunk in chunks for part in chunk.parts]
    found = concatenate([read(part)[0] for part in parts])
    assert np.array_equal(np.concatenate([read_positions(part) for part in parts]), found.positions, equal_nan=True)
    return found


@pytest.mark.parametrize("rows", [1, 7, 40, 1000])
@pytest.mark.parametrize("form", ["little", "big", "ascii"])
def test_a_ply_in_chunks_is_the_ply(tmp_path: Path, rows: int, form: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(inria_ply(40, form=form))
    inputs = find_inputs(str(path), rows)
    assert equal(all_of(inputs), read_scene(path))
    assert len(inputs.chunks) == (1 if form == "ascii" else -(-40 // rows))


def test_columns_come_in_any_order_and_type_and_after_other_elements(tmp_path: Path) -> None:
    """Rows are found by the types of all their columns, and by the rows of elements before them."""
    names = ["nx", *reversed(inria_names(9)), "label"]
    values = np.random.default_rng(0).normal(size=(30, len(names))).round()
    kinds = [("uchar" if name == "label" else "double" if name in "xyz" else "float", name) for name in names]
    body = ply(kinds, np.abs(values))
    before = b"element camera 3\nproperty double focal\nproperty uchar id\n"
    path = tmp_path / "a.ply"
    for more, size in ((b"property list uchar int seen\n", 30), (b"", 27)):
        header = body.replace(b"element vertex", before + more + b"element vertex", 1)
        path.write_bytes(header.replace(b"end_header\n", b"end_header\n" + bytes(size), 1))
        assert equal(all_of(find_inputs(str(path), 8)), read_scene(path))
    with pytest.warns(InputWarning, match="columns label"):
        find_inputs(str(path), 8)


def test_a_folder_is_its_files_by_name(tmp_path: Path) -> None:
    """Small files whose size is known share a chunk; others are one each."""
    files = {"b.ply": inria_ply(5), "a.spz": spz(3), "c.splat": splat()}
    files |= {"d.PLY": compressed_ply(), "e.ply": inria_ply(4)}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "notes.txt").write_text("not a scene")
    inputs = find_inputs(str(tmp_path), 100)
    assert equal(all_of(inputs), concatenate([read_scene(tmp_path / name) for name in sorted(files)]))
    assert set(inputs.versions) == {str(tmp_path / name) for name in files}
    assert len(find_inputs(str(tmp_path), 100).chunks) < len(find_inputs(str(tmp_path), 2).chunks)


def test_the_finest_level_of_a_streamed_sog_is_read(tmp_path: Path) -> None:
    index = streamed(tmp_path, {"environment": "env/meta.json"})
    for origin in (index, tmp_path):
        assert equal(all_of(find_inputs(str(origin), 4)), read_scene(index))
    before = find_inputs(str(index)).versions
    next((tmp_path / "0_0").glob("*.webp")).write_bytes(b"another picture")
    assert find_inputs(str(index)).versions != before


def test_everything_can_be_at_a_url(tmp_path: Path) -> None:
    """PLY by ranges, folders by listing, images of a SOG beside their metadata."""
    system = fsspec.filesystem("memory")
    streamed(tmp_path)
    for path in tmp_path.rglob("*"):
        if path.is_file():
            system.pipe(f"/stream/{path.relative_to(tmp_path)}", path.read_bytes())
    system.pipe({"/tiles/a.ply": inria_ply(9), "/tiles/b.splat": splat()})
    system.pipe({f"/one/{name}": data for name, data in sog_files().items()})
    (tmp_path / "a.ply").write_bytes(inria_ply(9))
    (tmp_path / "b.splat").write_bytes(splat())
    expected = concatenate([read_scene(tmp_path / "a.ply"), read_scene(tmp_path / "b.splat")])
    assert equal(all_of(find_inputs("memory://tiles", 4)), expected)
    assert equal(all_of(find_inputs("memory://tiles/a.ply", 4)), read_scene(tmp_path / "a.ply"))
    assert equal(all_of(find_inputs("memory://stream/lod-meta.json")), read_scene(tmp_path / "lod-meta.json"))
    assert len(all_of(find_inputs("memory://one"))) == 6


def test_anchor_models_are_for_the_encoder_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "point_cloud" / "iteration_7" / "point_cloud.ply"
    path.parent.mkdir(parents=True)
    path.write_bytes(ply([("float", "x"), ("float", "f_anchor_feat_0"), ("float", "f_offset_0")], np.zeros((1, 3))))
    for origin in (tmp_path, path):
        refuses("input-not-gaussians", partial(find_inputs, str(origin)), "leave out --work")


def test_what_a_reader_of_everything_refuses_is_refused(tmp_path: Path) -> None:
    scene = clusters(20)
    path = tmp_path / "a.ply"
    whole = ply_header(20, 3) + ply_rows(scene).tobytes()
    refused = {
        whole[:-1]: "input-corrupt",
        whole.replace(b"property float opacity\n", b""): "input-not-gaussians",
        whole.replace(b"f_rest_8", b"f_rest_9"): "input-sh-degree",
        whole.replace(b"vertex 20", b"vertex 99999999999"): "input-limit",
    }
    for data, refusal in refused.items():
        path.write_bytes(data)
        refuses(refusal, lambda: find_inputs(str(path), 5))
        refuses(refusal, lambda: formats.load(path))
    (tmp_path / "empty").mkdir()
    refuses("input-empty", lambda: find_inputs(str(tmp_path / "empty")), "no scene in this folder")


def test_a_file_that_got_shorter_is_told(tmp_path: Path) -> None:
    path = Path(ply_of(clusters(20), tmp_path))
    inputs = find_inputs(str(path), 5)
    path.write_bytes(path.read_bytes()[:-100])
    refuses("input-corrupt", lambda: all_of(inputs))


def test_a_changed_file_has_another_version(tmp_path: Path) -> None:
    """By which a journal tells that what it has is of another scene."""
    name = ply_of(clusters(20), tmp_path)
    before = find_inputs(name).versions
    assert find_inputs(name).versions == before
    status, data = os.stat(name), Path(name).read_bytes()
    Path(name).write_bytes(data[:-4] + bytes(4))
    os.utime(name, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert find_inputs(name).versions != before  # also of the same size and date
