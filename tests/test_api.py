"""The API: what `import scarfmt` offers does what the modules behind it do, and costs nothing until it is used."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import scarfmt
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import make_request
from scarfmt.coding.writer import write_scene
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, Truncated
from scarfmt.formats.outputs import OUTPUTS, Output
from scarfmt.limits import Limits
from scarfmt.tools import inspection
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.conftest import REPOSITORY
from tests.samples.equality import same

DATA = write_scene(random_scene(3, anchors=300, tiles=4))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "scene.scar"
    file.write_bytes(DATA)
    return file


def test_importing_the_package_and_decoding_import_little(path: Path) -> None:
    """The package nothing at all; a decoder is to run where neither torch nor a compiler of Python is."""
    script = (
        "import sys; before = set(sys.modules); import scarfmt;"
        f"print(sorted(set(sys.modules) - before - {{'scarfmt', '__future__'}})); scarfmt.decode({str(path)!r}).scene;"
        "print([name for name in ('torch', 'numba', 'scipy', 'fsspec', 'PIL', 'click') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "[]"]


def test_every_name_can_be_had_and_no_other() -> None:
    assert set(scarfmt.__all__) <= set(dir(scarfmt))
    for name in scarfmt.__all__:
        assert getattr(scarfmt, name).__doc__ if name != "__version__" else scarfmt.__version__
    with pytest.raises(AttributeError, match="no attribute 'decoder'"):
        _ = scarfmt.decoder


def test_checkers_of_types_see_the_names_that_are_there() -> None:
    """Imports for type checkers alone are never run: a name that is missing or wrong there would go unseen."""
    text = (REPOSITORY / "scarfmt" / "__init__.py").read_text(encoding="utf-8")
    block = text.partition("if TYPE_CHECKING:\n")[2].partition('__version__ = "')[0]
    namespace: dict[str, object] = {}
    exec("if True:\n" + block, namespace)
    for name in set(scarfmt.__all__) - {"__version__"}:
        assert namespace[name] is getattr(scarfmt, name), name


def test_a_request_is_given_whole_or_by_its_fields() -> None:
    request = scarfmt.DecodeRequest(layers=2)
    assert make_request(request, {}) is request
    assert make_request(None, {"layers": 2}) == request
    with pytest.raises(TypeError, match="not both: threads"):
        make_request(request, {"threads": 2})
    with pytest.raises(TypeError, match="tile"):
        scarfmt.decode(DATA, tile=[0])  # type: ignore[call-arg]


def test_functions_take_paths_and_bytes_and_open_sources(path: Path) -> None:
    for origin in (path, str(path), DATA, bytearray(DATA), memoryview(DATA), BytesSource(DATA)):
        assert same(scarfmt.decode(origin, layers=2).arrays(), scarfmt.decode(DATA, layers=2).arrays())
        assert scarfmt.truncate(origin, 1) == truncate(BytesSource(DATA), 1)
        assert scarfmt.inspect(origin, metadata=True) == inspection.inspect(BytesSource(DATA), metadata=True)
        assert scarfmt.validate(origin) == validate(BytesSource(DATA))


def test_an_open_file_answers_what_the_functions_do(path: Path) -> None:
    request = scarfmt.DecodeRequest(layers=1, attributes=["positions"])
    with scarfmt.open(path) as file:
        assert same(file.decode().arrays(), scarfmt.decode(DATA).arrays())
        assert same(file.decode(request).arrays(), scarfmt.decode(DATA, request).arrays())
        assert [len(part) for part in file.tiles(layers=1)] == np.bincount(file.decode(layers=1).tiles).tolist()
        assert file.truncate(1) == scarfmt.truncate(DATA, 1)
        assert file.inspect() == scarfmt.inspect(DATA)
        assert file.validate(layers=1) == scarfmt.validate(DATA, layers=1)
        assert file.complete_layers == file.header.layers
        assert repr(file) == f"<ScarFile: {len(file.decode()):,} anchors, 3 of 3 layers>"
    with pytest.raises(ValueError, match="closed"):
        file.decode()


def test_the_boxes_of_tiles_hold_their_anchors() -> None:
    with scarfmt.open(DATA) as file:
        low, high = file.tile_boxes
        decoded = file.decode()
    assert decoded.positions is not None
    assert low.shape == high.shape == (file.header.tile_count, 3)
    assert (decoded.positions >= low[decoded.tiles]).all()
    assert (decoded.positions <= high[decoded.tiles]).all()


def test_a_file_cut_short_opens_and_says_what_has_arrived() -> None:
    whole = scarfmt.open(DATA)
    with scarfmt.open(DATA[: whole.header.layers[1].end_offset]) as file:
        assert file.complete_layers == whole.header.layers[:2]
        with pytest.raises(Truncated):
            file.decode()
        assert same(file.decode(allow_truncated=True).arrays(), whole.decode(layers=2).arrays())


def test_limits_of_an_open_file_are_those_of_its_requests() -> None:
    """Unless a request says otherwise: who raises a limit for one file raises it once."""
    with scarfmt.open(DATA, limits=Limits(work_per_byte=0, anchors=1 << 20)) as file:
        assert same(file.decode(limits=Limits()).arrays(), scarfmt.decode(DATA).arrays())
        assert same(file.decode(scarfmt.DecodeRequest()).arrays(), scarfmt.decode(DATA).arrays())
    with pytest.raises(LimitExceeded):
        scarfmt.open(DATA, limits=Limits(anchors=1))


def test_a_file_that_is_refused_is_closed(tmp_path: Path) -> None:
    """Else a program that looks through many files runs out of handles."""
    closed: list[bool] = []

    class Source(BytesSource):
        def close(self) -> None:
            closed.append(True)

    with pytest.raises(Malformed):
        scarfmt.open(Source(b"no scene at all" * 20))
    assert closed == [True]


def test_errors_are_of_the_kind_that_the_system_raises(tmp_path: Path, path: Path) -> None:
    """So code that knows nothing of this package catches them."""
    for call in (scarfmt.open, scarfmt.load, scarfmt.inspect):
        with pytest.raises(FileNotFoundError) as caught:
            call(tmp_path / "none.scar")
        assert isinstance(caught.value, scarfmt.ScarError)
    with pytest.raises(FileExistsError) as taken:
        scarfmt.convert(path, path)
    assert isinstance(taken.value, InvalidInput)


def test_a_handle_refines_layer_by_layer_and_reads_no_byte_twice(path: Path) -> None:
    with scarfmt.open(path) as file:
        scenes = list(file.layers())
        assert file.source.bytes_read <= len(DATA)
    expected = [scarfmt.decode_scene(DATA, layers=number) for number in range(1, len(scenes) + 1)]
    assert [len(scene) for scene in scenes] == [len(scene) for scene in expected]
    for scene, other in zip(scenes, expected, strict=True):
        assert all(map(np.array_equal, scene.arrays().values(), other.arrays().values()))
    with scarfmt.open(DATA[: inspection.inspect(BytesSource(DATA))["layers"][0]["end_offset"]]) as cut:
        assert len(list(cut.layers())) == 1


@pytest.mark.parametrize("known", OUTPUTS, ids=lambda known: known.id)
def test_scenes_are_saved_and_loaded_in_every_format(known: Output, tmp_path: Path) -> None:
    scene = scarfmt.load(DATA)
    target = tmp_path / f"a{known.suffix}"
    scarfmt.save(scene, target)
    found = scarfmt.load(target)
    assert isinstance(found, scarfmt.GaussianScene)
    assert len(found) == len(scene)


def test_saving_as_scar_encodes(path: Path, tmp_path: Path) -> None:
    options = scarfmt.EncodeOptions(effort=1, corrections=0, layers=1)
    scarfmt.save(scarfmt.load(path), tmp_path / "a.scar", options=options)
    assert scarfmt.validate(tmp_path / "a.scar").valid
    with pytest.raises(InvalidInput, match="output-format"):
        scarfmt.save(scarfmt.load(path), tmp_path / "a.obj")


def test_scenes_show_themselves_shortly_and_in_notebooks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scarfmt.load(path)
    assert isinstance(scene, scarfmt.GaussianScene)
    assert repr(scene) == f"<GaussianScene: {len(scene)} Gaussians, SH degree {scene.sh_degree}>"
    assert (scene._repr_png_() or b"")[:8] == b"\x89PNG\r\n\x1a\n"
    monkeypatch.setitem(sys.modules, "scarfmt.render.notebook", None)
    assert scene._repr_png_() is None
