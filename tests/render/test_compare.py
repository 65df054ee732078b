"""Comparisons measure the right pairs, and the whole chain reproduces the quality of a real training."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scarfmt.render.compare import compare, compare_with_photos
from scarfmt.render.images import read_image, to_bytes, write_png
from scarfmt.render.metrics import psnr, ssim
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import read_scene
from tests.render.capture import files
from tests.samples.codec_samples import refuses

from .scenes import random_scene, small_camera


def test_per_view_figures_means_and_worst() -> None:
    scene = random_scene(0)
    other = replace(scene, sh=scene.sh + np.float32(0.1))
    cameras = [small_camera(), small_camera(30, 20)]
    result = compare(scene, other, cameras)
    pictures = [(render(scene, camera), render(other, camera)) for camera in cameras]
    assert result.psnr_db == tuple(psnr(a, b) for a, b in pictures)
    assert result.ssim == tuple(ssim(a, b) for a, b in pictures)
    assert result.mean_psnr_db == pytest.approx(sum(result.psnr_db) / 2)
    assert result.worst_psnr_db == min(result.psnr_db) < result.mean_psnr_db
    assert result.worst_ssim == min(result.ssim) < result.mean_ssim


def test_a_scene_equals_itself_even_as_a_function() -> None:
    scene = random_scene(1)
    result = compare(scene, lambda camera: render(scene, camera), [small_camera()], ssim=False)
    assert result.psnr_db == (math.inf,)
    assert math.isnan(result.mean_ssim)


def test_no_cameras_are_refused() -> None:
    scene = random_scene(2)
    refuses("input-empty", lambda: compare(scene, scene, []))


def _photo_folder(folder: Path, scene: GaussianScene) -> None:
    camera = small_camera()
    (folder / "images").mkdir()
    write_png(folder / "images" / "good.png", render(scene, camera))
    write_png(folder / "images" / "black.png", np.zeros((camera.height, camera.width, 3)))
    named = [replace(camera, name=f"{name}.png", split=split) for name, split in (("good", "test"), ("black", "train"))]
    files.in_json(files.own(named), folder / "cameras.json")


def test_photos_of_the_chosen_split_are_compared(tmp_path: Path) -> None:
    scene = random_scene(3)
    _photo_folder(tmp_path, scene)
    result = compare_with_photos(scene, tmp_path)
    assert result.names == ("good.png",)
    exact = render(scene, small_camera())
    assert result.psnr_db[0] == pytest.approx(psnr(exact, to_bytes(exact) / 255), abs=1e-3)
    assert compare_with_photos(scene, tmp_path / "cameras.json", split="train", ssim=False).worst_psnr_db < 15
    assert len(compare_with_photos(scene, tmp_path, split="").names) == 2
    refuses("input-empty", lambda: compare_with_photos(scene, tmp_path, split="validation"))


@pytest.mark.scene
def test_real_scene_has_the_quality_its_training_reported(shared_data: Path) -> None:
    """28.18 dB and SSIM 0.891 over the 13 held-out photos: cameras, SH, blending and metrics are all right."""
    scene = read_scene(shared_data / "splats" / "plush-on-bed.ply")
    result = compare_with_photos(scene, shared_data / "photos" / "plush-on-bed")
    assert len(result.names) == 13
    assert result.mean_psnr_db == pytest.approx(28.18, abs=0.01)
    assert result.mean_ssim == pytest.approx(0.891, abs=0.001)
    photo = read_image(shared_data / "photos" / "plush-on-bed" / "images" / result.names[0])
    assert photo.shape == (567, 756, 3)
