/**
 * Whole scenes for loaders.gl: `await load("toys.scar", ScarLoader)`. Columns have the names and the units that its own
 * loaders of Gaussians give them.
 */

import type { TileValues } from "../decoder/types.js";
import { SIGNATURE } from "../format/header.js";
import { ScarStream, type StreamOptions } from "../stream/scar_stream.js";

export interface ScarLoaderOptions {
  /** Of the stream that decodes. */
  scar?: Omit<StreamOptions, "output" | "budgets">;
}

interface Field {
  name: string;
  type: "float32" | { type: "fixed-size-list"; listSize: 3; children: { name: "value"; type: "float32" }[] };
  nullable: false;
  metadata: Record<string, string>;
}

/** A mesh of points, as loaders.gl has them: one for each Gaussian. */
export interface ScarMesh {
  loader: "scar";
  header: { vertexCount: number; boundingBox: [number[], number[]] };
  topology: "point-list";
  mode: 0;
  schema: { fields: Field[]; metadata: Record<string, string> };
  /**
   * POSITION; f_dc_0 to 2 and f_rest_0 to 3 ((degree + 1)² - 1) - 1: coefficients of harmonics, the latter colour by colour;
   * opacity, 0..1; scale_0 to 2: standard deviations; rot_0 to 3: a unit quaternion w x y z.
   */
  attributes: Record<string, { value: Float32Array; size: number }>;
}

export const ScarLoader = {
  /** What its results are, for types. */
  dataType: null as unknown as ScarMesh,
  name: "Gaussians (.scar)",
  id: "scar",
  module: "scar-stream",
  version: "latest",
  category: "mesh",
  extensions: ["scar"],
  mimeTypes: ["application/x.scar"],
  // As text: loaders.gl compares bytes with the buffer that a view is of, from its start.
  tests: [String.fromCharCode(...SIGNATURE)],
  binary: true,
  // Decoders have workers of their own.
  worker: false,
  options: {},
  parse,
};

/** Throws StreamError where anything of the file is damaged: a table has all Gaussians, or none. */
async function parse(data: ArrayBuffer, { scar }: ScarLoaderOptions = {}): Promise<ScarMesh> {
  const tiles = new Map<number, TileValues>();
  const stream = new ScarStream(new Blob([data]), { ...scar, output: "values", budgets: { bytes: Infinity } });
  stream.on("tile", ({ tile, output }) => tiles.set(tile, output as TileValues));
  try {
    await new Promise<void>((resolve, reject) => {
      stream.on("done", () => resolve());
      stream.on("error", reject);
    });
  } finally {
    stream.close();
  }
  return meshOf([...tiles.values()], stream.front!.header.sh_degree);
}

function meshOf(tiles: TileValues[], degree: number): ScarMesh {
  const vertexCount = tiles.reduce((sum, { count }) => sum + count, 0);
  const attributes: ScarMesh["attributes"] = {};
  const fields: Field[] = [];
  const prefix = "loaders_gl.gaussian_splats";
  const add = (name: string, type: Field["type"], value: Float32Array, size: number, said: Record<string, string>) => {
    attributes[name] = { value, size };
    const metadata = Object.fromEntries(Object.entries(said).map(([key, text]) => [`${prefix}.${key}`, text]));
    fields.push({ name, type, nullable: false, metadata });
  };
  /** Number `at` of every `width` of an array of all tiles. */
  const column = (of: "centres" | "scales" | "quats" | "opacity" | "sh", width: number, at: number): Float32Array => {
    const value = new Float32Array(vertexCount);
    let n = 0;
    for (const tile of tiles) for (let i = at; i < width * tile.count; i += width) value[n++] = tile[of][i];
    return value;
  };
  const axes = [0, 1, 2].map((axis) => column("centres", 3, axis));
  const positions = Float32Array.from({ length: 3 * vertexCount }, (_, i) => axes[i % 3][Math.floor(i / 3)]);
  add("POSITION", { type: "fixed-size-list", listSize: 3, children: [{ name: "value", type: "float32" }] }, positions, 3, {});
  const scalar = (name: string, value: Float32Array, semantic: string, component: number, encoding: string) =>
    add(name, "float32", value, 1, { semantic, component: String(component), encoding });
  const others = (degree + 1) ** 2 - 1;
  const width = 3 * (others + 1);
  for (let c = 0; c < 3; c++) scalar(`f_dc_${c}`, column("sh", width, c), "spherical_harmonic_dc", c, "coefficient");
  scalar("opacity", column("opacity", 1, 0), "opacity", 0, "linear");
  for (let c = 0; c < 3; c++) scalar(`scale_${c}`, column("scales", 3, c), "scale", c, "linear");
  for (let c = 0; c < 4; c++) scalar(`rot_${c}`, column("quats", 4, c), "rotation", c, "quaternion");
  for (let k = 0; k < 3 * others; k++) {
    const at = 3 * (1 + (k % others)) + Math.floor(k / others);
    scalar(`f_rest_${k}`, column("sh", width, at), "spherical_harmonic_rest", k, "coefficient");
  }
  const metadata = { "loaders_gl.semantic_type": "gaussian-splats", [`${prefix}.version`]: "1", [`${prefix}.source_format`]: "scar" };
  const ends = (end: (a: number, b: number) => number, start: number) => axes.map((axis) => axis.reduce((a, b) => end(a, b), start));
  const boundingBox: [number[], number[]] = [ends(Math.min, Infinity), ends(Math.max, -Infinity)];
  const header = { vertexCount, boundingBox };
  return { loader: "scar", header, topology: "point-list", mode: 0, schema: { fields, metadata }, attributes };
}
