/** What the address of the page says: scenes, how they are shown, and the view behind #. */

import type { View } from "../src/viewer/viewer.js";

const NUMBERS = 10;

/** The view that the part of an address behind # names, null if none: position, target, up, degrees of field. */
export function namedView(hash: string): View | null {
  const said = new URLSearchParams(hash.replace(/^#/, "")).get("view");
  const numbers = (said ?? "").split(",").map((text) => (text.trim() === "" ? NaN : Number(text)));
  if (numbers.length !== NUMBERS || !numbers.every(Number.isFinite)) return null;
  const [px, py, pz, tx, ty, tz, ux, uy, uz, field] = numbers;
  if (!(field > 0 && field < 180) || Math.hypot(ux, uy, uz) === 0) return null;
  return { position: [px, py, pz], target: [tx, ty, tz], up: [ux, uy, uz], fovY: (field * Math.PI) / 180 };
}

/** The opposite, short enough for a message and exact enough for a picture. */
export function viewName({ position, target, up, fovY }: View): string {
  const numbers = [...position, ...target, ...up, (fovY * 180) / Math.PI];
  return `#view=${numbers.map((x) => Number(x.toPrecision(7))).join(",")}`;
}
