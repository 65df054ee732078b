/** A canvas and what is drawn in it: one scene, by three.js and Spark, which are large and loaded after layer 1. */

import * as THREE from "three";

import { ScarScene } from "../adapters/three.js";
import type { PackedTile } from "../decoder/types.js";
import { nearestDrawn, verticalField, type View } from "../plan/framing.js";
import type { Feed } from "../stream/feed.js";
import { contextOf, pixelRatio } from "./sketch.js";

/** A picture ends at so many times where it begins. */
const FAR = 1e6;

export class Stage {
  readonly #renderer: THREE.WebGLRenderer;
  readonly #scene = new THREE.Scene();
  readonly #camera = new THREE.PerspectiveCamera();
  /** Where a headset is in the world; it moves the camera itself. */
  readonly #headset = new THREE.Group().add(this.#camera);
  #shown: ScarScene | null = null;
  #lost = false;

  /** @param onWritten called when all of a tile is on the GPU */
  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly onWritten: (words: PackedTile) => void,
  ) {
    this.#renderer = new THREE.WebGLRenderer({ canvas, context: contextOf(canvas) ?? undefined });
    this.#renderer.setPixelRatio(pixelRatio());
    this.#scene.add(this.#headset);
    canvas.addEventListener("webglcontextlost", () => (this.#lost = true));
    canvas.addEventListener("webglcontextrestored", () => (this.#lost = false));
  }

  /** Draws a scene in place of that shown. */
  show(feed: Feed): void {
    this.#shown?.dispose();
    this.#shown = new ScarScene(feed);
    this.#shown.onWritten = this.onWritten;
    this.#scene.add(this.#shown);
  }

  /** @param colour of CSS; "transparent" shows what lies behind the canvas */
  set background(colour: string) {
    const clear = colour === "transparent";
    this.#renderer.setClearColor(clear ? 0 : colour, clear ? 0 : 1);
  }

  /** Gaussians that the last frame drew. */
  get splatsDrawn(): number {
    return this.#shown?.splatsDrawn ?? 0;
  }

  /** Draws a frame; true if another one is needed for what has come. */
  draw(view: View): boolean {
    if (this.#lost || this.#renderer.xr.isPresenting) return false;
    const { clientWidth, clientHeight } = this.canvas;
    const size = this.#renderer.getSize(new THREE.Vector2());
    if (size.x !== clientWidth || size.y !== clientHeight) this.#renderer.setSize(clientWidth, clientHeight, false);
    this.#render(view, clientWidth, clientHeight);
    return this.#shown?.busy ?? false;
  }

  /** A picture of so many pixels of what is drawn now; the next `draw` goes back to the page's. */
  shoot(view: View, width: number, height: number, type: string): Promise<Blob> {
    const ratio = this.#renderer.getPixelRatio();
    this.#renderer.setPixelRatio(1);
    this.#renderer.setSize(width, height, false);
    this.#render(view, width, height);
    // Browsers take the picture before the next frame, whatever its size is then.
    const picture = new Promise<Blob>((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob === null ? reject(new Error(`no picture of type ${type}`)) : resolve(blob)), type);
    });
    this.#renderer.setPixelRatio(ratio);
    return picture;
  }

  /**
   * Shows the scene in a headset, which is upright where the eye is, until its wearer ends that. Rejects where there is none.
   * @param onEnd called when the page is to be drawn again
   */
  async enterXR({ position, target, up }: View, onEnd: () => void): Promise<void> {
    const session = await navigator.xr!.requestSession("immersive-vr");
    const { xr } = this.#renderer;
    xr.enabled = true;
    xr.setReferenceSpaceType("local");
    await xr.setSession(session);
    const axis = new THREE.Vector3(...up).normalize();
    const ahead = new THREE.Vector3(...target).sub(new THREE.Vector3(...position)).projectOnPlane(axis);
    this.#headset.position.set(...position);
    this.#headset.quaternion.setFromRotationMatrix(new THREE.Matrix4().lookAt(new THREE.Vector3(), ahead, axis));
    this.#renderer.setAnimationLoop(() => this.#renderer.render(this.#scene, this.#camera));
    session.addEventListener("end", () => {
      this.#renderer.setAnimationLoop(null);
      xr.enabled = false;
      this.#headset.position.set(0, 0, 0);
      this.#headset.quaternion.identity();
      onEnd();
    });
  }

  /** To be called where something else has drawn on the canvas. */
  reset(): void {
    this.#renderer.resetState();
  }

  #render(view: View, width: number, height: number): void {
    const camera = this.#camera;
    camera.position.set(...view.position);
    camera.up.set(...view.up);
    camera.lookAt(...view.target);
    camera.aspect = width / Math.max(height, 1);
    camera.fov = THREE.MathUtils.radToDeg(verticalField(view.fovY, width, height));
    camera.near = nearestDrawn(view);
    camera.far = FAR * camera.near;
    camera.updateProjectionMatrix();
    this.#renderer.render(this.#scene, camera);
  }

  dispose(): void {
    this.#shown?.dispose();
    this.#renderer.dispose();
  }
}
