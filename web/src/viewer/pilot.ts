/**
 * Where the eye is, and what moves it: turning round a point, moving, coming nearer, flying. It needs no library, so that
 * one can look round before what draws all layers has come.
 */

import type { Point } from "../decoder/types.js";
import { cameraOf, type View } from "../plan/framing.js";
import { add, cross, dot, length, turn, unit, upright } from "../plan/vectors.js";

/**
 * Round what is looked at, radians; along right, up and back of the camera, in distances to what is looked at; nearer, as
 * the natural logarithm of the distance.
 */
type Motion = [azimuth: number, polar: number, right: number, up: number, back: number, nearer: number];

/** Speed of flight. */
const SPEED = 0.6;
/** What keys do in a second, with Shift so many times that. */
const KEYS: Record<string, Motion> = {
  ArrowLeft: [-1, 0, 0, 0, 0, 0],
  ArrowRight: [1, 0, 0, 0, 0, 0],
  ArrowUp: [0, 1, 0, 0, 0, 0],
  ArrowDown: [0, -1, 0, 0, 0, 0],
  KeyA: [0, 0, -SPEED, 0, 0, 0],
  KeyD: [0, 0, SPEED, 0, 0, 0],
  KeyE: [0, 0, 0, SPEED, 0, 0],
  KeyQ: [0, 0, 0, -SPEED, 0, 0],
  KeyW: [0, 0, 0, 0, -SPEED, 0],
  KeyS: [0, 0, 0, 0, SPEED, 0],
};
const FAST = 4;
/** Once round in half a minute. */
const AUTO_ROTATION: Motion = [(2 * Math.PI) / 30, 0, 0, 0, 0, 0];
/** A drag over the height of the picture turns once round. */
const DRAG = 2 * Math.PI;
/** Of a pixel of a wheel; fingers on a touchpad that move apart are told as a wheel with Ctrl, in smaller steps. */
const WHEEL = 1e-3;
const PINCH = 1e-2;
/** Pixels of a step of a wheel, by `deltaMode`. */
const STEPS = [1, 16, 400];
/** What is left of a motion after so many seconds is 1/e, and nothing where that is below what one sees. */
const RUN_OUT = 0.08;
const UNSEEN = 1e-4;
/** How near the eye comes to the line through what is looked at that is up, radians. */
const LEAST_POLAR = 0.02;
/** Longest step between two frames, seconds. */
const LONGEST = 0.1;

const STILL: Motion = [0, 0, 0, 0, 0, 0];
const START: View = { position: [0, 0, -1], target: [0, 0, 0], up: [0, -1, 0], fovY: 1 };

export class Pilot {
  /** Whether someone has moved since the last `place`. */
  moved = false;
  #view = START;
  #turning = false;
  /** What is still to be moved. */
  #rest = STILL;
  readonly #held = new Set<string>();
  #fast = false;
  #at = 0;
  /** Pointers that are down, by number: where they are. */
  readonly #pointers = new Map<number, [x: number, y: number]>();
  /** Whether one pointer turns, and does not move. */
  #turns = true;
  /** Towards what the eye comes nearer: slopes of the line of sight through it, to the right and upwards. */
  #towards: [number, number] = [0, 0];

  /**
   * @param surface what is dragged on, and has the focus for keys
   * @param onMove called when a frame is needed
   */
  constructor(
    private readonly surface: HTMLElement,
    private readonly onMove: () => void,
  ) {
    surface.addEventListener("pointerdown", (event) => this.#press(event));
    surface.addEventListener("pointermove", (event) => this.#drag(event));
    for (const end of ["pointerup", "pointercancel"] as const) {
      surface.addEventListener(end, ({ pointerId }) => this.#pointers.delete(pointerId));
    }
    surface.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    surface.addEventListener("keydown", (event) => this.#key(event, true));
    surface.addEventListener("keyup", (event) => this.#key(event, false));
    surface.addEventListener("blur", () => this.#held.clear());
  }

  /** Where the eye is now. */
  get view(): View {
    return this.#view;
  }

  /** Goes to a view at once. */
  place(view: View): void {
    this.#view = view;
    this.#rest = STILL;
    this.moved = false;
    this.onMove();
  }

  /** Turns slowly round what is looked at, until someone takes hold of it. */
  get autoRotate(): boolean {
    return this.#turning;
  }

  set autoRotate(turning: boolean) {
    this.#turning = turning;
    this.onMove();
  }

  /** Moves on; true while keys are held or a motion runs out. @param now milliseconds */
  advance(now: number): boolean {
    const seconds = Math.min(Math.max((now - this.#at) / 1000, 0), LONGEST);
    this.#at = now;
    for (const code of this.#held) this.#add(KEYS[code], seconds * (this.#fast ? FAST : 1));
    if (this.#turning) this.#move(times(AUTO_ROTATION, seconds));
    const runsOut = this.#rest.some((x) => x !== 0);
    if (runsOut) {
      const unseen = this.#rest.every((x) => Math.abs(x) < UNSEEN);
      const part = times(this.#rest, unseen ? 1 : 1 - Math.exp(-seconds / RUN_OUT));
      this.#rest = plus(this.#rest, times(part, -1));
      this.#move(part);
    }
    return runsOut || this.#turning || this.#held.size > 0;
  }

  #add(motion: Motion, scale = 1): void {
    this.#rest = plus(this.#rest, times(motion, scale));
  }

  #move([azimuth, polar, right, up, back, nearer]: Motion): void {
    const { position, target } = this.#view;
    const arm = this.#turned(add(position, target, -1), azimuth, polar);
    const distance = length(arm);
    const { forward, up: upward } = cameraOf({ ...this.#view, position: add(target, arm) }, 1, 1);
    const across = cross(forward, upward);
    const shift = add(add(add([0, 0, 0], across, right), upward, up), forward, -back);
    // What lies under the pointer stays there, as far away as what is looked at.
    const scale = Math.exp(-nearer);
    const aside = add(add([0, 0, 0], across, this.#towards[0]), upward, this.#towards[1]);
    const middle = add(add(target, shift, distance), aside, (1 - scale) * distance);
    this.#view = { ...this.#view, target: middle, position: add(middle, arm, scale) };
  }

  /** Turns the arm from what is looked at to the eye. */
  #turned(arm: Point, azimuth: number, polar: number): Point {
    const up = unit(this.#view.up);
    const level = turn(arm, up, azimuth);
    if (polar === 0) return level;
    const aside = upright(up, level);
    const angle = Math.atan2(length(cross(up, level)), dot(up, level));
    const most = angle - LEAST_POLAR;
    return turn(level, aside, -Math.min(Math.max(polar, most - Math.PI + 2 * LEAST_POLAR), most));
  }

  #takeHold(): void {
    this.moved = true;
    this.#turning = false;
    this.onMove();
  }

  #press({ pointerId, offsetX, offsetY, button, shiftKey, ctrlKey, metaKey }: PointerEvent): void {
    this.surface.setPointerCapture(pointerId);
    this.#pointers.set(pointerId, [offsetX, offsetY]);
    this.#turns = button === 0 && !shiftKey && !ctrlKey && !metaKey;
    this.#takeHold();
  }

  #drag({ pointerId, offsetX, offsetY }: PointerEvent): void {
    if (!this.#pointers.has(pointerId)) return;
    const before = grip([...this.#pointers.values()]);
    this.#pointers.set(pointerId, [offsetX, offsetY]);
    const now = grip([...this.#pointers.values()]);
    const { clientWidth: width, clientHeight: height } = this.surface;
    const [x, y] = [now.x - before.x, now.y - before.y].map((pixels) => pixels / height);
    const seen = 2 * Math.tan(cameraOf(this.#view, width, height).fovY / 2);
    if (this.#pointers.size === 1 && this.#turns) this.#add([-DRAG * x, DRAG * y, 0, 0, 0, 0]);
    else this.#add([0, 0, -seen * x, seen * y, 0, 0]);
    if (before.spread > 0 && now.spread > 0) {
      this.#point(now.x, now.y);
      this.#add([0, 0, 0, 0, 0, Math.log(now.spread / before.spread)]);
    }
    this.#takeHold();
  }

  #wheel(event: WheelEvent): void {
    event.preventDefault();
    this.#point(event.offsetX, event.offsetY);
    this.#add([0, 0, 0, 0, 0, -event.deltaY * STEPS[event.deltaMode] * (event.ctrlKey ? PINCH : WHEEL)]);
    this.#takeHold();
  }

  /** Says towards what the eye comes nearer: a pixel of the surface. */
  #point(x: number, y: number): void {
    const { clientWidth: width, clientHeight: height } = this.surface;
    const slope = Math.tan(cameraOf(this.#view, width, height).fovY / 2) / (height / 2);
    this.#towards = [slope * (x - width / 2), slope * (height / 2 - y)];
  }

  #key(event: KeyboardEvent, down: boolean): void {
    this.#fast = event.shiftKey;
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.code in KEYS)) return;
    event.preventDefault();
    if (down) this.#held.add(event.code);
    else this.#held.delete(event.code);
    this.#takeHold();
  }
}

function plus(a: Motion, b: Motion): Motion {
  return a.map((x, i) => x + b[i]) as Motion;
}

function times(motion: Motion, scale: number): Motion {
  return motion.map((x) => x * scale) as Motion;
}

/** The middle of some places, and how far two of them are apart; 0 of one. */
function grip(places: [x: number, y: number][]): { x: number; y: number; spread: number } {
  const middle = (axis: number) => places.reduce((sum, place) => sum + place[axis], 0) / places.length;
  const [[x, y], [otherX, otherY] = [x, y]] = places;
  return { x: middle(0), y: middle(1), spread: Math.hypot(x - otherX, y - otherY) };
}
