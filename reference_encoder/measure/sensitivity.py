"""How much an error in each attribute of each Gaussian shows in pictures (encoder only, informative).

For small errors the mean squared error of a picture set is close to a sum over Gaussians and attributes of
sensitivity * error^2. Two rendered sums per Gaussian give all of it: `weight_sq`, the squared blending
weights, for colour; `contrast_sq`, squared weight times contrast with what lies behind, for everything that
moves or reshapes the Gaussian. docs/decisions/0003-visibility.md has the measured fit of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.measure.attributes import Attributes
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import ASPECT_CAP, BLUR_PX2, GAUSSIAN_ABSENCE, OPACITY_SHARE, SCALE_SHARE, SURVEY_VIEWS
from scarfmt.arrays import F64
from scarfmt.container.schema import Stream
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.rasterise import contributions
from scarfmt.scene.gaussians import GaussianScene

SH_C0 = 0.28209479177387814


@dataclass(frozen=True)
class Sensitivity:
    """Mean squared picture error (peak 1) per squared unit of error in each attribute.

    Attributes:
        channels: stream -> (N, components) float64.
        colour: (N,) float64, per squared unit of any SH coefficient.
        absence: (N,) float64, estimated error of leaving the Gaussian out.
    """

    channels: dict[Stream, F64]
    colour: F64
    absence: F64

    def take(self, index: NDArray[np.integer]) -> Sensitivity:
        """The Gaussians at `index`, in that order."""
        channels = {stream: values[index] for stream, values in self.channels.items()}
        return Sensitivity(channels, self.colour[index], self.absence[index])


def survey(scene: GaussianScene, options: EncodeOptions) -> list[Camera]:
    """The views to judge by: those given, thinned and without a test split, or rings round the core."""
    thorough = EFFORTS[options.effort].thorough_views
    if options.cameras is None:
        return survey_cameras(scene, options.frame, thorough)
    cameras = [camera for camera in options.cameras if camera.split != "test"] or list(options.cameras)
    most = SURVEY_VIEWS * (2 if thorough else 1)
    return cameras[:: max(1, -(-len(cameras) // most))]


def survey_cameras(scene: GaussianScene, frame: str, thorough: bool) -> list[Camera]:
    """Views that stand for wherever a user may look from: four rings round the core at several heights and
    distances, or inside the given arc."""
    rings = [(0.0625, 20.0, 1.0, 5), (0.02, 38.0, 1.25, 3), (0.09, 5.0, 0.8, 4), (0.045, 15.0, 1.9, 2)]
    cameras: list[Camera] = []
    for turn, elevation, radius, count in rings:
        cameras += ring(scene, frame, count * 2 if thorough else count, turn, elevation, radius)
    return cameras


def ring(
    scene: GaussianScene, frame: str, views: int, turn: float, elevation_deg: float, radius_factor: float
) -> list[Camera]:
    """Cameras round the core, the first `turn` turns from where azimuths start; on an arc, shifted by as much of it."""
    parts = frame.split(":")
    up, middle, span = parts[0], 0.0, 360.0
    if len(parts) == 3:
        middle, span = float(parts[1]), float(parts[2])
    if span >= 360:
        arc, offset = up, turn * 360
    else:
        arc, offset = f"{up}:{middle + (turn - 0.05) * span}:{span * 1.1}", 0.0
    return orbit_cameras(
        scene, views, up=arc, elevation_deg=elevation_deg, azimuth_offset_deg=offset, radius_factor=radius_factor
    )


def measure(scene: GaussianScene, attributes: Attributes, cameras: Sequence[Camera]) -> Sensitivity:
    """Sensitivities of all N Gaussians as seen from `cameras`."""
    seen = contributions(scene, cameras)
    samples = sum(camera.width * camera.height * 3 for camera in cameras)
    shape, colour = seen.contrast_sq / samples, seen.weight_sq * (SH_C0**2 / samples)
    variance = np.exp(2 * np.clip(attributes.log_scales, -40, 40))
    blurred = variance + _blur_variance(scene, cameras)[:, None]
    visible = variance / blurred

    def aspect(a: int, b: int) -> F64:
        ratio = (blurred[:, a] - blurred[:, b]) ** 2 / (blurred[:, a] * blurred[:, b])
        return np.minimum(ratio, ASPECT_CAP)

    swing, twist = shape * aspect(0, 2), shape * aspect(0, 1)
    channels = {
        Stream.POSITION_RESIDUAL: np.repeat((shape / blurred[:, 1])[:, None], 3, axis=1),
        Stream.SCALE: shape[:, None] * visible * SCALE_SHARE,
        Stream.ROTATION: np.stack([swing, swing, twist], axis=1),
        Stream.OPACITY: (shape * OPACITY_SHARE)[:, None],
        # dc = (Y - G + O, Y + G, Y - G - O): squared column norms 3, 3, 2.
        Stream.COLOUR: colour[:, None] * np.array([3.0, 3.0, 2.0]),
    }
    return Sensitivity(channels, colour, shape * GAUSSIAN_ABSENCE)


def _blur_variance(scene: GaussianScene, cameras: Sequence[Camera]) -> F64:
    """(N,) float64 world variance of the renderer's blur at each Gaussian's median distance."""
    total = np.zeros(len(scene))
    for camera in cameras:
        total += np.log(np.maximum(np.linalg.norm(scene.positions - camera.centre, axis=1), 1e-12) / camera.fx)
    return np.asarray(BLUR_PX2 * np.exp(2 * total / max(len(cameras), 1)))
