/** What moves the eye: dragging, a wheel, two fingers, keys. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import type { View } from "../src/plan/framing.js";
import { add, cross, dot, length, unit } from "../src/plan/vectors.js";
import { Pilot } from "../src/viewer/pilot.js";

const SIZE = { clientWidth: 400, clientHeight: 200 };
const VIEW: View = { position: [0, 0, -4], target: [0, 0, 0], up: [0, -1, 0], fovY: 1 };
const CLOSE = 1e-9;

/** A pilot at the view, and what tells its surface something. */
function piloted() {
  const surface = Object.assign(new EventTarget(), SIZE, { setPointerCapture: () => undefined });
  const pilot = new Pilot(surface as unknown as HTMLElement, () => undefined);
  pilot.place(VIEW);
  let now = 1000;
  return {
    pilot,
    tell: (name: string, facts: object) => void surface.dispatchEvent(Object.assign(new Event(name), facts)),
    settle: () => {
      for (let frames = 0; pilot.advance((now += 16)); frames++) assert.ok(frames < 1000, "it does not come to rest");
    },
  };
}

const at = (offsetX: number, offsetY: number, pointerId = 1, button = 0) => ({ offsetX, offsetY, pointerId, button });
const distance = ({ position, target }: View) => length(add(position, target, -1));

/** Where in the picture a place of the world is, of half its height: to the right and upwards. */
function seen({ position, target, up, fovY }: View, place: View["target"]): number[] {
  const forward = unit(add(target, position, -1));
  const right = unit(cross(forward, up));
  const away = add(place, position, -1);
  return [right, cross(right, forward)].map((axis) => dot(away, axis) / dot(away, forward) / Math.tan(fovY / 2));
}

describe("a pilot", () => {
  it("turns round what is looked at, as far as it was dragged, and never over the top", () => {
    const { pilot, tell, settle } = piloted();
    tell("pointerdown", at(100, 100));
    tell("pointermove", at(150, 100));
    settle();
    // A quarter of the height: the scene follows the pointer to the right.
    assert.ok(length(add(pilot.view.position, [-4, 0, 0], -1)) < CLOSE, String(pilot.view.position));
    tell("pointermove", at(150, 5000));
    settle();
    assert.ok(dot(unit(pilot.view.position), VIEW.up) > 0.99 && Math.abs(distance(pilot.view) - 4) < CLOSE);
  });

  it("moves with the other button what is looked at along with the pointer", () => {
    const { pilot, tell, settle } = piloted();
    tell("pointerdown", at(100, 100, 1, 2));
    tell("pointermove", at(150, 80, 1, 2));
    settle();
    const [right, up] = seen(pilot.view, VIEW.target);
    assert.ok(Math.abs(right - 0.5) < CLOSE && Math.abs(up - 0.2) < CLOSE);
  });

  it("comes nearer to what lies under the pointer", () => {
    const { pilot, tell, settle } = piloted();
    const place: View["target"] = [0.7, 0.4, 0];
    const [right, up] = seen(VIEW, place);
    tell("wheel", { ...at(200 + 100 * right, 100 - 100 * up), deltaY: -700, deltaMode: 0 });
    settle();
    assert.ok(Math.abs(distance(pilot.view) - 4 * Math.exp(-0.7)) < CLOSE);
    seen(pilot.view, place).forEach((x, axis) => assert.ok(Math.abs(x - [right, up][axis]) < CLOSE));
  });

  it("comes nearer as two fingers move apart", () => {
    const { pilot, tell, settle } = piloted();
    tell("pointerdown", at(190, 100, 1));
    tell("pointerdown", at(210, 100, 2));
    tell("pointermove", at(180, 100, 1));
    tell("pointermove", at(220, 100, 2));
    settle();
    assert.ok(Math.abs(distance(pilot.view) - 2) < CLOSE);
  });

  it("flies while a key is held", () => {
    const { pilot, tell, settle } = piloted();
    tell("keydown", { code: "KeyW" });
    for (let now = 0; now < 2000; now += 16) assert.equal(pilot.advance(now), true);
    tell("keyup", { code: "KeyW" });
    settle();
    assert.ok(pilot.view.position[2] > -3.5 && Math.abs(distance(pilot.view) - 4) < CLOSE);
  });
});
