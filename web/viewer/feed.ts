/** A scene of one file or of several, followed in the same way. */

import type { PackedTile } from "../src/decoder/types.js";
import { inRuns, placeBytes, placesFor, RUN } from "../src/pack/places.js";
import type { Budgets, Camera, SceneIndex } from "../src/plan/types.js";
import { isIndexName, type Resolve } from "../src/scene/index_file.js";
import type { Placement } from "../src/scene/placement.js";
import { ScarScene } from "../src/scene/scar_scene.js";
import type { SceneFront } from "../src/scene/scene_front.js";
import type { StreamError } from "../src/stream/errors.js";
import { ScarStream, type Stats, type StreamOptions } from "../src/stream/scar_stream.js";
import type { SourceLike } from "../src/stream/source.js";

/** Where a scene comes from. */
export interface Origin {
  name: string;
  source: SourceLike;
  /** Gives the files of an index that has no address. */
  resolve?: Resolve;
}

/** What is known of a scene at first: of one file its tiles, of several its files. */
export interface Outline {
  header: { coordinate_frame: number };
  layers: { end_offset: number }[];
  index: SceneIndex;
}

/** What is drawn with one mesh: tiles of one degree of harmonics, placed alike. */
export interface Room {
  /** Places for Gaussians, a multiple of 256. */
  places: number;
  shDegree: number;
  placement: Placement | null;
}

export interface FeedEvents {
  onFront(outline: Outline, rooms: Room[]): void;
  /** @param key of the tile, in its room */
  onTile(room: number, key: number, words: PackedTile): void;
  onEvict(room: number, key: number): void;
  onProgress(): void;
  onDone(): void;
  onError(error: StreamError): void;
}

export interface Feed {
  setView(camera: Camera): void;
  stats(): Stats;
  resume(): void;
  close(): void;
}

/** Of a file, as many keys as it may have tiles. */
const KEYS = 2 ** 24;
/** Rooms of scenes have so many places more than Gaussians for each file: how many tiles there are is not known. */
const SPARE = 65536;

export function isSeveral({ name }: Origin): boolean {
  return isIndexName(name);
}

/** @param options `output` is for the feed to say */
export function openFeed(origin: Origin, options: StreamOptions, events: FeedEvents): Feed {
  return isSeveral(origin) ? openScene(origin, options, events) : openFile(origin, options, events);
}

function openFile({ source }: Origin, options: StreamOptions, events: FeedEvents): Feed {
  const stream = new ScarStream(source, { ...options, output: "words" });
  stream.on("front", (front) => {
    const { sh_degree: shDegree } = front.header;
    events.onFront(front, [{ places: placesFor(front, stream.budgets), shDegree, placement: null }]);
  });
  stream.on("tile", ({ tile, output }) => events.onTile(0, tile, output as PackedTile));
  stream.on("evict", ({ tile }) => events.onEvict(0, tile));
  stream.on("progress", () => events.onProgress());
  stream.on("done", () => events.onDone());
  stream.on("error", (error) => events.onError(error));
  return stream;
}

function openScene({ source, resolve }: Origin, options: StreamOptions, events: FeedEvents): Feed {
  const scene = new ScarScene(source, { ...options, output: "words", ...(resolve === undefined ? {} : { resolve }) });
  let roomOf: number[] = [];
  scene.on("front", (front) => {
    const { rooms, ofFile } = roomsOf(front, scene.budgets);
    roomOf = ofFile;
    events.onFront(front, rooms);
  });
  scene.on("tile", ({ file, tile, output }) => events.onTile(roomOf[file], file * KEYS + tile, output as PackedTile));
  scene.on("evict", ({ file, tile }) => events.onEvict(roomOf[file], file * KEYS + tile));
  scene.on("progress", () => events.onProgress());
  scene.on("done", () => events.onDone());
  scene.on("error", (error) => events.onError(error));
  return scene;
}

function roomsOf({ document: { files } }: SceneFront, budgets: Budgets): { rooms: Room[]; ofFile: number[] } {
  const found = new Map<string, number>();
  const rooms: Room[] = [];
  const ofFile = files.map(({ placement, shDegree, layers }) => {
    const name = JSON.stringify([shDegree, placement && { ...placement, rotation: [...placement.rotation] }]);
    const room = found.get(name) ?? rooms.push({ places: 0, shDegree, placement }) - 1;
    found.set(name, room);
    rooms[room].places += inRuns(2 * layers.at(-1)!.gaussians) + SPARE;
    return room;
  });
  for (const room of rooms) {
    const most = Math.min(budgets.splats, budgets.bytes / placeBytes(room.shDegree));
    room.places = Math.max(RUN, Math.min(room.places, Math.floor(most / RUN) * RUN));
  }
  return { rooms, ofFile };
}
