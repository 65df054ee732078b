/** A canvas and what is drawn in it: one scene, by Spark. */

import type { SparkRenderer } from "@sparkjsdev/spark";
import * as THREE from "three";

import { drawModel, makeSpark, ScarMesh, ScarSplats } from "../src/adapters/spark.js";
import type { PackedTile } from "../src/decoder/types.js";
import { RUN } from "../src/pack/places.js";

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
  /** Null until something is to be drawn. */
  #mesh: ScarMesh | null = null;
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

  /** Makes room for a scene; what was there is gone. @param places for Gaussians, a multiple of 256 @param renderModel of the header */
  open(places: number, shDegree: number, renderModel = 0): void {
    this.clear();
    drawModel(this.#spark, renderModel);
    const source = new ScarSplats(this.#renderer, places, shDegree);
    source.onWritten = (words) => this.onWritten(words);
    this.#mesh = new ScarMesh(this.#spark, source);
    this.#mesh.showDegree(this.#degree);
    this.#scene.add(this.#mesh.mesh);
  }

  /** Draws nothing once, so that shaders are there before a scene is. */
  prepare(): void {
    this.open(RUN, USUAL_DEGREE);
    this.draw(new THREE.PerspectiveCamera());
    this.clear();
  }

  put(words: PackedTile): void {
    this.#mesh?.source.put(words);
  }

  remove(tile: number): void {
    this.#mesh?.remove(tile);
  }

  /** Draws harmonics up to a degree. */
  showDegree(degree: number): void {
    this.#degree = degree;
    this.#mesh?.showDegree(degree);
  }

  clear(): void {
    if (this.#mesh === null) return;
    this.#scene.remove(this.#mesh.mesh);
    this.#mesh.dispose();
    this.#mesh = null;
  }

  /** Gaussians that the last frame drew. */
  get active(): number {
    return this.#spark.activeSplats;
  }

  /** Draws a frame; true if another one is needed for what has come. */
  draw(camera: THREE.PerspectiveCamera): boolean {
    if (this.#lost) return false;
    const more = this.#mesh?.refresh() ?? false;
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
