/** Textures of a scene in the form of a PlayCanvas resource, rewritten in place while tiles become finer. */

import {
  type GraphicsDevice,
  GSplatFormat,
  GSplatResourceBase,
  PIXELFORMAT_RGBA32U,
  type Texture,
  Vec3,
  type WebglGraphicsDevice,
} from "playcanvas";

import type { PackedTile } from "../../decoder/types.js";
import { Places, type Span } from "../../pack/places.js";
import type { Front } from "../../format/directory.js";
import { READ_GLSL, streamNames } from "./read_glsl.js";
import { READ_WGSL } from "./read_wgsl.js";

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
 * A tile keeps its places while it is refined, and takes more. Places that draw nothing are sorted with the others.
 */
export class ScarSplats extends GSplatResourceBase {
  readonly #front: Front;
  readonly #planes: Plane[];
  readonly #places: Places;
  /** Where places lie that draw nothing. */
  readonly #rest: [number, number, number];
  /** Least and greatest corner (6) of what each tile has. */
  readonly #bounds = new Map<number, Float64Array>();
  /** First row and the row behind the last one that are to be uploaded. */
  #dirty: [number, number][] = [];
  #fresh = true;

  /**
   * Throws RangeError where textures of this device cannot hold so many Gaussians, or cannot be written.
   * @param total places for Gaussians, a multiple of 256: `placesFor` of the front and the budgets of the stream
   */
  constructor(device: GraphicsDevice, front: Front, total: number) {
    const { header } = front;
    const side = Math.ceil(Math.sqrt(total));
    if (side > device.maxTextureSize) {
      throw new RangeError(`a scene of ${total} Gaussians needs textures of ${side}², this device has up to ${device.maxTextureSize}²`);
    }
    const rest = middle(front);
    const centres = Float32Array.from({ length: 3 * total }, (_, i) => rest[i % 3]);
    const data = { numSplats: total, shBands: header.sh_degree, getCenters: () => centres, calcAabb: () => undefined };
    super(device, data);
    this.#front = front;
    this.#places = new Places(total);
    this.#rest = rest;
    this.#bound();
    const streams = streamNames(header.sh_degree).map((name) => ({ name, format: PIXELFORMAT_RGBA32U }));
    this._format = new GSplatFormat(device, streams, { readGLSL: READ_GLSL, readWGSL: READ_WGSL });
    this.streams.init(this._format, total);
    this.#planes = streams.map(({ name }) => {
      const texture = this.getTexture(name) as Texture;
      return { texture, words: texture.lock() as Uint32Array };
    });
  }

  override configureMaterialDefines(defines: Map<string, string>): void {
    defines.set("SH_BANDS", String(this.#front.header.sh_degree));
  }

  /** Takes a tile. Throws RangeError where it has no room: its stream has larger budgets. */
  put({ tile, count, shDegree, geometry, harmonics }: PackedTile): void {
    const [first, last, ...rest] = this.#planes;
    const bounds = new Float64Array([...this.#rest, ...this.#rest]);
    let from = 0;
    for (const span of this.#places.take(tile, count)) {
      lay({ words: geometry, stride: GEOMETRY, offset: 0, from }, first.words, span);
      lay({ words: geometry, stride: GEOMETRY, offset: TEXEL, from }, last.words, span);
      rest.forEach(({ words }, t) => {
        lay({ words: harmonics, stride: TEXEL * shDegree, offset: TEXEL * t, from }, words, span);
      });
      this.#place(geometry.subarray(GEOMETRY * from, GEOMETRY * (from + span.count)), span.first, bounds);
      this.#mark(span);
      from += span.count;
    }
    this.#bounds.set(tile, bounds);
  }

  /** Takes a tile away: its places draw nothing. */
  clear(tile: number): void {
    this.#bounds.delete(tile);
    for (const span of this.#places.give(tile)) {
      const end = span.first + span.count;
      this.#planes[1].words.fill(0, TEXEL * span.first, TEXEL * end);
      for (let i = 3 * span.first; i < 3 * end; i++) this.centers[i] = this.#rest[i % 3];
      this.#mark(span);
    }
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

  /** Centres for the sorter, from place `first` on; `bounds` grow to hold them. */
  #place(geometry: Uint32Array, first: number, bounds: Float64Array): void {
    const numbers = new Float32Array(geometry.buffer, geometry.byteOffset, geometry.length);
    for (let i = 0; i < geometry.length / GEOMETRY; i++) {
      const shown = geometry[GEOMETRY * i + GEOMETRY - 1] >>> OPACITY_BITS > 0;
      for (let axis = 0; axis < 3; axis++) {
        const x = shown ? numbers[GEOMETRY * i + axis] : this.#rest[axis];
        this.centers[3 * (first + i) + axis] = x;
        if (x < bounds[axis]) bounds[axis] = x;
        if (x > bounds[3 + axis]) bounds[3 + axis] = x;
      }
    }
  }

  #mark({ first, count }: Span): void {
    const { width } = this.#planes[0].texture;
    if (count > 0) this.#dirty.push([Math.floor(first / width), Math.floor((first + count - 1) / width) + 1]);
  }

  /** The box of all; the sorter loses what lies outside. */
  #bound(): void {
    const low = new Vec3(...this.#rest);
    const high = new Vec3(...this.#rest);
    for (const [x, y, z, far, top, back] of this.#bounds.values()) {
      low.min(new Vec3(x, y, z));
      high.max(new Vec3(far, top, back));
    }
    this.aabb.setMinMax(low, high);
  }
}

/** The middle of the tiles' middles. */
function middle({ index: { tiles, boxes } }: Front): [number, number, number] {
  const along = (axis: number) => {
    let [low, high] = [Infinity, -Infinity];
    for (let tile = 0; tile < tiles; tile++) {
      const x = (boxes[6 * tile + axis] + boxes[6 * tile + 3 + axis]) / 2;
      low = Math.min(low, x);
      high = Math.max(high, x);
    }
    return tiles === 0 ? 0 : Math.fround((low + high) / 2);
  };
  return [along(0), along(1), along(2)];
}

/** Words of Gaussians from number `from` on, of which one texel each is copied. */
interface Words {
  words: Uint32Array;
  /** Words of a Gaussian, and where in them the texel is. */
  stride: number;
  offset: number;
  from: number;
}

function lay({ words, stride, offset, from }: Words, to: Uint32Array, { first, count }: Span): void {
  for (let i = 0; i < count; i++) {
    const [read, write] = [stride * (from + i) + offset, TEXEL * (first + i)];
    for (let k = 0; k < TEXEL; k++) to[write + k] = words[read + k];
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
  const { width } = texture;
  const part = words.subarray(TEXEL * width * from, TEXEL * width * to);
  if (device.isWebGPU) {
    const { queue } = (device as unknown as { wgpu: GPUDevice }).wgpu;
    const { gpuTexture } = (texture as unknown as { impl: { gpuTexture: GPUTexture } }).impl;
    const layout = { bytesPerRow: part.BYTES_PER_ELEMENT * TEXEL * width };
    queue.writeTexture({ texture: gpuTexture, origin: [0, from] }, part as Uint32Array<ArrayBuffer>, layout, [width, to - from]);
    return;
  }
  const webgl = device as WebglGraphicsDevice;
  const { gl } = webgl;
  webgl.setTexture(texture, 0);
  webgl.activeTexture(0);
  webgl.bindTexture(texture);
  webgl.setUnpackFlipY(false);
  webgl.setUnpackPremultiplyAlpha(false);
  webgl.setUnpackAlignment(4);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from, width, to - from, gl.RGBA_INTEGER, gl.UNSIGNED_INT, part);
}
