"""Everything the index network sees of a scene, hash grid and all: rows to train on or to choose by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.networks.dataset import ContextOptions, IndexRows, index_rows, lattice_positions
from reference_encoder.networks.grid import fit_box, wave_grid
from scarfmt.arrays import I64
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import local_bits, tile_frame
from scarfmt.engines import best_engine
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import SceneModel


@dataclass(frozen=True)
class NetworkView:
    """What the inputs of a network are made of.

    Attributes:
        seen: which cell means and attributes.
        grid: whose features are the last inputs.
    """

    seen: ContextOptions
    grid: HashGrid

    @classmethod
    def of(
        cls, scene: QuantisedScene, seen: ContextOptions, most: int | None = None, seed: int = 0
    ) -> tuple[NetworkView, IndexRows]:
        """A view with a grid round the scene, and about `most` rows of all tiles."""
        rows, positions = _placed_rows(scene, seen, range(len(scene.tiles)), most, seed)
        view = cls(seen, wave_grid(fit_box(positions)[0]))
        return view, view._with_features(rows, positions)

    def rows(self, scene: QuantisedScene, tiles: Sequence[int], most: int | None = None, seed: int = 0) -> IndexRows:
        """All rows of some tiles, or about `most` of them; their `places` count in `tiles`."""
        return self._with_features(*_placed_rows(scene, self.seen, tiles, most, seed))

    def _with_features(self, rows: IndexRows, positions: I64) -> IndexRows:
        features = best_engine().grid_features(self.grid, positions)
        return replace(rows, inputs=np.concatenate([rows.inputs, features], axis=1))

    def columns(self, model: SceneModel) -> Inputs:
        """Meaning of the columns of the inputs."""
        seen, attributes = self.seen, sum(model.channels[index].components for index in model.attributes)
        depths = len(seen.occupancies)
        return Inputs(
            model.layers[-1].class_count, seen.own, attributes, depths, seen.latents, seen.latent_shift, self.grid.width
        )


def _placed_rows(
    scene: QuantisedScene, seen: ContextOptions, tiles: Sequence[int], most: int | None, seed: int
) -> tuple[IndexRows, I64]:
    """Rows without features of a grid, and the (n, 3) lattice positions of their anchors."""
    assert scene.codebooks is not None
    contents = [scene.contents[tile] for tile in tiles]
    bits = [local_bits(scene.fields, scene.tiles[tile]) for tile in tiles]
    rows = index_rows(scene.model, contents, bits, scene.codebooks, seen, most, seed)
    return rows, lattice_positions(rows, contents, [tile_frame(scene.fields, scene.tiles[tile]) for tile in tiles])
