"""What indices and latents take in a file that was written, and whether readers would take the file (encoder side)."""

from __future__ import annotations

from reference_encoder.decide.assemble import Quantised
from scarfmt.blocks.tables import pack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.container.bytefields import compress
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import LimitExceeded
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, Limits
from scarfmt.tools.truncate import truncate


def latent_cost(quantised: Quantised, data: bytes, time_bits: float = 0.0) -> float:
    """What a scene's latents cost in its file `data`: bits, or with targets J = D + lambda * bits.

    Args:
        time_bits: what decoding their network is worth.
    """
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    latents = sum(layer.stream_bytes[Stream.LATENT] for layer in reader.header.layers)
    size = index_bytes(data) + latents + time_bits / 8
    return 8.0 * size if quantised.targets is None else quantised.targets.cost(quantised.scene, size)


def index_bytes(data: bytes) -> int:
    """What the indices of a file take: sub-streams, static tables, index network and hash grid."""
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    own = (BlockKind.ENTROPY_NETWORK, BlockKind.HASH_GRID)
    total = sum(layer.stream_bytes[Stream.INDICES] for layer in reader.header.layers)
    total += sum(entry.length for entry in reader.container.entries if entry.kind in own)
    before: dict[TableKey, SymbolTable] = {}
    for tables in reader.models().tables:
        sent = {key: t for key, t in tables.items() if key.stream == Stream.INDICES and before.get(key) is not t}
        total += len(compress(pack_tables(sent))) if sent else 0
        before = tables
    return total


def within_limits(data: bytes, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether readers of these limits take a file, and all that truncation makes of it (SPEC R-13.2-2)."""
    try:
        for layer in range(1, SceneReader(BytesSource(data)).layers + 1):
            SceneReader(BytesSource(truncate(BytesSource(data), layer)), limits=limits).models()
    except LimitExceeded:
        return False
    return True
