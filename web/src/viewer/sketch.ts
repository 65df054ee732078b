/**
 * A scene before the library that draws it has come: Gaussians as sorted ellipses, by WebGL2 alone. They have the shapes
 * and the order of INRIA's renderer, and the colour that is left where harmonics are left out. A tile is drawn as it first came.
 */

import type { PackedTile } from "../decoder/types.js";
import { UNPACK_GLSL } from "../pack/unpack_glsl.js";
import type { Front } from "../format/directory.js";
import { cameraOf, nearestDrawn, type View } from "../plan/framing.js";
import type { Camera } from "../plan/types.js";
import { cross } from "../plan/vectors.js";

/** Texels in a row of the texture, of which a Gaussian has two. */
const WIDTH = 2048;
const ROW = WIDTH / 2;
/** Rows that are drawn, of half a million Gaussians: more take too long to sort between two frames. */
const MOST_ROWS = 512;
/** Words of a Gaussian. */
const STRIDE = 8;
/** Steps of depth that are told apart. */
const DEPTHS = 1 << 16;
/** Beyond twice as many pixels as the page has, nobody sees a difference, and each costs. */
const MOST_PIXEL_RATIO = 2;
/** What `header.render_model` says of Gaussians that were trained to be made fainter where they are widened. */
const ANTIALIASED = 1;

const VERTEX = `#version 300 es
  precision highp float;
  precision highp int;
  precision highp usampler2D;
  uniform usampler2D words;
  uniform mat3 axes;
  uniform vec3 eye;
  uniform float focal;
  uniform float nearest;
  uniform vec2 size;
  uniform bool antialiased;
  in uint place;
  out vec4 colour;
  out vec2 away;
  ${UNPACK_GLSL}
  mat3 rotation(vec4 q) {
    vec3 v = q.xyz;
    mat3 turned = mat3(0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0);
    return mat3(1.0) + 2.0 * (q.w * turned + turned * turned);
  }

  void main() {
    ivec2 texel = ivec2(2 * (int(place) % ${ROW}), int(place) / ${ROW});
    uvec4 first = texelFetch(words, texel, 0);
    uvec4 last = texelFetch(words, texel + ivec2(1, 0), 0);
    vec3 centre = (scarCentre(first) - eye) * axes;
    colour = scarColour(last);
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    if (centre.z < nearest || colour.a < 1.0 / 255.0) return;
    vec3 scales = scarScales(first, last);
    mat3 shape = transpose(axes) * rotation(scarQuaternion(last)) * mat3(scales.x, 0, 0, 0, scales.y, 0, 0, 0, scales.z);
    vec2 farthest = 1.3 * size / (2.0 * focal);
    vec2 slope = clamp(centre.xy / centre.z, -farthest, farthest);
    vec3 across = (focal / centre.z) * vec3(1.0, 0.0, -slope.x) * shape;
    vec3 upward = (focal / centre.z) * vec3(0.0, 1.0, -slope.y) * shape;
    vec3 exact = vec3(dot(across, across), dot(across, upward), dot(upward, upward));
    vec3 blurred = exact + vec3(0.3, 0.0, 0.3);
    if (antialiased) {
      float area = max(exact.x * exact.z - exact.y * exact.y, 0.0);
      colour.a *= sqrt(area / (blurred.x * blurred.z - blurred.y * blurred.y));
    }
    float middle = (blurred.x + blurred.z) / 2.0;
    float apart = length(vec2((blurred.x - blurred.z) / 2.0, blurred.y));
    float angle = atan(2.0 * blurred.y, blurred.x - blurred.z) / 2.0;
    vec2 axis = vec2(cos(angle), sin(angle));
    // To where it is fainter than a step of 8 bits.
    away = sqrt(max(2.0 * log(255.0 * colour.a), 0.0)) * vec2(gl_VertexID % 2 * 2 - 1, gl_VertexID / 2 * 2 - 1);
    vec2 pixels = away.x * sqrt(middle + apart) * axis + away.y * sqrt(max(middle - apart, 0.1)) * vec2(-axis.y, axis.x);
    gl_Position = vec4((focal * centre.xy / centre.z + pixels) * 2.0 / size, 0.0, 1.0);
  }
`;

const FRAGMENT = `#version 300 es
  precision highp float;
  in vec4 colour;
  in vec2 away;
  out vec4 drawn;

  void main() {
    float alpha = min(0.99, colour.a * exp(-dot(away, away) / 2.0));
    if (alpha < 1.0 / 255.0) discard;
    drawn = vec4(max(colour.rgb, 0.0) * alpha, alpha);
  }
`;

/** A tile in the texture. */
interface Placed {
  tile: number;
  layer: number;
  /** Place of its first Gaussian. */
  first: number;
  /** Centres, every STRIDE numbers. */
  numbers: Float32Array;
}

export class Sketch {
  readonly #antialiased: boolean;
  readonly #program: WebGLProgram;
  readonly #texture: WebGLTexture;
  readonly #order: WebGLBuffer;
  readonly #vertices: WebGLVertexArrayObject;
  readonly #height: number;
  readonly #placed = new Map<number, Placed>();
  #rows = 0;
  #count = 0;
  /** For which view, and how many tiles, the order is. */
  #sorted = "";
  /** Tiles that no picture has shown yet. */
  #fresh: Placed[] = [];

  private constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly gl: WebGL2RenderingContext,
    { total, index: { tiles }, header }: Front,
  ) {
    this.#antialiased = header.render_model === ANTIALIASED;
    this.#program = linked(gl);
    this.#texture = gl.createTexture();
    this.#order = gl.createBuffer();
    this.#vertices = gl.createVertexArray();
    this.#height = Math.min(Math.ceil(total / ROW) + tiles, MOST_ROWS);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, WIDTH, this.#height);
    gl.bindVertexArray(this.#vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#order);
    const place = gl.getAttribLocation(this.#program, "place");
    gl.enableVertexAttribArray(place);
    gl.vertexAttribIPointer(place, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(place, 1);
    gl.bindVertexArray(null);
  }

  /** A sketch of a scene on a canvas, null where that cannot be. */
  static of(canvas: HTMLCanvasElement, front: Front): Sketch | null {
    const gl = contextOf(canvas);
    try {
      return gl && new Sketch(canvas, gl, front);
    } catch {
      return null;
    }
  }

  /** Gaussians that it has. */
  get count(): number {
    return this.#count;
  }

  /** Takes a tile, unless it has it, or has no room. */
  put({ tile, layer, count, geometry }: PackedTile): void {
    const used = Math.ceil(count / ROW);
    if (this.#placed.has(tile) || this.#rows + used > this.#height) return;
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
    const rows = Math.floor(count / ROW);
    for (const [y, width, height] of [[0, WIDTH, rows], [rows, 2 * (count % ROW), 1]]) {
      if (width * height === 0) continue;
      const part = geometry.subarray(STRIDE * ROW * y, STRIDE * ROW * y + 4 * width * height);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, this.#rows + y, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT, part);
    }
    const numbers = new Float32Array(geometry.buffer, geometry.byteOffset, STRIDE * count);
    const placed = { tile, layer, first: ROW * this.#rows, numbers };
    this.#placed.set(tile, placed);
    this.#fresh.push(placed);
    this.#rows += used;
    this.#count += count;
  }

  /** Draws what there is in place of what is on the canvas; nothing behind it. @returns tiles that are new in the picture */
  draw(view: View): { tile: number; layer: number }[] {
    const { gl, canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.floor(size * pixelRatio()));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const { position, forward, up, fovY } = cameraOf(view, width, height);
    const right = cross(forward, up);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.colorMask(true, true, true, true);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendEquation(gl.FUNC_ADD);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.#program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    const uniform = (name: string) => gl.getUniformLocation(this.#program, name);
    gl.uniformMatrix3fv(uniform("axes"), false, [...right, ...up, ...forward]);
    gl.uniform3fv(uniform("eye"), position);
    gl.uniform1f(uniform("focal"), height / (2 * Math.tan(fovY / 2)));
    gl.uniform1f(uniform("nearest"), nearestDrawn(view));
    gl.uniform2f(uniform("size"), width, height);
    gl.uniform1i(uniform("antialiased"), Number(this.#antialiased));
    gl.bindVertexArray(this.#vertices);
    this.#sort(position, forward);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.#count);
    gl.bindVertexArray(null);
    return this.#fresh.splice(0);
  }

  dispose(): void {
    const { gl } = this;
    gl.deleteProgram(this.#program);
    gl.deleteTexture(this.#texture);
    gl.deleteBuffer(this.#order);
    gl.deleteVertexArray(this.#vertices);
  }

  /** Puts places into the order in which they are drawn, the farthest first. */
  #sort([x, y, z]: Camera["position"], [fx, fy, fz]: Camera["forward"]): void {
    const key = [x, y, z, fx, fy, fz, this.#count].join();
    if (key === this.#sorted) return;
    this.#sorted = key;
    const depths = new Float32Array(this.#count);
    const places = new Uint32Array(this.#count);
    let [n, low, high] = [0, Infinity, -Infinity];
    for (const { first, numbers } of this.#placed.values()) {
      for (let i = 0; i < numbers.length; i += STRIDE) {
        const depth = (numbers[i] - x) * fx + (numbers[i + 1] - y) * fy + (numbers[i + 2] - z) * fz;
        low = Math.min(low, depth);
        high = Math.max(high, depth);
        depths[n] = depth;
        places[n++] = first + i / STRIDE;
      }
    }
    // Plain loops: calls for each number would take longer than a frame.
    const step = (DEPTHS - 1) / Math.max(high - low, Number.MIN_VALUE);
    const starts = new Uint32Array(DEPTHS + 1);
    const steps = new Uint16Array(n);
    for (let i = 0; i < n; i++) {
      steps[i] = (high - depths[i]) * step;
      starts[steps[i] + 1]++;
    }
    for (let at = 0; at < DEPTHS; at++) starts[at + 1] += starts[at];
    const sorted = new Uint32Array(n);
    for (let i = 0; i < n; i++) sorted[starts[steps[i]]++] = places[i];
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.#order);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, sorted, this.gl.DYNAMIC_DRAW);
  }
}

/** The context of a canvas, as it is for a sketch and for what comes after it. */
export function contextOf(canvas: HTMLCanvasElement): WebGL2RenderingContext | null {
  return canvas.getContext("webgl2", { alpha: true, antialias: false });
}

/** Pixels of a canvas for each of the page's. */
export function pixelRatio(): number {
  return Math.min(devicePixelRatio, MOST_PIXEL_RATIO);
}

function linked(gl: WebGL2RenderingContext): WebGLProgram {
  const program = gl.createProgram();
  for (const [type, code] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, code);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no program");
  return program;
}
