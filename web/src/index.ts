/** scar-stream: .scar scenes of 3D Gaussians in a page. */

import { loadModule } from "./decoder/shared_module.js";

export type * from "./decoder/types.js";
export type { Output, TileOutput } from "./decoder/protocol.js";
export { byView } from "./plan/by_view.js";
export type * from "./plan/types.js";
export { inlineChannel, workerChannel } from "./decoder/channel.js";
export type { Channel, ChannelEvents, MakeChannel } from "./decoder/channel.js";
export { StreamError } from "./stream/errors.js";
export type { TransportId } from "./stream/errors.js";
export { fileOrder } from "./plan/file_order.js";
export type { Front } from "./stream/directory.js";
export type { RangeReader } from "./stream/local_source.js";
export type { SourceLike } from "./stream/source.js";
export { ScarStream } from "./stream/scar_stream.js";
export { isIndexName } from "./scene/index_file.js";
export type { Resolve } from "./scene/index_file.js";
export { ScarScene } from "./scene/scar_scene.js";
export type { SceneEvents, SceneOptions, SceneTileEvent } from "./scene/scar_scene.js";
export type { SceneFront } from "./scene/scene_front.js";
export type { EvictEvent, Progress, Stats, StreamEvents, StreamOptions, TileEvent } from "./stream/scar_stream.js";

/** The decoder in WebAssembly; see `loadModule` of src/decoder/shared_module.ts. */
export async function createWasmDecoder(from?: string | URL): Promise<import("./decoder/types.js").TileDecoder> {
  const { createWasmDecoder: create } = await import("./decoder/wasm.js");
  return create(await loadModule(from));
}

/** The decoder in JavaScript, which is loaded when it is first asked for. */
export async function createJsDecoder(): Promise<import("./decoder/types.js").TileDecoder> {
  const { createJsDecoder: create } = await import("./decoder/js.js");
  return create();
}
