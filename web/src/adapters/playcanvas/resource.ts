/** A scene that arrives while PlayCanvas draws it. */

import {
  type AppBase,
  type CameraComponent,
  type GraphNode,
  type GSplatComponent,
  type Vec3,
  WORKBUFFER_UPDATE_ONCE,
} from "playcanvas";

import type { PackedTile } from "../../decoder/types.js";
import type { Camera } from "../../plan/types.js";
import type { Front } from "../../stream/front.js";
import type { ScarStream } from "../../stream/scar_stream.js";
import { ScarSplats } from "./splats.js";

/** Between two looks at the camera, and two uploads: each has all splats copied and sorted. */
const EVERY_MS = 100;

/**
 * What a stream brings, drawn by the components of type gsplat that have it: uploads, eviction, and the view of the
 * first camera. `destroy` closes the stream.
 */
export class ScarResource extends ScarSplats {
  /** The camera whose view decides what is fetched; the first of the app where null. */
  camera: CameraComponent | null = null;
  readonly #off: (() => void)[];
  #at = -Infinity;
  #told: Camera | null = null;

  /**
   * @param stream made with `output: "words"`; no tile of it has come yet
   * @param front what its event "front" has
   */
  constructor(
    private readonly app: AppBase,
    readonly stream: ScarStream,
    front: Front,
  ) {
    super(app.graphicsDevice, front);
    const update = app.on("update", () => this.#update());
    const end = app.once("destroy", () => this.destroy());
    this.#off = [
      stream.on("tile", ({ base, output }) => this.put(base, output as PackedTile)),
      stream.on("evict", ({ tile }) => this.clear(tile)),
      () => update.off(),
      () => end.off(),
    ];
  }

  override destroy(): void {
    this.stream.close();
    for (const off of this.#off.splice(0)) off();
    super.destroy();
  }

  #update(): void {
    const now = performance.now();
    if (now < this.#at + EVERY_MS) return;
    const seconds = (now - this.#at) / 1000;
    this.#at = now;
    const all = this.app.root.findComponents("gsplat") as GSplatComponent[];
    const shown = all.filter(({ resource }) => resource === this);
    if (shown.length > 0) this.#look(shown[0].entity, seconds);
    if (!this.flush()) return;
    for (const component of shown) component.workBufferUpdate = WORKBUFFER_UPDATE_ONCE;
    this.app.renderNextFrame = true;
  }

  /** Tells the stream where the camera is, if that has changed. */
  #look(entity: GraphNode, seconds: number): void {
    const camera = this.camera ?? this.app.systems.camera?.cameras[0];
    if (!camera) return;
    const { width, height } = this.app.graphicsDevice;
    const view = viewOf(camera, entity, width, height);
    const before = this.#told?.position ?? view.position;
    const velocity = view.position.map((x, axis) => (x - before[axis]) / seconds) as Camera["velocity"];
    const told = { ...view, velocity };
    if (JSON.stringify(told) === JSON.stringify(this.#told)) return;
    this.#told = told;
    this.stream.setView(told);
  }
}

/** Where a camera is among the Gaussians of an entity, for `ScarStream.setView`. */
export function viewOf(camera: CameraComponent, entity: GraphNode, width: number, height: number): Camera {
  const place = entity.getWorldTransform().clone().invert().mul(camera.entity.getWorldTransform());
  return {
    position: numbers(place.getTranslation()),
    forward: numbers(place.getZ().normalize().mulScalar(-1)),
    up: numbers(place.getY().normalize()),
    fovY: 2 * Math.atan(1 / camera.projectionMatrix.data[5]),
    width: width * camera.rect.z,
    height: height * camera.rect.w,
  };
}

function numbers({ x, y, z }: Vec3): [number, number, number] {
  return [x, y, z];
}
