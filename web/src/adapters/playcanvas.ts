/**
 * Scenes as assets of PlayCanvas: `app.loader.getHandler("gsplat").addParser(new ScarParser(app))`, then an asset of
 * type gsplat whose URL ends in .scar. It is loaded when its front is read, draws after the first layer, and becomes finer.
 */

import type { AppBase, Asset } from "playcanvas";

import { ScarStream, type StreamOptions } from "../stream/scar_stream.js";
import { ScarResource } from "./playcanvas/resource.js";

export { drawAsTrained } from "./playcanvas/look.js";
export { ScarResource, viewOf } from "./playcanvas/resource.js";
export { ScarSplats } from "./playcanvas/splats.js";

/** Of PlayCanvas, which does not export its name. */
type Loaded = (error: string | null, resource?: ScarResource) => void;

export class ScarParser {
  /** @param options of each stream; what it delivers is for the parser to say */
  constructor(
    private readonly app: AppBase,
    private readonly options: Omit<StreamOptions, "output"> = {},
  ) {}

  canParse({ ext }: { ext: string }): boolean {
    return ext === "scar";
  }

  /**
   * The asset fires "progress" with bytes read and bytes of the file, and "error" for what fails after it was loaded;
   * what is shown stays then. `asset.resource` is a `ScarResource`, whose `stream` tells more.
   */
  load(url: string | { load: string; original: string }, callback: Loaded, asset?: Asset): void {
    const stream = new ScarStream(typeof url === "string" ? url : url.load, { ...this.options, output: "words" });
    let loaded = false;
    stream.on("front", (front) => {
      try {
        const resource = new ScarResource(this.app, stream, front, this.options.budgets);
        loaded = true;
        callback(null, resource);
      } catch (error) {
        stream.close();
        callback(String(error));
      }
    });
    stream.on("progress", ({ bytesRead, bytes }) => asset?.fire("progress", bytesRead, bytes));
    stream.on("error", (error) => {
      if (loaded) asset?.fire("error", error, asset);
      else callback(error.message);
    });
  }

  open(_url: string, resource: ScarResource): ScarResource {
    return resource;
  }
}
