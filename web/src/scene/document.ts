/** What a scene index says (SPEC §17): several files that are one scene. */

import { nesting } from "../../../conformance/decoders/js/metadata.js";
import { StreamError } from "../stream/errors.js";
import { parsePlacement, type Placement } from "./placement.js";

export interface ListedLayer {
  /** Bytes from the start of the file to the end of the layer. */
  end: number;
  /** In it and all before. */
  anchors: number;
  gaussians: number;
}

/** What an index says of one file. */
export interface ListedFile {
  uri: string;
  length: number;
  headerCrc32: number;
  /** Names of SPEC §16. */
  profile: string;
  shDegree: number;
  slots: number;
  /** Least and greatest corner (6) of a box that all anchors are in, in its own coordinates. */
  box: Float64Array;
  layers: ListedLayer[];
  /** Null where its coordinates are those of the scene. */
  placement: Placement | null;
}

export interface SceneDocument {
  coordinateFrame: string;
  colourSpace: string;
  files: ListedFile[];
}

/** Names of SPEC §16 in the order of their numbers. */
export const PROFILES = ["EXPLICIT", "ANCHOR"];
export const FRAMES = ["UNSPECIFIED", "RDF", "RUB"];
export const COLOUR_SPACES = ["UNSPECIFIED", "SRGB", "LINEAR"];

/** The longest index. */
export const MOST_BYTES = 2 ** 26;
const MOST_FILES = 65536;
const MOST_NESTING = 8;
const MOST_URI_BYTES = 1024;
const MOST_LAYERS = 16;
const MOST_SLOTS = 32;
const MOST_ANCHORS = 2 ** 31;
const WHOLE = 2 ** 53 - 1;
const SEGMENT = /^[^\x00-\x1f\x7f\\:?#%*<>|"/]*[^\x00-\x1f\x7f\\:?#%*<>|"/. ]$/;
const HALF = /\p{Surrogate}/u;
const TOKEN = /"(?:[^"\\]|\\.)*"|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?/g;

type Members = Record<string, unknown>;

/** Rules R-17-1 to R-17-6. Throws StreamError with their ids. */
export function parseScene(bytes: Uint8Array): SceneDocument {
  demand(bytes.length <= MOST_BYTES, `an index of ${bytes.length} bytes`, "limit-scene");
  demand(nesting(bytes) <= MOST_NESTING, `nested ${nesting(bytes)} deep`, "limit-scene");
  const value = object(parseJson(bytes), "the index");
  demand(value["format"] === "scar-scene", 'the format is not "scar-scene"');
  const version = whole(value["version"], "version", 0, WHOLE);
  demand(version === 1, `version ${version} of a scene index`, "unsupported-scene");
  const coordinateFrame = named(value["coordinate_frame"], "coordinate_frame", FRAMES);
  const colourSpace = named(value["colour_space"], "colour_space", COLOUR_SPACES);
  const listed = list(value["files"], "files");
  demand(listed.length > 0, "no files");
  demand(listed.length <= MOST_FILES, `${listed.length} files`, "limit-scene");
  const files = listed.map((one, i) => parseFile(object(one, `files[${i}]`), `files[${i}]`));
  demand(new Set(files.map(({ uri }) => uri)).size === files.length, "a file is listed twice");
  return { coordinateFrame, colourSpace, files };
}

function parseJson(bytes: Uint8Array): unknown {
  let text: string;
  let value: unknown;
  try {
    text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes);
    value = JSON.parse(text);
  } catch (cause) {
    throw new StreamError("bad-scene", `not JSON: ${String(cause)}`);
  }
  for (const [token] of text.matchAll(TOKEN)) {
    demand(token.startsWith('"') || Number.isFinite(Number(token)), `${token.slice(0, 20)} is too large`);
  }
  return value;
}

function parseFile(value: Members, where: string): ListedFile {
  const length = whole(value["length"], `${where}.length`, 1, WHOLE);
  const slots = whole(value["slots"], `${where}.slots`, 1, MOST_SLOTS);
  return {
    uri: parseUri(value["uri"], `${where}.uri`),
    length,
    headerCrc32: whole(value["header_crc32"], `${where}.header_crc32`, 0, 2 ** 32 - 1),
    profile: named(value["profile"], `${where}.profile`, PROFILES),
    shDegree: whole(value["sh_degree"], `${where}.sh_degree`, 0, 3),
    slots,
    box: parseBox(value["box"], `${where}.box`),
    layers: parseLayers(value["layers"], `${where}.layers`, { length, slots }),
    placement: "transform" in value ? parseTransform(value["transform"], `${where}.transform`) : null,
  };
}

/** R-17-5 */
function parseUri(value: unknown, where: string): string {
  demand(typeof value === "string" && !HALF.test(value), `${where} is no text`);
  const uri = value as string;
  const size = new TextEncoder().encode(uri).length;
  demand(size >= 1 && size <= MOST_URI_BYTES, `${where} has ${size} bytes`);
  const isBelow = uri.split("/").every((segment) => SEGMENT.test(segment));
  demand(isBelow, `${where} is no path below the folder of the index: ${uri}`);
  return uri;
}

function parseBox(value: unknown, where: string): Float64Array {
  const corners = list(value, where).map((corner) => numbers(corner, where, 3));
  demand(corners.length === 2, `${where} is not two corners`);
  const [low, high] = corners;
  demand(low.every((x, axis) => x <= high[axis]), `${where} ends before it begins`);
  return Float64Array.from([...low, ...high]);
}

function parseLayers(value: unknown, where: string, file: { length: number; slots: number }): ListedLayer[] {
  const rows = list(value, where);
  demand(rows.length >= 1 && rows.length <= MOST_LAYERS, `${where}: ${rows.length} layers`);
  let before = { end: 0, anchors: 0, gaussians: 0 };
  for (const [i, row] of rows.entries()) {
    const at = `${where}[${i}]`;
    const members = object(row, at);
    const layer = {
      end: whole(members["end"], `${at}.end`, 1, WHOLE),
      anchors: whole(members["anchors"], `${at}.anchors`, 0, MOST_ANCHORS),
      gaussians: whole(members["gaussians"], `${at}.gaussians`, 0, WHOLE),
    };
    const grows = layer.end >= before.end && layer.anchors >= before.anchors && layer.gaussians >= before.gaussians;
    demand(grows, `${at} is less than the layer before`);
    demand(layer.gaussians <= layer.anchors * file.slots, `${at} has more Gaussians than slots`);
    rows[i] = before = layer;
  }
  demand(before.end === file.length, `${where} end at ${before.end}, the file at ${file.length}`);
  return rows as ListedLayer[];
}

function parseTransform(value: unknown, where: string): Placement {
  const rows = list(value, where).map((row) => numbers(row, where, 4));
  demand(rows.length === 4, `${where} is not four rows`);
  const placement = parsePlacement(rows);
  demand(placement !== null, `${where} is no rotation, scale and translation`);
  return placement!;
}

function object(value: unknown, where: string): Members {
  demand(typeof value === "object" && value !== null && !Array.isArray(value), `${where} is no object`);
  return value as Members;
}

function list(value: unknown, where: string): unknown[] {
  demand(Array.isArray(value), `${where} is no list`);
  return [...(value as unknown[])];
}

function numbers(value: unknown, where: string, count: number): number[] {
  const found = list(value, where);
  demand(found.length === count && found.every((x) => typeof x === "number"), `${where} is not ${count} numbers`);
  return found as number[];
}

function whole(value: unknown, where: string, low: number, high: number): number {
  const fits = typeof value === "number" && Number.isInteger(value) && value >= low && value <= high;
  demand(fits, `${where} is no whole number from ${low} to ${high}`);
  return value as number;
}

function named(value: unknown, where: string, names: string[]): string {
  demand(typeof value === "string" && names.includes(value), `${where} is none of ${names.join(", ")}`);
  return value as string;
}

function demand(holds: boolean, message: string, id = "bad-scene"): void {
  if (!holds) throw new StreamError(id, message);
}
