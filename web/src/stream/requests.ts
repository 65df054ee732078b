/** Which bytes to ask for next: blocks in the order of the plan, put together where little lies between them. */

/** Sizes, bytes. */
export interface RequestSizes {
  /** Blocks this far down the plan may be put together. */
  window: number;
  /** The most that one request asks for, unless one block is larger. */
  most: number;
  /** The widest gap that is read along. */
  gap: number;
}

export interface ByteRange {
  start: number;
  /** One past the last byte. */
  end: number;
  /** Entries wanted of it, by offset. */
  entries: number[];
}

interface Entries {
  offset: ArrayLike<number>;
  length: ArrayLike<number>;
}

const LEAST_REQUEST = 32 * 1024;
const MOST_REQUEST = 256 * 1024;
const LEAST_GAP = 4 * 1024;
const MOST_GAP = 16 * 1024;
/** Seconds of throughput under way, besides what the delay of a request takes. */
const UNDER_WAY_S = 0.225;
export const MOST_PARALLEL = 4;

/**
 * @param rate bytes a second
 * @param delay of a request, seconds
 * @returns sizes, and how many bytes may be under way
 */
export function requestSizes(rate: number, delay: number): RequestSizes & { underWay: number } {
  const underWay = Math.max(rate * (UNDER_WAY_S + delay), 2 * LEAST_REQUEST);
  const most = Math.max(Math.min(underWay / 3, MOST_REQUEST), LEAST_REQUEST, underWay / MOST_PARALLEL);
  // A gap is worth reading where it takes less time than a request of its own, some of which run side by side.
  const gap = Math.min(Math.max((rate * delay) / MOST_PARALLEL, LEAST_GAP), MOST_GAP);
  return { window: Math.max(underWay, most), most, gap, underWay };
}

/**
 * The next request: around the first block of the plan, as far as its neighbours in the file are wanted soon as well.
 * @param wanted entries in the order of the plan, none of them under way; at least one
 */
export function nextRequest(wanted: Iterable<number>, { offset, length }: Entries, sizes: RequestSizes): ByteRange {
  const soon: number[] = [];
  let bytes = 0;
  for (const e of wanted) {
    soon.push(e);
    bytes += length[e];
    if (bytes >= sizes.window) break;
  }
  const [first] = soon;
  soon.sort((a, b) => offset[a] - offset[b]);
  let low = soon.indexOf(first);
  let high = low;
  const start = () => offset[soon[low]];
  const end = () => offset[soon[high]] + length[soon[high]];
  for (;;) {
    const after = soon[high + 1];
    const before = soon[low - 1];
    if (
      after !== undefined &&
      offset[after] - end() <= sizes.gap &&
      offset[after] + length[after] - start() <= sizes.most
    ) {
      high++;
    } else if (
      before !== undefined &&
      start() - offset[before] - length[before] <= sizes.gap &&
      end() - offset[before] <= sizes.most
    ) {
      low--;
    } else {
      return { start: start(), end: end(), entries: soon.slice(low, high + 1) };
    }
  }
}
