/** What can go wrong between a file and the screen. */

/** Failures of transport; other ids are refusals of SPEC §12.1. */
export type TransportId =
  "network" | "http-status" | "stalled" | "cut" | "no-range" | "encoded" | "file-changed" | "bad-source" | "worker";

export interface ErrorPlace {
  /** URL or name of the source. */
  source?: string;
  /** Byte of the file. */
  offset?: number | null;
  tile?: number;
  layer?: number;
  /** HTTP status. */
  status?: number;
  cause?: unknown;
}

/** An error of a stream: what, where, and by which rule. */
export class StreamError extends Error {
  override readonly name = "StreamError";
  readonly source: string | null;
  readonly offset: number | null;
  readonly tile: number | null;
  readonly layer: number | null;
  readonly status: number | null;
  /** Whether nothing more will arrive until `resume`. What is shown stays. */
  fatal = false;

  constructor(
    /** Stable: a TransportId, or a refusal of SPEC §12.1 such as "crc-mismatch". */
    readonly id: TransportId | (string & {}),
    message: string,
    { source, offset, tile, layer, status, cause }: ErrorPlace = {},
  ) {
    super(message, cause === undefined ? undefined : { cause });
    this.source = source ?? null;
    this.offset = offset ?? null;
    this.tile = tile ?? null;
    this.layer = layer ?? null;
    this.status = status ?? null;
  }
}

/** @returns the error itself, or what wraps it: refusals keep their id and offset */
export function asStreamError(error: unknown, place: ErrorPlace = {}): StreamError {
  if (error instanceof StreamError) return error;
  const { id, message, offset } = error as { id?: unknown; message?: unknown; offset?: number | null };
  const text = typeof message === "string" ? message : String(error);
  if (typeof id === "string") return new StreamError(id, text, { ...place, offset: offset ?? place.offset });
  return new StreamError("network", text, { ...place, cause: error });
}
