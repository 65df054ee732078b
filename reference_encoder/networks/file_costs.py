"""The bits of indices and latents in a written file, and whether readers accept the file (encoder side)."""

from __future__ import annotations

from typing import Any

from reference_encoder.decide.assemble import Quantised
from reference_encoder.networks.decode_time import Work, index_work, predictor_work
from scarfmt.blocks.predictors import pack_predictors
from scarfmt.blocks.tables import pack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.bytefields import compress
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import LimitExceeded
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, Limits
from scarfmt.tools.truncate import truncate


def latent_cost(quantised: Quantised, data: bytes, time_bits: float = 0.0) -> float:
    """The cost of the latents of a scene in its file `data`: bits, or with targets J = D + lambda * bits.

    Args:
        time_bits: what decoding their network is worth.
    """
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    latents = sum(layer.stream_bytes[Stream.LATENT] for layer in reader.header.layers)
    size = index_bytes(data) + latents + time_bits / 8
    return 8.0 * size if quantised.targets is None else quantised.targets.cost(quantised.scene, size)


def index_bytes(data: bytes) -> int:
    """The bytes of the indices of a file: sub-streams, static tables, index network and hash grid."""
    own = (BlockKind.ENTROPY_NETWORK, BlockKind.HASH_GRID)
    entries = SceneReader(BytesSource(data), limits=FORMAT_LIMITS).container.entries
    return coded_bytes(data, Stream.INDICES) + sum(entry.length for entry in entries if entry.kind in own)


def coded_bytes(data: bytes, stream: Stream) -> int:
    """The bytes of the sub-streams of one kind in a file, and of the static tables and predictors for this kind
    alone."""
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    total = sum(layer.stream_bytes[stream] for layer in reader.header.layers)
    models = reader.models()
    before: dict[TableKey, SymbolTable] = {}
    for tables in models.tables:
        sent = {key: t for key, t in tables.items() if key.stream == stream and before.get(key) is not t}
        total += len(compress(pack_tables(sent))) if sent else 0
        before = tables
    predictors = [predictor for key, predictor in sorted(models.predictors[-1].items()) if key[0] == stream]
    return total + (len(pack_predictors(predictors)) if predictors else 0)


def mechanisms(static: bytes, scene: QuantisedScene, data: bytes) -> dict[str, Any]:
    """The member of METADATA about the networks of `scene`: see `scarfmt.coding.decoder_model.MECHANISMS`.

    Args:
        static: the file of the same scene without networks.
        data: the file of `scene`.
    """

    def told(saved: int, work: Work) -> dict[str, int]:
        return {"saved": saved, "multiply_adds": work.multiply_adds, "anchors": work.anchors}

    out: dict[str, Any] = {}
    work = predictor_work(scene)
    if work:
        saved = {stream: coded_bytes(static, stream) - coded_bytes(data, stream) for stream in work}
        out["predictors"] = {stream.name.lower(): told(saved[stream], work[stream]) for stream in work}
    if scene.network is not None:
        # Codewords chosen again leave other rests.
        rests = coded_bytes(static, Stream.LATENT) - coded_bytes(data, Stream.LATENT)
        rests -= out.get("predictors", {}).get(Stream.LATENT.name.lower(), {}).get("saved", 0)
        out["index_network"] = told(index_bytes(static) - index_bytes(data) + rests, index_work(scene))
    return out


def within_limits(data: bytes, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether readers of these limits take a file, and all that truncation makes of it (SPEC R-13.2-2)."""
    try:
        for layer in range(1, SceneReader(BytesSource(data)).layers + 1):
            SceneReader(BytesSource(truncate(BytesSource(data), layer)), limits=limits).models()
    except LimitExceeded:
        return False
    return True
