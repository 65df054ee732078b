"""Videos: of each stretch of time the sharpest frame is a photo, as one sees it; what cannot be used is said."""

from __future__ import annotations

import importlib.util
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from reference_encoder.training import poses, video
from reference_encoder.training.capture import load_capture
from reference_encoder.training.photo_files import wrong_capture
from reference_encoder.training.video import is_video, moving, pick_frames, sharpest
from scarfmt.arrays import U8
from scarfmt.errors import InvalidInput, LossWarning
from scarfmt.render.images import read_pixels
from tests.samples.codec_samples import refuses

RATE = 8
FRAMES = 40
"""Five seconds."""


def picture(index: int, blurred: bool = False) -> U8:
    """(48, 64, 3): squares that wander to the right, a white one in the upper left corner."""
    squares = np.random.default_rng(0).integers(0, 200, (12, 64, 3), np.uint8).repeat(4, 0).repeat(4, 1)
    shown = squares[:, 2 * index : 2 * index + 64].copy()
    shown[:16, :16] = 255
    return np.asarray(Image.fromarray(shown).filter(ImageFilter.BoxBlur(3))) if blurred else shown


def write(path: Path, frames: Sequence[U8]) -> Path:
    cv2 = video.opencv()
    kind = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix == ".avi" else "mp4v"))
    out = cv2.VideoWriter(str(path), kind, RATE, frames[0].shape[1::-1])
    for frame in frames:
        out.write(np.ascontiguousarray(frame[..., ::-1]))
    out.release()
    return path


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "pycolmap" or find(name))
    if find("cv2") is None:
        pytest.skip("OpenCV is not installed")
    return write(tmp_path / "clip.mp4", [picture(index) for index in range(FRAMES)])


def pick(path: Path) -> list[Path]:
    return sorted(pick_frames(path, path.parent / "run", lambda _stage, _part: None).glob("*.jpg"))


def test_of_each_stretch_of_time_the_sharpest_frame_is_taken() -> None:
    """By the times that frames have, however irregular; a stretch without frames is left out."""
    blurred = {0, 2, 4, 5}
    seconds = [0.0, 0.9, 1.0, 1.1, 1.9, 2.0, 2.99, 7.0]
    frames = [(second, picture(index, index in blurred)) for index, second in enumerate(seconds)]
    assert [second for second, _ in sharpest(iter(frames), 1.0)] == [0.9, 1.1, 2.99, 7.0]


def test_frames_of_a_camera_that_stands_are_left_out() -> None:
    """Noise is no movement."""
    noise = np.random.default_rng(0).integers(-2, 3, (12, 48, 64, 3))
    shown = [picture(index // 3) for index in range(12)]
    noisy = [np.clip(one + more, 0, 255).astype(np.uint8) for one, more in zip(shown, noise, strict=True)]
    assert [second for second, _ in moving((float(index), one) for index, one in enumerate(noisy))] == [0, 3, 6, 9]


def test_frames_are_photos_named_by_time_and_picked_once(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the video nothing is written."""
    files = pick(clip)
    assert [file.name for file in files] == [f"{125 * index:08}.jpg" for index in range(FRAMES)]
    for index, file in enumerate(files):
        assert np.abs(read_pixels(file).astype(int) - picture(index)).mean() < 12
    monkeypatch.setattr(video, "_sharp_frames", None)
    assert pick(clip) == files
    assert {path.name for path in clip.parent.iterdir()} == {"clip.mp4", "run"}
    assert {path.name for path in (clip.parent / "run").iterdir()} == {"frames"}


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_frames_are_turned_as_the_video_says(clip: Path, degrees: int) -> None:
    data = bytearray(clip.read_bytes())
    matrix = data.index(b"tkhd") + 44
    c, s = {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    one = 1 << 16
    struct.pack_into(">9i", data, matrix, c * one, s * one, 0, -s * one, c * one, 0, 0, 0, 1 << 30)
    clip.write_bytes(data)
    expected = np.rot90(picture(0), -degrees // 90)
    assert np.abs(read_pixels(pick(clip)[0]).astype(int) - expected).mean() < 12


def test_what_cannot_be_used_is_refused(clip: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In the words of the error alone, and nothing is left."""
    whole = clip.read_bytes()
    for data in (b"", b"no video" * 99, whole[: len(whole) // 2]):
        clip.write_bytes(data)
        refuses("input-capture", lambda: pick(clip), "no frame that can be read")
    write(clip, [picture(index) for index in range(9)])
    refuses("input-capture", lambda: pick(clip), "has 9 frames that differ, and 20 are needed")
    assert [path.name for path in clip.parent.iterdir()] == ["clip.mp4"]
    assert capfd.readouterr().err == ""


def test_a_video_that_is_cut_short_is_used_with_a_warning(clip: Path) -> None:
    """Where the time is stated first, as in AVI."""
    path = write(clip.with_suffix(".avi"), [picture(index) for index in range(FRAMES)])
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    with pytest.warns(LossWarning, match="ends after 3 s of the 5 s it states"):
        assert FRAMES / 2 < len(pick(path)) < FRAMES * 0.7


def test_a_video_of_more_than_8_bits_is_used_with_a_warning(clip: Path, recwarn: pytest.WarningsRecorder) -> None:
    """It may be HDR, of which OpenCV cuts the lights and says nothing."""
    pick(clip)
    assert not recwarn.list
    cv2, path = video.opencv(), clip.parent / "deep" / "clip.mkv"
    path.parent.mkdir()
    depth = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    out = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), RATE, (64, 48), depth)
    for index in range(FRAMES):
        out.write(257 * picture(index)[..., 0].astype(np.uint16))
    out.release()
    with pytest.warns(LossWarning, match="has 16 bits a colour: if it is HDR"):
        assert len(pick(path)) == FRAMES


def test_poses_of_frames_are_looked_for_as_of_photos(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If that fails, frames stay for the next time."""

    def count(_action: str, folder: Path, path: Path, _report: object) -> None:
        raise wrong_capture(path, f"{len(list((folder / 'input').rglob('*.jpg')))} came")

    monkeypatch.setattr(poses, "_run", count)
    refuses("input-capture", lambda: load_capture(clip, workspace=clip.parent / "run"), "frames: 40 came")
    assert [path.name for path in (clip.parent / "run").iterdir()] == ["frames"]
    refuses("input-options", lambda: load_capture(clip), "give a workspace")


def test_a_video_is_a_file_with_such_a_name(tmp_path: Path) -> None:
    (tmp_path / "a.MOV").touch()
    (tmp_path / "a.txt").touch()
    (tmp_path / "b.mp4").mkdir()
    assert [path.name for path in tmp_path.iterdir() if is_video(path)] == ["a.MOV"]


@pytest.mark.parametrize(("missing", "extra"), [("cv2", "video"), ("pycolmap", "poses")])
def test_without_a_library_the_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str, extra: str
) -> None:
    (tmp_path / "a.mp4").touch()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == missing else True)
    with pytest.raises(InvalidInput) as caught:
        load_capture(tmp_path / "a.mp4", workspace=tmp_path / "run")
    assert caught.value.refusal == "input-dependency"
    assert f"pip install 'scarfmt[{extra}]'" in str(caught.value)
