"""The file put together from ranges is, byte for byte, the one that the writer makes of everything at once."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from reference_encoder.scale import merge
from reference_encoder.scale.merge import write_file
from reference_encoder.scale.steps import LayerSegment, Segment
from reference_encoder.scale.tasks import keep_segment
from reference_encoder.scale.work import Work
from tests.reference_encoder.scale.chain import Chain, encoded
from tests.reference_encoder.scale.test_coded import SIZE, written


def put_together(chain: Chain, segments: list[Segment], folder: Path) -> bytes:
    work, target = Work(str(folder)), io.BytesIO()
    rows = [keep_segment(work, number, segment) for number, segment in enumerate(segments)]
    size = write_file(work, chain.fit.fields, chain.models, rows, target)
    assert size == len(target.getvalue())
    return target.getvalue()


@pytest.mark.parametrize("piece", [1 << 22, 1000])
def test_ranges_make_the_file_of_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: int) -> None:
    """However few bytes are copied at once."""
    monkeypatch.setattr(merge, "PIECE_BYTES", piece)
    chain = encoded(SIZE)
    assert put_together(chain, list(chain.segments), tmp_path) == written(chain)


def test_ranges_of_which_nothing_is_sent_leave_no_trace(tmp_path: Path) -> None:
    """All of their Gaussians may be invisible."""
    chain = encoded(SIZE)
    one = chain.segments[0].layers[0]
    streams = (0,) * len(one.stream_bytes)
    layer = LayerSegment(b"", one.tiles[:0], one.lengths[:0], one.counts[:0], one.checksums[:0], streams)
    nothing = Segment((), [layer] * len(chain.segments[0].layers))
    first, *others = chain.segments
    assert put_together(chain, [nothing, first, nothing, *others], tmp_path) == written(chain)
