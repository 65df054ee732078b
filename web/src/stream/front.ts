/** Header and ROOT (SPEC §5), which come before any data and say where the rest of the directory is. */

import { DEFAULT_LIMITS } from "../../../conformance/decoders/js/constants.js";
import { readFront } from "../../../conformance/decoders/js/container.js";
import { readHeader } from "../../../conformance/decoders/js/header.js";
import { startOf } from "../decoder/sparse.js";
import { Directory } from "./directory.js";

/** The longest header (SPEC §5.2). */
export const MOST_HEADER = 2280;

/**
 * Bytes of header and ROOT. Throws a refusal where the header breaks a rule.
 * @param bytes the first MOST_HEADER bytes, or the whole of a shorter file
 * @param size of the file, null where the server does not say
 */
export function frontLength(bytes: Uint8Array, size: number | null): number {
  const { header } = readHeader(startOf(bytes, size), DEFAULT_LIMITS, false);
  return header.header_length + header.root_length;
}

/** Throws a refusal where header or ROOT break a rule of §5. @param bytes header and ROOT, or more */
export function parseFront(bytes: Uint8Array, size: number | null): Directory {
  return new Directory(readFront(startOf(bytes, size), DEFAULT_LIMITS, false));
}

/** Opens every page that lies whole within the first bytes of a file. Throws a refusal where one breaks a rule of §5.5. */
export function openPages(directory: Directory, bytes: Uint8Array): void {
  const { offset, length } = directory.entries;
  for (let page = 0; page < directory.pageEntries; page++) {
    const end = offset[page] + length[page];
    if (!directory.isOpen(page) && end <= bytes.length) directory.openPage(page, bytes.subarray(offset[page], end));
  }
}
