/** FILE_HEADER and LAYER_SUMMARY (SPEC §5.1 to §5.3). */

import { crc32 } from "./crc32.js";
import { demand, Refused } from "./errors.js";
import { LIMITS, MAX_LAYERS, PROFILE } from "./registry.js";

/** The fields of SPEC §5.2. */
export type Header = Numbers<RawHeader>;
/** The fields of SPEC §5.3. */
export type Summary = Numbers<RawSummary>;

type RawHeader = ReturnType<typeof rawHeader>;
type RawSummary = ReturnType<typeof rawSummary>;
type Numbers<Raw> = { [Name in keyof Raw]: Raw[Name] extends bigint[] ? number[] : Raw[Name] extends bigint ? number : Raw[Name] };

export const SIGNATURE = [0x89, 0x53, 0x43, 0x41, 0x52, 0x0d, 0x0a, 0x1a, 0x0a];
const NAME = SIGNATURE.slice(1, 5);
const FIXED = 100;
const SUMMARY = 136;
const CHECKSUM = 4;
const STREAMS = 13;
const MINOR = 3;
const MOST_PAGE_BITS = 16;
const MAX_INTEGER = 2n ** 53n - 1n;
/** Where the header says how long the file is. */
const FILE_LENGTH_AT = 16;

/** The longest header, bytes. */
export const MOST_HEADER = FIXED + SUMMARY * MAX_LAYERS + CHECKSUM;

/**
 * Rules R-5.1-1 to R-5.3-8 in their order.
 * @param bytes the first MOST_HEADER bytes of a file or more, or the whole of a shorter one
 * @param size of the file, bytes; null where that is not known: then what the header says
 */
export function readHeader(bytes: Uint8Array, size: number | null): { header: Header; layers: Summary[] } {
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const cut = bytes.length < FILE_LENGTH_AT + 8;
  const present = size ?? (cut ? bytes.length : Number(data.getBigUint64(FILE_LENGTH_AT, true)));
  checkSignature(bytes.subarray(0, Math.min(11, present)));
  demand(present >= 16, "truncated-header", "less than 16 bytes", present);
  const length = data.getUint32(12, true);
  const declared = (length - FIXED - CHECKSUM) / SUMMARY;
  const possible = Number.isInteger(declared) && declared >= 1 && declared <= MAX_LAYERS;
  demand(possible, "bad-header-length", `header length ${length}`, 12);
  demand(present >= length, "truncated-header", `less than the ${length} bytes of the header`, present);
  const stored = data.getUint32(length - CHECKSUM, true);
  demand(stored === crc32(bytes.subarray(0, length - CHECKSUM)), "header-crc-mismatch", "header CRC", length - 4);
  const raw = rawHeader(bytes, data, length);
  checkHeader(raw);
  const layers = checkSummaries(data, raw);
  checkFileLength(raw, layers, present);
  return { header: withNumbers(raw), layers: layers.map(withNumbers) };
}

/** A record whose 64-bit integers, which are below 2^53, are numbers. */
function withNumbers<Raw extends object>(raw: Raw): Numbers<Raw> {
  const plain = (value: unknown): unknown =>
    typeof value === "bigint" ? Number(value) : Array.isArray(value) ? value.map(plain) : value;
  return Object.fromEntries(Object.entries(raw).map(([name, value]) => [name, plain(value)])) as Numbers<Raw>;
}

/** R-5.1-1, R-5.1-2. @param start up to 11 bytes */
function checkSignature(start: Uint8Array): void {
  const agree = SIGNATURE.slice(0, start.length).every((byte, i) => start[i] === byte);
  if (!agree) {
    const named = [0, 1, 2, 3, 4].some((at) => NAME.every((byte, i) => start[at + i] === byte));
    throw new Refused(named ? "damaged-signature" : "bad-signature", "not the signature of a .scar file", 0);
  }
  demand(start.length >= 11, "truncated-header", "the version is cut", start.length);
  demand(start[9] === 0 && start[10] === MINOR, "unsupported-version", `version ${start[9]}.${start[10]}`, 9);
}

function rawHeader(bytes: Uint8Array, data: DataView, length: number) {
  const u64 = (at: number) => data.getBigUint64(at, true);
  return {
    signature: bytes.slice(0, 9),
    major: bytes[9],
    minor: bytes[10],
    render_model: bytes[11],
    header_length: length,
    file_length: u64(FILE_LENGTH_AT),
    profile: bytes[24],
    sh_degree: bytes[25],
    layer_count: bytes[26],
    slots: bytes[27],
    lattice_bits: bytes[28],
    coordinate_frame: bytes[29],
    colour_space: bytes[30],
    page_bits: bytes[31],
    tile_count: data.getUint32(32, true),
    root_length: data.getUint32(36, true),
    anchor_count: u64(40),
    gaussian_count: u64(48),
    origin: [56, 64, 72].map((at) => data.getFloat64(at, true)) as [number, number, number],
    voxel: data.getFloat64(80, true),
    source_count: u64(88),
    root_crc32: data.getUint32(96, true),
    header_crc32: data.getUint32(length - CHECKSUM, true),
  };
}

/** R-5.2-5 to R-5.2-19. */
function checkHeader(h: RawHeader): void {
  const anchor = h.profile === PROFILE.ANCHOR;
  demand(h.render_model <= 2, "bad-reserved", `render model ${h.render_model}`, 11);
  demand(h.file_length <= MAX_INTEGER, "bad-file-length", `file length ${h.file_length}`, 16);
  demand(h.profile <= 1, "bad-profile", `profile ${h.profile}`, 24);
  demand(h.sh_degree <= (anchor ? 0 : 3), "bad-sh-degree", `degree ${h.sh_degree}`, 25);
  const implied = FIXED + CHECKSUM + SUMMARY * h.layer_count;
  demand(implied === h.header_length, "bad-layer-count", `${h.layer_count} layers`, 26);
  demand(h.slots >= 1 && h.slots <= (anchor ? 32 : 1), "bad-slots", `${h.slots} slots`, 27);
  demand(h.lattice_bits >= 1 && h.lattice_bits <= 32, "bad-lattice-bits", `${h.lattice_bits} lattice bits`, 28);
  demand(h.coordinate_frame <= 2, "bad-coordinate-frame", `coordinate frame ${h.coordinate_frame}`, 29);
  demand(h.colour_space <= 2, "bad-colour-space", `colour space ${h.colour_space}`, 30);
  demand(h.page_bits <= MOST_PAGE_BITS, "bad-page-bits", `pages of 2^${h.page_bits} tiles`, 31);
  demand(h.origin.every(Number.isFinite), "bad-origin", `origin ${h.origin}`, 56);
  demand(Number.isFinite(h.voxel) && h.voxel > 0, "bad-voxel", `voxel ${h.voxel}`, 80);
  const reach = Math.max(...h.origin.map(Math.abs)) + h.voxel * 2 ** (h.lattice_bits + 1);
  demand(Number.isFinite(reach), "bad-voxel", `positions reach ${reach}`, 80);
  demand(h.source_count <= MAX_INTEGER, "bad-source-count", `source count ${h.source_count}`, 88);
  demand(h.tile_count <= LIMITS.tiles, "limit-tiles", `${h.tile_count} tiles`, 32);
  demand(h.anchor_count <= LIMITS.anchors, "limit-anchors", `${h.anchor_count} anchors`, 40);
  demand(h.gaussian_count <= LIMITS.gaussians, "limit-gaussians", `${h.gaussian_count} Gaussians`, 48);
  demand(h.root_length <= LIMITS.root_bytes, "limit-root", `a ROOT of ${h.root_length} bytes`, 36);
  const anchors = Number(h.anchor_count);
  const length = Number(h.file_length);
  const expands = anchors > 2 ** 16 + LIMITS.anchors_per_byte * length;
  const slotsExpand = anchors * h.slots > 2 ** 19 + LIMITS.slots_per_byte * length;
  demand(!expands && !slotsExpand, "limit-expansion", `${anchors} anchors of ${h.slots} slots`, 40);
}

function rawSummary(data: DataView, at: number) {
  const u64 = (i: number) => data.getBigUint64(at + 8 * i, true);
  return {
    anchor_count: u64(0),
    gaussian_count: u64(1),
    byte_count: u64(2),
    end_offset: u64(3),
    stream_bytes: Array.from({ length: STREAMS }, (_, i) => u64(4 + i)),
  };
}

/** R-5.3-1 to R-5.3-5. */
function checkSummaries(data: DataView, h: RawHeader): RawSummary[] {
  const least = BigInt(h.header_length) + BigInt(h.root_length);
  let end = 0n;
  let anchors = 0n;
  let gaussians = 0n;
  const layers: RawSummary[] = [];
  for (let i = 0; i < h.layer_count; i++) {
    const at = FIXED + SUMMARY * i;
    const s = rawSummary(data, at);
    const grows = s.anchor_count >= anchors && s.gaussian_count >= gaussians;
    demand(grows, "layer-counts", `layer ${i + 1} has fewer anchors or Gaussians than the one before`, at);
    const most = s.anchor_count * BigInt(h.slots);
    const fits = h.profile === PROFILE.EXPLICIT ? s.gaussian_count === most : s.gaussian_count <= most;
    demand(fits, "layer-counts", `layer ${i + 1} has ${s.gaussian_count} Gaussians`, at + 8);
    const sum = s.stream_bytes.reduce((a, b) => a + b, 0n);
    demand(sum === s.byte_count, "layer-bytes", `stream bytes of layer ${i + 1}`, at + 32);
    const begins = s.end_offset - s.byte_count;
    demand(i === 0 ? begins >= least : begins === end, "layer-offset", `end of layer ${i + 1}`, at + 24);
    end = s.end_offset;
    ({ anchor_count: anchors, gaussian_count: gaussians } = s);
    layers.push(s);
  }
  const agree = h.anchor_count === anchors && h.gaussian_count === gaussians;
  demand(agree, "layer-counts", "the counts of the header are not those of the last layer", 40);
  return layers;
}

/** R-5.3-6 to R-5.3-8. @param present bytes of the file that there are */
function checkFileLength(h: RawHeader, layers: RawSummary[], present: number): void {
  const end = layers[layers.length - 1].end_offset;
  demand(h.file_length === end, "bad-file-length", `file length ${h.file_length}, layers end at ${end}`, 16);
  demand(present <= h.file_length, "trailing-bytes", "bytes after the end of the file", Number(end));
  demand(present >= h.file_length, "truncated-file", `${present} bytes of ${end}`, present);
}

/** D, where the directory ends and blocks begin (R-5.3-4). */
export function directoryEnd(layers: Summary[]): number {
  return layers[0].end_offset - layers[0].byte_count;
}
