/** The camera and what moves it: turning round a point, and flying. */

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { type View, verticalField } from "../plan/framing.js";

/** Directions of flight, in the axes of the camera: right, up, back. */
const FLIGHT: Record<string, [number, number, number]> = {
  KeyW: [0, 0, -1],
  KeyS: [0, 0, 1],
  KeyA: [-1, 0, 0],
  KeyD: [1, 0, 0],
  KeyE: [0, 1, 0],
  KeyQ: [0, -1, 0],
};
/** Turns, in radians a second: azimuth and polar angle. */
const TURNS: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};
/** Lengths a second in flight, as a share of the distance to what is looked at; Shift: four times that. */
const SPEED = 0.6;
/** The frustum begins where INRIA's renderer begins, in world lengths; in small scenes at that share of the first distance. */
const NEAR = { length: 0.2, share: 0.1 };
/** It ends at so many times where it begins. */
const FAR = 1e6;
/** A smaller move of the camera, as a share of the distance to what is looked at or of its quaternion, is rounding. */
const ROUNDING = 1e-9;

export class Pilot {
  readonly camera = new THREE.PerspectiveCamera();
  /** Whether someone has moved since the last `place`. */
  moved = false;
  #controls: OrbitControls;
  readonly #held = new Set<string>();
  /** As a view has it. */
  #field = 1;
  #fast = false;
  #at = 0;

  /**
   * @param surface what is dragged on, and has the focus for keys
   * @param onMove called when a frame is needed
   */
  constructor(
    private readonly surface: HTMLElement,
    private readonly onMove: () => void,
  ) {
    this.#controls = this.#makeControls();
    surface.addEventListener("keydown", (event) => this.#press(event, true));
    surface.addEventListener("keyup", (event) => this.#press(event, false));
    surface.addEventListener("blur", () => this.#held.clear());
  }

  /** Goes to a view at once. */
  place({ position, target, up, fovY }: View): void {
    const turned = !this.camera.up.equals(new THREE.Vector3(...up));
    this.camera.up.set(...up);
    this.#field = fovY;
    this.moved = false;
    // OrbitControls takes the direction that is up when it is made.
    if (turned) {
      this.#controls.dispose();
      this.#controls = this.#makeControls();
    }
    this.#stop();
    this.camera.position.set(...position);
    this.#controls.target.set(...target);
    this.camera.near = Math.min(NEAR.length, NEAR.share * this.camera.position.distanceTo(this.#controls.target));
    this.camera.far = FAR * this.camera.near;
    this.#controls.update();
    this.onMove();
  }

  /** Turns slowly round what is looked at, until someone takes hold of it. */
  get autoRotate(): boolean {
    return this.#controls.autoRotate;
  }

  set autoRotate(turns: boolean) {
    this.#controls.autoRotate = turns;
    this.onMove();
  }

  /** Where the eye is now. */
  view(): View {
    const { position, up } = this.camera;
    const target = this.#controls.target.toArray();
    return { position: position.toArray(), target, up: up.toArray(), fovY: this.#field };
  }

  /** Fits the lens to a picture: one that is higher than wide has its field across, so that nothing is cut off. */
  fit(width: number, height: number): void {
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.fov = (verticalField(this.#field, width, height) * 180) / Math.PI;
    this.camera.updateProjectionMatrix();
  }

  /** Moves on; true while keys are held or a turn runs out. */
  advance(now: number): boolean {
    const seconds = Math.min(Math.max((now - this.#at) / 1000, 1e-3), 0.1);
    this.#at = now;
    const flies = this.#fly(seconds);
    const [position, quaternion] = [this.camera.position.clone(), this.camera.quaternion.clone()];
    const changed = this.#controls.update(seconds) || flies;
    if (!flies) this.#rest(position, quaternion);
    this.camera.updateMatrixWorld();
    return changed;
  }

  /** Undoes what is rounding of the controls alone: the renderer sorts anew for any other camera. */
  #rest(position: THREE.Vector3, quaternion: THREE.Quaternion): void {
    const distance = this.camera.position.distanceTo(this.#controls.target);
    if (this.camera.position.distanceTo(position) > ROUNDING * distance) return;
    // Not the angle between them: its cosine rounds to 1 from 1e-8 down.
    const turn = this.camera.quaternion.toArray().map((x, i) => Math.abs(x - quaternion.toArray()[i]));
    if (Math.max(...turn) > ROUNDING) return;
    this.camera.position.copy(position);
    this.camera.quaternion.copy(quaternion);
  }

  dispose(): void {
    this.#controls.dispose();
  }

  /** Ends what a turn has still to run out. */
  #stop(): void {
    this.#controls.enableDamping = false;
    this.#controls.update();
    this.#controls.enableDamping = true;
  }

  #makeControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.surface);
    controls.enableDamping = true;
    controls.dampingFactor = 0.15;
    controls.zoomToCursor = true;
    controls.addEventListener("change", this.onMove);
    controls.addEventListener("start", () => {
      this.moved = true;
      controls.autoRotate = false;
    });
    return controls;
  }

  #press(event: KeyboardEvent, down: boolean): void {
    this.#fast = event.shiftKey;
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.code in FLIGHT || event.code in TURNS)) return;
    event.preventDefault();
    this.moved = true;
    if (down) this.#held.add(event.code);
    else this.#held.delete(event.code);
    this.onMove();
  }

  #fly(seconds: number): boolean {
    const step = new THREE.Vector3();
    const spherical = new THREE.Vector2();
    for (const code of this.#held) {
      if (code in FLIGHT) step.add(new THREE.Vector3(...FLIGHT[code]));
      if (code in TURNS) spherical.add(new THREE.Vector2(...TURNS[code]));
    }
    if (step.lengthSq() + spherical.lengthSq() === 0) return false;
    const reach = this.camera.position.distanceTo(this.#controls.target);
    step.applyQuaternion(this.camera.quaternion).multiplyScalar(SPEED * reach * seconds * (this.#fast ? 4 : 1));
    this.camera.position.add(step);
    this.#controls.target.add(step);
    this.#turn(spherical.multiplyScalar(seconds));
    return true;
  }

  /** Turns the eye round what it looks at. */
  #turn({ x, y }: THREE.Vector2): void {
    if (x === 0 && y === 0) return;
    const { target } = this.#controls;
    const arm = this.camera.position.clone().sub(target);
    arm.applyAxisAngle(this.camera.up, x);
    const right = new THREE.Vector3().crossVectors(this.camera.up, arm).normalize();
    const polar = arm.angleTo(this.camera.up);
    arm.applyAxisAngle(right, -Math.min(Math.max(y, polar - Math.PI + 0.05), polar - 0.05));
    this.camera.position.copy(target).add(arm);
  }
}
