/** Textures of a scene in the form of a PlayCanvas resource, rewritten in place while tiles become finer. */

import {
  BoundingBox,
  type GraphicsDevice,
  GSplatFormat,
  GSplatResourceBase,
  PIXELFORMAT_RGBA32U,
  type Texture,
  Vec3,
  type WebglGraphicsDevice,
} from "playcanvas";

import type { PackedTile } from "../../decoder/types.js";
import type { Front } from "../../stream/front.js";
import { READ_GLSL, streamNames } from "./read_glsl.js";

/** Words of geometry of a Gaussian, and of a texel. */
const GEOMETRY = 8;
const TEXEL = 4;
/** Bits of the last word of the geometry above which the opacity is; a slot that draws nothing has none. */
const OPACITY_BITS = 18;

/** A texture and its words, which PlayCanvas keeps to restore it when a device was lost. */
interface Plane {
  texture: Texture;
  words: Uint32Array;
}

/**
 * What a component of type gsplat draws: `entity.addComponent("gsplat", { resource })`. `put` tiles, then `flush`; where
 * that returns true, let components copy it when it is sorted, after the event "frame:ready" of `app.systems.gsplat` has
 * said so: `component.workBufferUpdate = WORKBUFFER_UPDATE_ONCE`.
 *
 * A Gaussian has its place from the first layer to the last. Places that draw nothing yet are sorted with the others.
 */
export class ScarSplats extends GSplatResourceBase {
  readonly #front: Front;
  readonly #planes: Plane[];
  /** (tiles, 3): middles of the tiles, where places lie that draw nothing. */
  readonly #middles: Float64Array;
  /** (tiles, 6): least and greatest corner of what each tile has. */
  readonly #bounds: Float64Array;
  /** First row and the row behind the last one that are to be uploaded. */
  #dirty: [number, number][] = [];
  #fresh = true;

  /** Throws RangeError where textures of this device cannot hold the scene, or cannot be written. */
  constructor(device: GraphicsDevice, front: Front) {
    const { total, header } = front;
    const side = Math.ceil(Math.sqrt(total));
    if (device.isWebGPU) throw new RangeError("scenes of this kind are drawn by WebGL2: make the device with deviceTypes: [\"webgl2\"]");
    if (side > device.maxTextureSize) {
      throw new RangeError(`a scene of ${total} Gaussians needs textures of ${side}², this device has up to ${device.maxTextureSize}²`);
    }
    const middles = tileMiddles(front);
    const centres = spreadMiddles(front, middles);
    const data = { numSplats: total, shBands: header.sh_degree, getCenters: () => centres, calcAabb: () => undefined };
    super(device, data);
    this.#front = front;
    this.#middles = middles;
    this.#bounds = Float64Array.from({ length: 2 * middles.length }, (_, i) => middles[3 * Math.floor(i / 6) + (i % 3)]);
    this.#bound();
    const streams = streamNames(header.sh_degree).map((name) => ({ name, format: PIXELFORMAT_RGBA32U }));
    this._format = new GSplatFormat(device, streams, { readGLSL: READ_GLSL });
    this.streams.init(this._format, Math.max(total, 1));
    this.#planes = streams.map(({ name }) => {
      const texture = this.getTexture(name) as Texture;
      return { texture, words: texture.lock() as Uint32Array };
    });
  }

  override configureMaterialDefines(defines: Map<string, string>): void {
    defines.set("SH_BANDS", String(this.#front.header.sh_degree));
  }

  /** Takes a tile whose first Gaussian has place `base`. */
  put(base: number, { tile, count, shDegree, geometry, harmonics }: PackedTile): void {
    const [first, last, ...rest] = this.#planes;
    lay(geometry, GEOMETRY, 0, first.words, base, count);
    lay(geometry, GEOMETRY, TEXEL, last.words, base, count);
    rest.forEach(({ words }, t) => lay(harmonics, TEXEL * shDegree, TEXEL * t, words, base, count));
    this.#place(tile, base, count, geometry);
    this.#mark(base, count);
  }

  /** Takes a tile away: its places draw nothing. */
  clear(tile: number): void {
    const { base, finalCounts } = this.#front;
    const [from, to] = [base[tile], base[tile] + finalCounts[tile]];
    this.#planes[1].words.fill(0, TEXEL * from, TEXEL * to);
    this.#mark(from, to - from);
  }

  /** Whether something has come that is not drawn yet. */
  get waiting(): boolean {
    return this.#dirty.length > 0;
  }

  /** Uploads what was put and cleared, and has it sorted anew; true if there was any. */
  flush(): boolean {
    if (this.#dirty.length === 0) return false;
    if (this.#fresh) this.#planes.forEach(({ texture }) => texture.unlock());
    else for (const rows of joined(this.#dirty)) this.#planes.forEach((plane) => upload(this.device, plane, rows));
    this.#fresh = false;
    this.#dirty = [];
    this.#bound();
    this.centersVersion++;
    return true;
  }

  /** Centres for the sorter. */
  #place(tile: number, base: number, count: number, geometry: Uint32Array): void {
    const numbers = new Float32Array(geometry.buffer, geometry.byteOffset, geometry.length);
    const middle = this.#middles.subarray(3 * tile, 3 * tile + 3);
    const bounds = this.#bounds.subarray(6 * tile, 6 * tile + 6);
    bounds.set(middle);
    bounds.set(middle, 3);
    for (let i = 0; i < count; i++) {
      const shown = geometry[GEOMETRY * i + GEOMETRY - 1] >>> OPACITY_BITS > 0;
      for (let axis = 0; axis < 3; axis++) {
        const x = shown ? numbers[GEOMETRY * i + axis] : middle[axis];
        this.centers[3 * (base + i) + axis] = x;
        if (x < bounds[axis]) bounds[axis] = x;
        if (x > bounds[3 + axis]) bounds[3 + axis] = x;
      }
    }
  }

  #mark(from: number, count: number): void {
    const { width } = this.#planes[0].texture;
    if (count > 0) this.#dirty.push([Math.floor(from / width), Math.floor((from + count - 1) / width) + 1]);
  }

  /** The box of all; the sorter loses what lies outside. */
  #bound(): void {
    const low = new Vec3(Infinity, Infinity, Infinity);
    const high = new Vec3(-Infinity, -Infinity, -Infinity);
    for (let tile = 0; tile < this.#front.index.tiles; tile++) {
      if (this.#front.finalCounts[tile] === 0) continue;
      const [x, y, z, far, top, back] = this.#bounds.subarray(6 * tile, 6 * tile + 6);
      low.min(new Vec3(x, y, z));
      high.max(new Vec3(far, top, back));
    }
    if (low.x <= high.x) this.aabb.setMinMax(low, high);
    else this.aabb = new BoundingBox();
  }
}

function tileMiddles({ index: { tiles, boxes } }: Front): Float64Array {
  const middle = (i: number) => (boxes[6 * Math.floor(i / 3) + (i % 3)] + boxes[6 * Math.floor(i / 3) + 3 + (i % 3)]) / 2;
  return Float64Array.from({ length: 3 * tiles }, (_, i) => Math.fround(middle(i)));
}

/** (total, 3): each place in the middle of its tile. */
function spreadMiddles({ base, finalCounts, total }: Front, middles: Float64Array): Float32Array {
  const centres = new Float32Array(3 * total);
  base.forEach((from, tile) => {
    for (let i = 3 * from; i < 3 * (from + finalCounts[tile]); i++) centres[i] = middles[3 * tile + (i % 3)];
  });
  return centres;
}

/** Copies one texel of each Gaussian, from rows of `stride` words, to the texels from `base` on. */
function lay(from: Uint32Array, stride: number, offset: number, to: Uint32Array, base: number, count: number): void {
  for (let i = 0; i < count; i++) {
    const [read, write] = [stride * i + offset, TEXEL * (base + i)];
    for (let k = 0; k < TEXEL; k++) to[write + k] = from[read + k];
  }
}

/** Runs of rows without overlap. */
function joined(rows: [number, number][]): [number, number][] {
  const runs: [number, number][] = [];
  for (const [from, to] of rows.sort((a, b) => a[0] - b[0])) {
    const before = runs[runs.length - 1];
    if (before !== undefined && from <= before[1]) before[1] = Math.max(before[1], to);
    else runs.push([from, to]);
  }
  return runs;
}

/** Writes rows of a texture; PlayCanvas itself only writes whole ones. */
function upload(device: GraphicsDevice, { texture, words }: Plane, [from, to]: [number, number]): void {
  const webgl = device as WebglGraphicsDevice;
  const { gl } = webgl;
  webgl.setTexture(texture, 0);
  webgl.activeTexture(0);
  webgl.bindTexture(texture);
  webgl.setUnpackFlipY(false);
  webgl.setUnpackPremultiplyAlpha(false);
  webgl.setUnpackAlignment(4);
  const { width } = texture;
  const part = words.subarray(TEXEL * width * from, TEXEL * width * to);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from, width, to - from, gl.RGBA_INTEGER, gl.UNSIGNED_INT, part);
}
