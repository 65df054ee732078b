/** A canvas and what is drawn in it: one scene, by Spark, with a mesh for each room. */

import type { SparkRenderer } from "@sparkjsdev/spark";
import * as THREE from "three";

import { makeSpark, ScarMesh, ScarSplats } from "../src/adapters/spark.js";
import type { PackedTile } from "../src/decoder/types.js";
import { RUN } from "../src/pack/places.js";
import type { Placement } from "../src/scene/placement.js";
import type { Room } from "./feed.js";

/** Beyond twice as many pixels as the page has, nobody sees a difference, and each costs. */
const MOST_PIXEL_RATIO = 2;
/** Of harmonics: shaders differ by it. */
const USUAL_DEGREE = 3;

export class Stage {
  readonly canvas = document.createElement("canvas");
  readonly #renderer: THREE.WebGLRenderer;
  readonly #spark: SparkRenderer;
  readonly #scene = new THREE.Scene();
  /** Called when all of a tile is on the GPU. */
  onWritten: (words: PackedTile) => void = () => undefined;
  /** Called when the GPU took the picture away and gave it back: everything has to be put again. */
  onLost: () => void = () => undefined;
  #rooms: Room[] = [];
  /** By room; made when something first comes for it. */
  #meshes: ScarMesh[] = [];
  #degree = USUAL_DEGREE;
  #lost = false;

  constructor() {
    this.#renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: false });
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, MOST_PIXEL_RATIO));
    this.#spark = makeSpark(this.#renderer);
    this.#scene.add(this.#spark);
    this.canvas.addEventListener("webglcontextlost", () => (this.#lost = true));
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.#lost = false;
      this.onLost();
    });
  }

  /** Makes room for a scene; what was there is gone. */
  open(rooms: Room[]): void {
    this.clear();
    this.#rooms = rooms;
  }

  /** Draws nothing once, so that shaders are there before a scene is. */
  prepare(): void {
    this.open([{ places: RUN, shDegree: USUAL_DEGREE, placement: null }]);
    this.#meshOf(0);
    this.draw(new THREE.PerspectiveCamera());
    this.clear();
  }

  put(room: number, key: number, words: PackedTile): void {
    this.#meshOf(room).source.put(words, key);
  }

  remove(room: number, key: number): void {
    this.#meshes[room]?.remove(key);
  }

  /** Draws harmonics up to a degree. */
  showDegree(degree: number): void {
    this.#degree = degree;
    this.#meshes.forEach((mesh) => mesh.showDegree(degree));
  }

  clear(): void {
    this.#meshes.forEach((mesh) => {
      this.#scene.remove(mesh.mesh);
      mesh.dispose();
    });
    this.#meshes = [];
  }

  #meshOf(room: number): ScarMesh {
    const found = this.#meshes[room];
    if (found !== undefined) return found;
    const { places, shDegree, placement } = this.#rooms[room];
    const source = new ScarSplats(this.#renderer, places, shDegree);
    source.onWritten = (words) => this.onWritten(words);
    const made = new ScarMesh(this.#spark, source);
    if (placement !== null) place(made.mesh, placement);
    made.showDegree(this.#degree);
    this.#meshes[room] = made;
    this.#scene.add(made.mesh);
    return made;
  }

  /** Gaussians that the last frame drew. */
  get active(): number {
    return this.#spark.activeSplats;
  }

  /** Draws a frame; true if another one is needed for what has come. */
  draw(camera: THREE.PerspectiveCamera): boolean {
    if (this.#lost) return false;
    const more = this.#meshes.map((mesh) => mesh.refresh()).includes(true);
    this.#resize();
    this.#renderer.render(this.#scene, camera);
    return more;
  }

  #resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    const size = this.#renderer.getSize(new THREE.Vector2());
    if (size.x !== clientWidth || size.y !== clientHeight) {
      this.#renderer.setSize(clientWidth, clientHeight, false);
    }
  }

  dispose(): void {
    this.clear();
    this.#renderer.dispose();
    this.canvas.remove();
  }
}

/** Puts a mesh where the index of a scene says (R-17-11). */
function place(mesh: THREE.Object3D, { scale, rotation, translation }: Placement): void {
  const [a, b, c, d, e, f, g, h, i] = rotation;
  const turn = new THREE.Matrix4().set(a, b, c, 0, d, e, f, 0, g, h, i, 0, 0, 0, 0, 1);
  mesh.quaternion.setFromRotationMatrix(turn);
  mesh.scale.setScalar(scale);
  mesh.position.set(...translation);
}
