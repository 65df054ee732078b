/**
 * A scene as an object of three.js, drawn by Spark: `scene.add(new ScarLoader().load("scene.scar"))`. It streams for the
 * camera that the scene is rendered with.
 */

import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
import * as THREE from "three";

import type { PackedTile } from "../decoder/types.js";
import type { Front } from "../format/directory.js";
import { placesFor } from "../pack/places.js";
import { verticalField } from "../plan/framing.js";
import type { Budgets, Camera } from "../plan/types.js";
import { Feed, type FeedOptions } from "../stream/feed.js";
import type { SourceLike } from "../stream/source.js";
import { drawModel, makeSpark, ScarSplats } from "./spark.js";

export class ScarScene extends THREE.Group {
  /** Whether another frame is needed for what has come. */
  busy = true;
  /** Called when all of a tile is on the GPU. */
  onWritten: (words: PackedTile) => void = () => undefined;
  /** What tells of the scene, and is told how much of it is wanted. */
  readonly feed: Feed;
  #renderer: THREE.WebGLRenderer | null = null;
  #spark: SparkRenderer | null = null;
  #drawn: { mesh: SplatMesh; splats: ScarSplats } | null = null;
  /** Whether the mesh lacks what its textures have. */
  #stale = false;
  readonly #restart = () => this.feed.restart();

  constructor(source: SourceLike | Feed, options: FeedOptions = {}) {
    super();
    this.feed = source instanceof Feed ? source : new Feed(source, options);
    this.add(this.#makeHook());
  }

  /** Puts a camera where the scene is looked at from first. @returns what it looks at; null before the front is read */
  placeCamera(camera: THREE.PerspectiveCamera): THREE.Vector3 | null {
    const view = this.feed.opening;
    if (view === null) return null;
    this.updateWorldMatrix(true, false);
    const target = this.localToWorld(new THREE.Vector3(...view.target));
    camera.position.copy(this.localToWorld(new THREE.Vector3(...view.position)));
    camera.up.set(...view.up).transformDirection(this.matrixWorld);
    camera.fov = THREE.MathUtils.radToDeg(verticalField(view.fovY, camera.aspect, 1));
    camera.updateProjectionMatrix();
    camera.lookAt(target);
    return target;
  }

  /** Gaussians that the last frame drew. */
  get splatsDrawn(): number {
    return this.#spark?.activeSplats ?? 0;
  }

  override dispose(): void {
    this.feed.close();
    this.#renderer?.domElement.removeEventListener("webglcontextrestored", this.#restart);
    this.#clear();
    this.removeFromParent();
  }

  /** Draws nothing, before all else of a frame: three.js tells it what is rendered, and for whom. */
  #makeHook(): THREE.Mesh {
    const hook = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial());
    hook.frustumCulled = false;
    hook.renderOrder = -Infinity;
    hook.onBeforeRender = (renderer, scene, camera) => this.#update(renderer, scene, camera);
    return hook;
  }

  #update(renderer: THREE.WebGLRenderer, scene: THREE.Object3D, camera: THREE.Camera): void {
    if (this.#renderer === null) this.#begin(renderer, scene);
    this.feed.look(this.#viewOf(renderer, camera));
    this.busy = this.#refresh();
  }

  /** Uploads what has come; true while something is still to be drawn. */
  #refresh(): boolean {
    const [drawn, spark] = [this.#drawn, this.#spark];
    if (drawn === null || spark === null) return false;
    this.#stale = drawn.splats.upload() || this.#stale;
    // A new version is lost on Spark while it sorts the last one.
    const marks = this.#stale && !spark.sorting;
    if (marks) {
      drawn.mesh.updateVersion();
      this.#stale = false;
    }
    return marks || this.#stale || drawn.splats.waiting || spark.sorting;
  }

  #begin(renderer: THREE.WebGLRenderer, scene: THREE.Object3D): void {
    this.#renderer = renderer;
    // What the GPU took away comes anew: no copy is kept.
    renderer.domElement.addEventListener("webglcontextrestored", this.#restart);
    const spark = sparkOf(renderer, scene);
    this.#spark = spark;
    this.feed.drawOn({
      open: (front, budgets) => this.#open(renderer, spark, front, budgets),
      put: (words) => this.#drawn?.splats.put(words),
      remove: (tile) => {
        this.#drawn?.splats.clear(tile);
        this.#stale = true;
      },
    });
  }

  #open(renderer: THREE.WebGLRenderer, spark: SparkRenderer, front: Front, budgets: Budgets): void {
    this.#clear();
    drawModel(spark, front.header.render_model);
    const splats = new ScarSplats(renderer, placesFor(front, budgets), front.header.sh_degree);
    splats.onWritten = (words) => this.onWritten(words);
    this.#drawn = { mesh: new SplatMesh({ splats, raycastable: false, enableLod: false }), splats };
    this.add(this.#drawn.mesh);
  }

  #clear(): void {
    if (this.#drawn === null) return;
    this.remove(this.#drawn.mesh);
    this.#drawn.mesh.dispose();
    this.#drawn.splats.dispose();
    this.#drawn = null;
  }

  /** Where a camera is among the Gaussians. */
  #viewOf(renderer: THREE.WebGLRenderer, camera: THREE.Camera): Camera {
    const place = this.matrixWorld.clone().invert().multiply(camera.matrixWorld);
    const axis = (column: number) => new THREE.Vector3().setFromMatrixColumn(place, column).normalize();
    const { x: width, y: height } = renderer.getSize(new THREE.Vector2());
    return {
      position: new THREE.Vector3().setFromMatrixPosition(place).toArray(),
      forward: axis(2).negate().toArray(),
      up: axis(1).toArray(),
      fovY: 2 * Math.atan(1 / camera.projectionMatrix.elements[5]),
      width,
      height,
    };
  }
}

/** Spark of a scene: its own, or one that draws as scenes were trained to look like. */
function sparkOf(renderer: THREE.WebGLRenderer, scene: THREE.Object3D): SparkRenderer {
  const found = scene.getObjectsByProperty("type", "Mesh").find((object) => object instanceof SparkRenderer);
  const spark = (found as SparkRenderer | undefined) ?? makeSpark(renderer);
  if (found === undefined) scene.add(spark);
  return spark;
}

/** Loads as loaders of three.js do. `load` returns the scene at once; `onLoad` has it when its front is read. */
export class ScarLoader extends THREE.Loader<ScarScene> {
  constructor(
    manager?: THREE.LoadingManager,
    readonly options: FeedOptions = {},
  ) {
    super(manager);
  }

  override load(
    url: string,
    onLoad?: (scene: ScarScene) => void,
    onProgress?: (event: ProgressEvent) => void,
    onError?: (error: unknown) => void,
  ): ScarScene {
    const credentials = this.withCredentials ? "include" : "same-origin";
    const scene = new ScarScene(this.manager.resolveURL(this.path + url), {
      headers: this.requestHeader,
      credentials,
      ...this.options,
    });
    this.manager.itemStart(url);
    const off = scene.feed.on("error", (error) => {
      onError?.(error);
      this.manager.itemError(url);
      this.manager.itemEnd(url);
    });
    scene.feed.on("front", () => {
      off();
      onLoad?.(scene);
      this.manager.itemEnd(url);
    });
    scene.feed.on("change", () => {
      const { bytesRead: loaded, bytes: total } = scene.feed.stats();
      onProgress?.(new ProgressEvent("progress", { lengthComputable: true, loaded, total }));
    });
    return scene;
  }
}
