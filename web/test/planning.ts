/** Questions to planners as JSON, the same that Python answers (tests/streaming/plan_cases.py). */

import { byView } from "../src/plan/by_view.js";
import type { Camera, SceneIndex } from "../src/plan/types.js";

export interface PlanCase {
  tiles: number;
  layers: number;
  boxes: number[];
  bytes: number[];
  counts: number[];
  modelBytes: number[];
  /** Base64. */
  annotation: string | null;
  camera: Camera | null;
  have: number[];
  /** [tile, layer] in order; of cases that are kept. */
  steps?: [number, number][];
}

export function answer(asked: PlanCase): [number, number][] {
  const index: SceneIndex = {
    tiles: asked.tiles,
    layers: asked.layers,
    slots: 1,
    boxes: Float64Array.from(asked.boxes),
    bytes: Float64Array.from(asked.bytes),
    counts: Uint32Array.from(asked.counts),
    modelBytes: Float64Array.from(asked.modelBytes),
  };
  const annotation = asked.annotation === null ? null : new Uint8Array(Buffer.from(asked.annotation, "base64"));
  const budgets = { splats: Infinity, bytes: Infinity };
  const steps = byView.plan(index, annotation, asked.camera, Uint8Array.from(asked.have), budgets);
  return steps.map(({ tile, layer }) => [tile, layer]);
}
