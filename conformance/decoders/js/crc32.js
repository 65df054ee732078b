/** CRC-32 of zlib, PNG and Ethernet (SPEC §1), four bytes at a time. */

const TABLES = makeTables();

/** @returns {Uint32Array[]} table t: the CRC of a byte followed by t bytes 0 */
function makeTables() {
  const tables = [new Uint32Array(256)];
  for (let byte = 0; byte < 256; byte++) {
    let value = byte;
    for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
    tables[0][byte] = value;
  }
  for (let t = 1; t < 4; t++) {
    tables.push(tables[t - 1].map((value) => (value >>> 8) ^ tables[0][value & 255]));
  }
  return tables;
}

/**
 * @param {Uint8Array} bytes
 * @param {number} [before] CRC of the bytes before these
 * @returns {number} u32
 */
export function crc32(bytes, before = 0) {
  const [t0, t1, t2, t3] = TABLES;
  let crc = ~before;
  let i = 0;
  for (const end = bytes.length - 3; i < end; i += 4) {
    crc ^= bytes[i] | (bytes[i + 1] << 8) | (bytes[i + 2] << 16) | (bytes[i + 3] << 24);
    crc = t3[crc & 255] ^ t2[(crc >>> 8) & 255] ^ t1[(crc >>> 16) & 255] ^ t0[crc >>> 24];
  }
  for (; i < bytes.length; i++) crc = (crc >>> 8) ^ t0[(crc ^ bytes[i]) & 255];
  return ~crc >>> 0;
}
