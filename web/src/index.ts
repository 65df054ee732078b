/** scar-stream: .scar scenes of 3D Gaussians in a page. */

export { inlineChannel, workerChannel } from "./decoder/channel.js";
export type { Channel, ChannelEvents, MakeChannel } from "./decoder/channel.js";
export type { Output, TileOutput } from "./decoder/protocol.js";
export { loadModule } from "./decoder/shared_module.js";
export type * from "./decoder/types.js";
export { WasmDecoder } from "./decoder/wasm.js";
export type { Front } from "./format/directory.js";
export { byView } from "./plan/by_view.js";
export type * from "./plan/types.js";
export { StreamError } from "./stream/errors.js";
export type { TransportId } from "./stream/errors.js";
export { ScarStream } from "./stream/scar_stream.js";
export type { EvictEvent, Progress, Stats, StreamEvents, StreamOptions, TileEvent } from "./stream/scar_stream.js";
export type { SourceLike } from "./stream/source.js";
