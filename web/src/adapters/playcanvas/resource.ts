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
import { placesFor } from "../../pack/places.js";
import type { Budgets, Camera } from "../../plan/types.js";
import type { Front } from "../../format/directory.js";
import { Looking } from "../../stream/looking.js";
import type { ScarStream } from "../../stream/scar_stream.js";
import { ScarSplats } from "./splats.js";

/** Between two looks at the camera, and two uploads: each has all splats sorted and copied. */
const EVERY_MS = 100;
/** What came is copied after so long even where other scenes of the app keep the sorter busy, and again until it rests. */
const PATIENCE_MS = 1000;

/** Of `header.render_model`: Gaussians were trained to be made fainter where they are widened (Mip-Splatting). */
const ANTIALIASED = 1;

/**
 * What a stream brings, drawn by the components of type gsplat that have it: uploads, eviction, and the view of the
 * first camera. `destroy` closes the stream.
 */
export class ScarResource extends ScarSplats {
  /** The camera whose view decides what is fetched; the first of the app where null. */
  camera: CameraComponent | null = null;
  readonly #off: (() => void)[];
  readonly #looking = new Looking((view) => this.stream.setView(view));
  #lookedAt = -Infinity;
  #uploadedAt = -Infinity;
  /** Since when something that was uploaded is to be copied, null where nothing is. */
  #waitsSince: number | null = null;
  /** Of each camera that drew the last frame: whether by the newest order. */
  #sorted: boolean[] = [];

  /**
   * @param stream made with `output: "words"`; no tile of it has come yet
   * @param front what its event "front" has
   * @param budgets as the stream has them
   */
  constructor(
    private readonly app: AppBase,
    readonly stream: ScarStream,
    front: Front,
    budgets: Partial<Budgets> = {},
  ) {
    super(app.graphicsDevice, front, placesFor(front, budgets));
    // All splats of an app are drawn alike: the scene that came last decides.
    app.scene.gsplat.antiAlias = front.header.render_model === ANTIALIASED;
    const update = app.on("update", () => this.#update());
    const end = app.once("destroy", () => this.destroy());
    const ready = app.systems.gsplat?.on("frame:ready", (_camera: unknown, _layer: unknown, isReady: boolean) => {
      this.#sorted.push(isReady);
    });
    this.#off = [
      stream.on("tile", ({ output }) => this.put(output as PackedTile)),
      stream.on("evict", ({ tile }) => this.clear(tile)),
      () => update.off(),
      () => end.off(),
      () => ready?.off(),
    ];
  }

  override get waiting(): boolean {
    return super.waiting || this.#waitsSince !== null;
  }

  override destroy(): void {
    this.stream.close();
    for (const off of this.#off.splice(0)) off();
    super.destroy();
  }

  #update(): void {
    const now = performance.now();
    if (now >= this.#lookedAt + EVERY_MS) this.#look(now);
    if (!this.#copied(now) || now < this.#uploadedAt + EVERY_MS || !this.flush()) return;
    this.#uploadedAt = now;
    this.#waitsSince = now;
    this.app.renderNextFrame = true;
  }

  /**
   * Has what was uploaded copied to where PlayCanvas draws from, once it is sorted: so nothing is drawn in a wrong order,
   * and nothing is lost, since PlayCanvas forgets that it was to copy when a new order arrives.
   * @returns whether there is room for more
   */
  #copied(now: number): boolean {
    const sorted = this.#sorted.length > 0 && !this.#sorted.includes(false);
    this.#sorted = [];
    if (this.#waitsSince === null) return true;
    if (!sorted && now < this.#waitsSince + PATIENCE_MS) return false;
    for (const component of this.#components()) component.workBufferUpdate = WORKBUFFER_UPDATE_ONCE;
    this.#waitsSince = sorted ? null : now;
    this.app.renderNextFrame = true;
    return true;
  }

  /** Those that draw this. */
  #components(): GSplatComponent[] {
    const all = this.app.root.findComponents("gsplat") as GSplatComponent[];
    return all.filter(({ resource }) => resource === this);
  }

  /** Tells the stream where the camera is, if that has changed. */
  #look(now: number): void {
    this.#lookedAt = now;
    const [component] = this.#components();
    const camera = this.camera ?? this.app.systems.camera?.cameras[0];
    if (component === undefined || !camera) return;
    const { width, height } = this.app.graphicsDevice;
    this.#looking.look(viewOf(camera, component.entity, width, height));
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
