/** scar-stream: .scar scenes of 3D Gaussians in a page. */

export type * from "./decoder/types.js";
export type * from "./plan/types.js";

/** The decoder in JavaScript, which is loaded when it is first asked for. */
export async function createJsDecoder(): Promise<import("./decoder/types.js").TileDecoder> {
  const { createJsDecoder: create } = await import("./decoder/js.js");
  return create();
}
