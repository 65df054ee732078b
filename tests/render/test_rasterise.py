"""The tile rasteriser draws what the literal float64 renderer draws, and measures what it says it measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scarfmt.container.registries import RenderModel
from scarfmt.render.camera import Camera
from scarfmt.render.native.binding import load
from scarfmt.render.rasterise import contributions_by_view, render, render_with
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from tests.render.reference_rasteriser import pixel_blends, render_reference, visible_ellipses
from tests.samples.codec_samples import refuses
from tests.samples.equality import same

from .scenes import degenerate_scene, random_scene, small_camera

TOLERANCE = 2e-5


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_agrees_with_reference_at_every_sh_degree(degree: int) -> None:
    assert _assert_agrees(random_scene(degree, degree=degree), (0.2, 0.5, 1.0)).std() > 0.1


def _assert_agrees(scene: GaussianScene, background: tuple[float, ...] = (0, 0, 0), **more: np.ndarray) -> np.ndarray:
    expected = render_reference(scene, small_camera(), background, **more)
    image = render(scene, small_camera(), background, **more)
    np.testing.assert_allclose(image, expected, rtol=0, atol=TOLERANCE)
    return image


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_agrees_with_reference_on_degenerate_gaussians(seed: int) -> None:
    """Zero and tiny quaternions, scales of 1e-20, logits of +-400, coincident and far Gaussians."""
    assert np.isfinite(_assert_agrees(degenerate_scene(seed))).all()


def test_agrees_with_reference_where_pixels_close_early() -> None:
    """A stack of opaque Gaussians reaches the 1e-4 stop, which must not blend the one that would pass it."""
    scene, camera = random_scene(7, 120, degree=0), small_camera()
    scene = replace(scene, opacity_logits=np.full(120, 9, np.float32), log_scales=scene.log_scales + np.float32(1))
    left_over = [pixel_blends(visible_ellipses(scene, camera), x, 17)[1] for x in range(camera.width)]
    assert min(left_over) < 2e-4
    _assert_agrees(scene, (1, 1, 1))


def test_sh_degree_limits_the_bands_used() -> None:
    scene, camera = random_scene(3), small_camera()
    assert np.array_equal(render(scene, camera, sh_degree=1), render(scene.with_sh_degree(1), camera))
    assert not np.array_equal(render(scene, camera, sh_degree=1), render(scene, camera))


def test_given_colours_replace_spherical_harmonics() -> None:
    scene, camera = random_scene(4), small_camera()
    colours = np.random.default_rng(0).uniform(0, 1, (len(scene), 3)).astype(np.float32)
    _assert_agrees(scene, colours=colours)
    refuses("input-shape", lambda: render(scene, camera, colours=colours[1:]), "colours")


def test_two_pictures_at_once_are_those_drawn_one_by_one() -> None:
    scene, camera = random_scene(7, 60), small_camera()
    others = np.random.default_rng(8).random((60, 3))
    own, other = render_with(scene, camera, others)
    assert np.array_equal(own, render(scene, camera))
    assert np.array_equal(other, render(scene, camera, colours=others))
    assert not np.array_equal(own, other)


def test_nothing_visible_shows_the_background() -> None:
    scene, camera = random_scene(5), small_camera()
    behind = replace(scene, positions=scene.positions - [0, 0, 100])
    for hidden in (behind, scene.take(np.arange(0))):
        assert (render(hidden, camera, (0.25, 0.5, 0.75)) == np.float32([0.25, 0.5, 0.75])).all()
        assert [len(seen.index) for seen in contributions_by_view(hidden, [camera])] == [0]


def test_non_finite_gaussians_are_not_drawn() -> None:
    scene, camera = random_scene(6), small_camera()
    broken = replace(scene, positions=scene.positions.copy(), log_scales=scene.log_scales.copy())
    broken.positions[0] = np.nan
    broken.log_scales[1] = np.inf
    broken.positions[2] = np.inf
    assert np.array_equal(render(broken, camera), render(scene.take(np.arange(3, len(scene))), camera))


def test_gaussians_nearer_than_the_near_plane_are_not_drawn() -> None:
    scene, camera = random_scene(13), small_camera()
    depths = scene.positions @ camera.world_to_camera[2, :3] + camera.world_to_camera[2, 3]
    beyond = scene.take(depths > 2.5)
    assert np.array_equal(render(scene, replace(camera, near=2.5)), render(beyond, camera))
    assert not np.array_equal(render(scene, camera), render(beyond, camera))


def test_ties_in_depth_are_drawn_in_index_order() -> None:
    camera = small_camera()
    one = random_scene(8, 1, degree=0)
    flat = replace(one, positions=np.array([[0.0, 0.0, 3.0]]), opacity_logits=np.float32([0.0]))
    pair = flat.take(np.array([0, 0]))
    red, green = np.float32([1, 0, 0]), np.float32([0, 1, 0])
    image = render(pair, camera, colours=np.stack([red, green]))
    assert image[..., 0].sum() > image[..., 1].sum() > 0


def test_same_bits_with_one_and_two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Contributions never depend on the number of threads."""
    scene, cameras = random_scene(9, 3000), [small_camera(150, 100), small_camera(90, 120)]
    results = []
    for count in ("1", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", count)
        results.append(list(contributions_by_view(scene, cameras)))
    assert same(*results)


def test_same_bits_with_and_without_wide_vectors() -> None:
    """The two ways that tiles are compiled do the same arithmetic."""
    scene, camera = random_scene(9, 3000), small_camera(150, 100)
    wide = render(scene, camera)
    [measured] = contributions_by_view(scene, [camera])
    load().scar_render_plainly(1)
    try:
        assert np.array_equal(render(scene, camera), wide)
        [plain] = contributions_by_view(scene, [camera])
    finally:
        load().scar_render_plainly(0)
    assert same(measured, plain)


def _literal_weights(scene: GaussianScene, camera: Camera) -> np.ndarray:
    """(N, pixels) blending weights from the reference."""
    weights = np.zeros((len(scene), camera.width * camera.height))
    ellipses = visible_ellipses(scene, camera)
    for pixel in range(weights.shape[1]):
        for ellipse, alpha, before in pixel_blends(ellipses, pixel % camera.width, pixel // camera.width)[0]:
            weights[ellipse.index, pixel] = alpha * before
    return weights


def _closing_scene() -> GaussianScene:
    """Small splats, some of whose pixels opaque ones in front have closed."""
    scene = random_scene(13, 400, degree=0)
    return replace(scene, opacity_logits=np.full(400, 9, np.float32), log_scales=scene.log_scales - np.float32(0.5))


@pytest.mark.parametrize("build", [lambda: random_scene(10, 60), lambda: degenerate_scene(11), _closing_scene])
def test_contributions_are_sums_over_blending_weights(build) -> None:
    scene = build()
    cameras = [small_camera(), small_camera(33, 20)]
    for camera, measured in zip(cameras, contributions_by_view(scene, cameras), strict=True):
        weights = _literal_weights(scene, camera)
        assert np.array_equal(measured.index, np.flatnonzero(weights.any(axis=1)))
        weights = weights[measured.index]
        np.testing.assert_allclose(measured.weight_sq, (weights**2).sum(axis=1), rtol=1e-3, atol=1e-8)
        np.testing.assert_allclose(measured.weight_max, weights.max(axis=1), rtol=1e-3, atol=1e-5)
        assert 0 < len(measured.index) < len(scene)


def test_contrast_is_what_removing_the_gaussian_changes() -> None:
    """w (c - c_behind) is the difference to the picture without the Gaussian, unless a pixel closes early."""
    scene, camera = random_scene(12, 25), small_camera()
    scene = replace(scene, opacity_logits=scene.opacity_logits / np.float32(4) - np.float32(1))
    whole, measured = render_reference(scene, camera), np.zeros(len(scene))
    [seen] = contributions_by_view(scene, [camera])
    measured[seen.index] = seen.contrast_sq
    for i in range(len(scene)):
        without = render_reference(scene.take(np.delete(np.arange(len(scene)), i)), camera)
        assert measured[i] == pytest.approx(((whole - without) ** 2).sum(), rel=1e-4, abs=1e-9)
    assert (measured > 0).sum() > 5


def test_antialiased_gaussians_are_as_much_fainter_as_they_are_widened() -> None:
    """One Gaussian of 0.2 pixels in the middle of a pixel: Mip-Splatting's factor is sqrt(det / det dilated)."""
    pixels, alpha = 0.2, 0.8
    camera = Camera(9, 9, 9.0, 9.0, 4.5, 4.5, np.eye(4))
    scene = GaussianScene(
        np.array([[0.0, 0.0, 1.0]]),
        np.full((1, 3), np.log(pixels / 9), np.float32),
        np.array([[1, 0, 0, 0]], np.float32),
        np.array([np.log(alpha / (1 - alpha))], np.float32),
        np.full((1, 1, 3), 0.5 / 0.28209479177387814, np.float32),
    )
    marked = replace(scene, description=Description(RenderModel.ANTIALIASED))
    classic, fainter = (float(render(each, camera)[4, 4, 0]) for each in (scene, marked))
    assert classic == pytest.approx(alpha, abs=1e-6)
    assert fainter == pytest.approx(alpha * pixels**2 / (pixels**2 + camera.dilation), abs=1e-6)
