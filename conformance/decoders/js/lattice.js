/** Where a tile and its cells lie on the position lattice (SPEC §6.2). */

/** @typedef {import("./tile.js").Tile} Tile */

/**
 * Coordinate `axis` of a Morton code.
 * @param {bigint} code
 * @param {number} bits an axis
 * @param {number} axis
 */
function coordinate(code, bits, axis) {
  let value = 0;
  for (let i = 0; i < bits; i++) value += Number((code >> BigInt(3 * i + axis)) & 1n) * 2 ** i;
  return value;
}

class TileLattice {
  /** @param {Tile} tile */
  constructor(tile) {
    this.tile = tile;
    this.step = 2 ** tile.shift;
    const side = 2 ** (tile.bits + tile.shift);
    /** Lattice coordinates of the corner. */
    this.corner = [0, 1, 2].map((axis) => coordinate(tile.prefix, tile.depth, axis) * side);
    this.cell = new Float64Array(3);
    this.middle = new Float64Array(3);
  }

  /**
   * @param {number} a anchor
   * @returns {Float64Array} (3) its cell within the tile; valid until the next call
   */
  cellOf(a) {
    const { cell, tile } = this;
    cell.fill(0);
    const low = tile.codes.low[a];
    const high = tile.codes.high[a];
    for (let i = 0, bit = 0, scale = 1; i < tile.bits; i++, scale *= 2) {
      for (let axis = 0; axis < 3; axis++, bit++) {
        const set = bit < 32 ? (low >>> bit) & 1 : (high >>> (bit - 32)) & 1;
        if (set === 1) cell[axis] += scale;
      }
    }
    return cell;
  }

  /**
   * The lattice point at the middle of the cell of an anchor, rounded down (§10.6).
   * @param {number} a
   * @returns {Float64Array} (3); valid until the next call
   */
  middleOf(a) {
    const cell = this.cellOf(a);
    const half = Math.floor(this.step / 2);
    for (let axis = 0; axis < 3; axis++) this.middle[axis] = this.corner[axis] + cell[axis] * this.step + half;
    return this.middle;
  }
}

/** @param {Tile} tile */
export const tileLattice = (tile) => new TileLattice(tile);
