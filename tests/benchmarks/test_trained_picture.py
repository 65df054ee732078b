"""A picture of every layer beside the photo."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.photos import drawn, held_out
from benchmarks.trained_picture import GAP, main, side_by_side
from fuzz.testing.scenes import random_scene
from scarfmt.api import decode_scene, inspect
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from tests.benchmarks.test_photos import capture


@pytest.mark.filterwarnings("ignore::scarfmt.errors.InputWarning")
def test_layers_come_in_order_and_the_photo_last(tmp_path: Path) -> None:
    """The part before the photo is the whole file as it is decoded; the picture is written as wide as asked."""
    data = write_scene(random_scene(3, Profile.ANCHOR))
    where = capture(tmp_path / "capture", data)
    photo = held_out(where, None)[0]
    picture = side_by_side(data, photo)
    count = int(inspect(data)["layer_count"])
    width = photo.camera.width
    assert picture.shape == (photo.camera.height, (count + 1) * width + count * GAP, 3)
    last = picture[:, (count - 1) * (width + GAP) :][:, :width]
    assert np.array_equal(last, np.rint(drawn(decode_scene(data), photo.camera) * 255).astype(np.uint8))
    (tmp_path / "scene.scar").write_bytes(data)
    main([str(tmp_path / "scene.scar"), str(where), str(tmp_path / "out.png"), "--width", "90"])
    assert Image.open(tmp_path / "out.png").width == 90
