/**
 * Textures of a scene that Spark draws from, rewritten in place, and what makes it draw as scenes were trained to look.
 *
 * Spark's own words keep 8 bits of scale and rotation and 5 to 8 of harmonics; ours keep what a layer refines (words.ts).
 * A tile that is refined is written over and takes more places at its end, so nothing moves, and no copy of the textures
 * is kept in memory.
 */

import { dyno, SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
import * as THREE from "three";

import type { PackedTile } from "../decoder/types.js";
import { Places, type Span } from "../pack/places.js";
import { UNPACK_GLSL } from "../pack/unpack_glsl.js";
import { GEOMETRY_TEXELS } from "../pack/words.js";

/** Texels in a row of a texture. */
const WIDTH = 4096;
const WIDTH_BITS = 12;
/** Uploads of a frame, bytes: more makes frames late while data arrives. */
export const UPLOAD_BYTES = 1 << 20;

/** Of the half width of a picture: beyond, the slope of the projection is that at the edge, as in INRIA's renderer. */
const FRUSTUM_MARGIN = 1.3;

/**
 * What makes Spark's picture that of INRIA's renderer: its blur of 0.3 pixels without loss of opacity, Gaussians drawn
 * to where they are fainter than 1/255, order by depth, numbers that are not rounded to 8 bits on the way, and nothing
 * left out because its centre lies beside the picture.
 */
const INRIA_LOOK = {
  preBlurAmount: 0.3,
  blurAmount: 0,
  minAlpha: 1 / 255,
  maxStdDev: Math.sqrt(2 * Math.log(255)),
  sortRadial: false,
  accumExtSplats: true,
  maxPixelRadius: 4096,
  clipXY: 1e9,
} as const;
/** What Spark goes back to where its shader is not the one that we know: far beside the picture, slopes explode. */
const CLIP_UNCLAMPED = 1.4;
const SLOPE = "vec2 J2 = -(J1 * viewCenter.xy) * invZ;";
const CLAMPED_SLOPE = `
        vec2 farthest = ${FRUSTUM_MARGIN} / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
        vec2 J2 = -J1 * clamp(viewCenter.xy * invZ, -farthest, farthest);`;

/** Of `header.render_model`: Gaussians were trained to be made fainter where they are widened (Mip-Splatting). */
const ANTIALIASED = 1;

/** Makes Spark draw as scenes of a `header.render_model` were trained: all meshes of a `SparkRenderer` are drawn alike. */
export function drawModel(spark: SparkRenderer, renderModel: number): void {
  const blur = INRIA_LOOK.preBlurAmount;
  // Spark's second blur takes opacity in return for area, its first does not.
  spark.preBlurAmount = renderModel === ANTIALIASED ? 0 : blur;
  spark.blurAmount = renderModel === ANTIALIASED ? blur : 0;
}

/** Spark, drawing what scenes were trained to look like; to be added to the scene that is rendered. */
export function makeSpark(renderer: THREE.WebGLRenderer): SparkRenderer {
  const spark = new SparkRenderer({ renderer, ...INRIA_LOOK });
  const { material } = spark;
  if (material.vertexShader.includes(SLOPE)) material.vertexShader = material.vertexShader.replace(SLOPE, CLAMPED_SLOPE);
  else spark.clipXY = CLIP_UNCLAMPED;
  return spark;
}

const READ_SPLAT = `
  const int SCAR_WIDTH_MASK = ${WIDTH - 1};

  uvec4 scarTexel(usampler2D words, int texel) {
    return texelFetch(words, ivec2(texel & SCAR_WIDTH_MASK, texel >> ${WIDTH_BITS}), 0);
  }

${UNPACK_GLSL}
  bool readScar(usampler2D words, int index, out Gsplat gsplat) {
    uvec4 last = scarTexel(words, 2 * index + 1);
    gsplat.flags = 0u;
    if (scarOpacity(last) == 0.0) return false;
    uvec4 first = scarTexel(words, 2 * index);
    gsplat.flags = GSPLAT_FLAG_ACTIVE;
    gsplat.index = index;
    gsplat.center = scarCentre(first);
    gsplat.scales = scarScales(first, last);
    gsplat.quaternion = scarQuaternion(last);
    gsplat.rgba = scarColour(last);
    return true;
  }
`;

const READ_HARMONICS = `
  float scarBasis(int k, vec3 d) {
    float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
    switch (k) {
      case 0: return -0.4886025119029199 * y;
      case 1: return 0.4886025119029199 * z;
      case 2: return -0.4886025119029199 * x;
      case 3: return 1.0925484305920792 * x * y;
      case 4: return -1.0925484305920792 * y * z;
      case 5: return 0.31539156525252005 * (2.0 * zz - xx - yy);
      case 6: return -1.0925484305920792 * x * z;
      case 7: return 0.5462742152960396 * (xx - yy);
      case 8: return -0.5900435899266435 * y * (3.0 * xx - yy);
      case 9: return 2.890611442640554 * x * y * z;
      case 10: return -0.4570457994644658 * y * (4.0 * zz - xx - yy);
      case 11: return 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
      case 12: return -0.4570457994644658 * x * (4.0 * zz - xx - yy);
      case 13: return 1.445305721320277 * z * (xx - yy);
      default: return -0.5900435899266435 * x * (xx - 3.0 * yy);
    }
  }

  vec3 scarHarmonics(usampler2D harmonics, int index, int degree, vec3 direction) {
    uint packed[12];
    uvec4 texel = uvec4(0u);
    for (int t = 0; t < degree; t++) {
      texel = scarTexel(harmonics, degree * index + t);
      for (int k = 0; k < 4; k++) packed[4 * t + k] = texel[k];
    }
    vec3 rgb = vec3(0.0);
    for (int k = 0; k < (degree + 1) * (degree + 1) - 1; k++) {
      vec3 colour;
      for (int c = 0; c < 3; c++) {
        int at = 3 * k + c;
        colour[c] = scarByte(packed[at >> 2], at & 3);
      }
      rgb += scarBasis(k, direction) * colour;
    }
    return rgb * scarStep(texel);
  }
`;

/** What a `SplatMesh` reads from; Spark exports its uses, not its name. */
type SplatSource = NonNullable<SplatMesh["splats"]>;

/** A tile of which something is still to be written. */
interface Upload {
  /** Where it goes, as far as it is not written. */
  spans: Span[];
  words: PackedTile;
  done: number;
}

/** Textures that a `SplatMesh` draws from: `new SplatMesh({ splats: source })`. */
export class ScarSplats implements SplatSource {
  /** Called when all of a tile is written: the next frame shows it. */
  onWritten: (words: PackedTile) => void = () => undefined;
  private readonly geometry: THREE.DataTexture;
  private readonly harmonics: THREE.DataTexture;
  private readonly pending = new Map<number, Upload>();
  private readonly places: Places;

  /**
   * @param renderer whose context the textures live in
   * @param total places for Gaussians, a multiple of 256: `placesFor` of the front and the budgets of the stream
   * @param shDegree of the file, 0 to 3
   */
  constructor(
    private readonly renderer: THREE.WebGLRenderer,
    readonly total: number,
    readonly shDegree: number,
  ) {
    this.places = new Places(total);
    this.geometry = texture(renderer, GEOMETRY_TEXELS * total);
    this.harmonics = texture(renderer, shDegree * total);
  }

  /** Takes a tile; `upload` brings it to the GPU. Throws RangeError where it has no room: its stream has larger budgets. */
  put(words: PackedTile): void {
    this.pending.set(words.tile, { spans: this.places.take(words.tile, words.count), words, done: 0 });
  }

  /** Makes a tile draw nothing: what a budget evicts. */
  clear(tile: number): void {
    this.pending.delete(tile);
    for (const { first, count } of this.places.give(tile)) {
      write(this.renderer, this.geometry, GEOMETRY_TEXELS * first, new Uint32Array(8 * count));
    }
  }

  /** Uploads as much as a frame has time for; true if anything was written, so that the mesh has to be drawn anew. */
  upload(): boolean {
    let left = UPLOAD_BYTES;
    const each = 16 * (GEOMETRY_TEXELS + this.shDegree);
    for (const [tile, part] of this.pending) {
      if (left < each && left < UPLOAD_BYTES) break;
      left -= each * this.writePart(part, Math.max(1, Math.floor(left / each)));
      if (part.done < part.words.count) continue;
      this.pending.delete(tile);
      this.onWritten(part.words);
    }
    return left < UPLOAD_BYTES;
  }

  /** Whether `upload` has something to do. */
  get waiting(): boolean {
    return this.pending.size > 0;
  }

  /** Writes up to so many Gaussians of a tile. @returns how many */
  private writePart(part: Upload, most: number): number {
    let left = most;
    for (let span = part.spans[0]; span !== undefined && left > 0; span = part.spans[0]) {
      const count = Math.min(span.count, left);
      this.writeSpan(part.words, part.done, { first: span.first, count });
      span.first += count;
      span.count -= count;
      if (span.count === 0) part.spans.shift();
      part.done += count;
      left -= count;
    }
    return most - left;
  }

  private writeSpan({ geometry, harmonics }: PackedTile, from: number, { first, count }: Span): void {
    const to = from + count;
    if (this.shDegree > 0) {
      const size = 4 * this.shDegree;
      write(this.renderer, this.harmonics, this.shDegree * first, harmonics.subarray(size * from, size * to));
    }
    write(this.renderer, this.geometry, GEOMETRY_TEXELS * first, geometry.subarray(8 * from, 8 * to));
  }

  prepareFetchSplat(): void {}

  dispose(): void {
    this.geometry.dispose();
    this.harmonics.dispose();
    this.pending.clear();
  }

  getNumSplats(): number {
    return this.total;
  }

  hasRgbDir(): boolean {
    return this.shDegree > 0;
  }

  getNumSh(): number {
    return this.shDegree;
  }

  /** All harmonics are drawn. */
  setMaxSh(): void {}

  fetchSplat({ index, viewOrigin }: Parameters<SplatSource["fetchSplat"]>[0]): ReturnType<SplatSource["fetchSplat"]> {
    const degree = this.shDegree;
    const read = new dyno.Dyno({
      inTypes: { index: "int", origin: "vec3", geometry: "usampler2D", harmonics: "usampler2D" },
      outTypes: { gsplat: dyno.Gsplat },
      inputs: {
        index,
        origin: viewOrigin ?? dyno.dynoConst("vec3", [0, 0, 0]),
        geometry: new dyno.DynoUsampler2D({ value: this.geometry, key: "scarGeometry" }),
        harmonics: new dyno.DynoUsampler2D({ value: this.harmonics, key: "scarHarmonics" }),
      },
      globals: () => [dyno.defineGsplat, READ_SPLAT, READ_HARMONICS],
      statements: ({ inputs, outputs }) => [
        `if (readScar(${inputs.geometry}, ${inputs.index}, ${outputs.gsplat}) && ${degree} > 0) {`,
        `  vec3 direction = normalize(${outputs.gsplat}.center - ${inputs.origin});`,
        `  ${outputs.gsplat}.rgba.rgb += scarHarmonics(${inputs.harmonics}, ${inputs.index}, ${degree}, direction);`,
        "}",
      ],
    });
    return read.outputs.gsplat;
  }

  /** Spark asks for numbers of single Gaussians when it picks with a ray; that is not offered: nothing is kept in memory. */
  forEachSplat(): void {
    throw new Error("a streamed scene keeps its Gaussians on the GPU alone: make the mesh with raycastable: false");
  }
}

function texture(renderer: THREE.WebGLRenderer, texels: number): THREE.DataTexture {
  const rows = Math.max(1, Math.ceil(texels / WIDTH));
  const limit = renderer.capabilities.maxTextureSize;
  if (rows > limit || WIDTH > limit) {
    throw new RangeError(`a scene of this size needs textures of ${WIDTH}×${rows}, this device has up to ${limit}×${limit}`);
  }
  const made = new THREE.DataTexture(null, WIDTH, rows, THREE.RGBAIntegerFormat, THREE.UnsignedIntType);
  made.internalFormat = "RGBA32UI";
  // The storage is zeros, which draw nothing; there is no array to fill it from.
  made.source.dataReady = false;
  made.needsUpdate = true;
  renderer.initTexture(made);
  return made;
}

/** Writes texels from number `start` on: at most three rectangles, as a run begins and ends within rows. */
function write(renderer: THREE.WebGLRenderer, target: THREE.DataTexture, start: number, data: Uint32Array): void {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  const { __webglTexture } = renderer.properties.get(target) as { __webglTexture: WebGLTexture };
  renderer.state.activeTexture(gl.TEXTURE0);
  renderer.state.bindTexture(gl.TEXTURE_2D, __webglTexture);
  gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  const texels = data.length / 4;
  for (let done = 0; done < texels; ) {
    const [x, y] = [(start + done) % WIDTH, Math.floor((start + done) / WIDTH)];
    const rows = x === 0 ? Math.floor((texels - done) / WIDTH) : 0;
    const [width, height] = rows > 0 ? [WIDTH, rows] : [Math.min(WIDTH - x, texels - done), 1];
    const part = data.subarray(4 * done, 4 * (done + width * height));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT, part);
    done += width * height;
  }
  renderer.state.unbindTexture();
}
