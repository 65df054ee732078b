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
    """The sources of the inputs of a network.

    Attributes:
        seen: which cell means and attributes.
        grid: whose features are the last inputs, or None.
        blind: whether all but class and grid is ignored, though the file has a decoded context: such inputs are 0 in
            rows, and their weights have to be.
    """

    seen: ContextOptions
    grid: HashGrid | None
    blind: bool = False

    @classmethod
    def of(
        cls, scene: QuantisedScene, seen: ContextOptions, most: int | None = None, seed: int = 0
    ) -> tuple[NetworkView, IndexRows]:
        """A view with a grid round the scene, and about `most` rows of all tiles."""
        rows, positions = _placed_rows(scene, seen, range(len(scene.tiles)), most, seed)
        view = cls(seen, wave_grid(fit_box(positions)[0]))
        return view, view.with_features(scene.model, rows, positions)

    def rows(self, scene: QuantisedScene, tiles: Sequence[int], most: int | None = None, seed: int = 0) -> IndexRows:
        """All rows of some tiles, or about `most` of them; their `places` count in `tiles`."""
        return self.with_features(scene.model, *_placed_rows(scene, self.seen, tiles, most, seed))

    def placed_rows(self, scene: QuantisedScene, most: int | None = None, seed: int = 0) -> tuple[IndexRows, I64]:
        """About `most` rows of all tiles, and the (n, 3) int64 lattice positions of their anchors."""
        rows, positions = _placed_rows(scene, self.seen, range(len(scene.tiles)), most, seed)
        return self.with_features(scene.model, rows, positions), positions

    def with_features(self, model: SceneModel, rows: IndexRows, positions: I64) -> IndexRows:
        """Rows with the features of the grid at (n, 3) lattice `positions`, and without what is not looked at."""
        if self.blind:
            rows.inputs[:, self.columns(model).classes :] = 0
        if self.grid is None:
            return rows
        features = best_engine().grid_features(self.grid, positions)
        return replace(rows, inputs=np.concatenate([rows.inputs, features], axis=1))

    def columns(self, model: SceneModel) -> Inputs:
        """Meaning of the columns of the inputs."""
        seen, attributes = self.seen, sum(model.channels[index].components for index in model.attributes)
        depths = len(seen.occupancies)
        width = 0 if self.grid is None else self.grid.width
        return Inputs(
            model.layers[-1].class_count, seen.own, attributes, depths, seen.latents, seen.latent_shift, width
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
