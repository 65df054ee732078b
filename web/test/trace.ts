/** Tasks of a page's main thread, from what Chromium traces: how long, and how much of that the processor worked. */

interface TraceEvent {
  name: string;
  ph: string;
  pid: number;
  tid: number;
  /** Microseconds. */
  ts: number;
  dur?: number;
  /** Of the processor. */
  tdur?: number;
}

/** Shorter tasks are not told, milliseconds. */
const LEAST_MS = 8;

/**
 * @param trace JSON as Chromium writes it
 * @param mark name of a user timing mark of the page, made `at` milliseconds after it began
 * @returns [start, milliseconds, milliseconds of the processor] of each task; waiting for the GPU, or for another
 *   process to leave the processor, is in the second only
 */
export function longTasks(trace: Uint8Array, mark: string, at: number): [number, number, number][] {
  const { traceEvents } = JSON.parse(new TextDecoder().decode(trace)) as { traceEvents: TraceEvent[] };
  const marks = traceEvents.filter(({ name }) => name === mark);
  // The page may have been another one before it went to its address.
  const last = marks.at(-1);
  if (last === undefined) throw new Error(`the trace has no mark ${mark}`);
  const zero = last.ts - 1000 * at;
  return traceEvents
    .filter(({ name, ph, pid, tid }) => /RunTask$/.test(name) && ph === "X" && pid === last.pid && tid === last.tid)
    .map(({ ts, dur = 0, tdur = 0 }): [number, number, number] => [(ts - zero) / 1000, dur / 1000, tdur / 1000])
    .filter(([, wall]) => wall >= LEAST_MS);
}
