/** The loader for loaders.gl: what its core finds it by, and what it gives. */

import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { parse, selectLoader } from "@loaders.gl/core";
import { ScarLoader } from "../src/adapters/loaders.js";
import { inlineChannel } from "../src/decoder/channel.js";
import { Feeder } from "./feeding.js";
import { decoder, toys } from "./files.js";

const bytes = toys();
const options = { scar: { workers: 0, channel: inlineChannel(async () => decoder()) } };

describe("a scene by loaders.gl", () => {
  it("is known by its first bytes and by its name", async () => {
    const other = { ...ScarLoader, id: "other", extensions: ["other"], tests: ["other"], mimeTypes: [] };
    const plain = { core: { ignoreRegisteredLoaders: true } };
    const view = Buffer.concat([Buffer.alloc(7), bytes]).subarray(7);
    for (const data of [bytes.slice().buffer, view]) assert.equal((await selectLoader(data, [other, ScarLoader], plain))?.id, "scar");
    assert.equal((await selectLoader("https://a.b/toys.scar", [other, ScarLoader], plain))?.id, "scar");
  });

  it("is a table of what a decoder gives, by the names of PLY", async () => {
    const { attributes, header, schema } = await parse(bytes.slice().buffer, ScarLoader, options);
    const feeder = new Feeder(bytes);
    feeder.decodeTo(feeder.layers);
    const tiles = Array.from({ length: feeder.tiles }, (_, tile) => feeder.decoder.values(tile));
    const all = (of: "centres" | "quats" | "sh") => tiles.flatMap((tile) => Array.from(tile[of]));
    const inOrder = (numbers: ArrayLike<number>) => Float32Array.from(numbers).toSorted();
    assert.equal(header.vertexCount, 10_914);
    assert.deepEqual(inOrder(attributes.POSITION.value), inOrder(all("centres")));
    assert.deepEqual(schema.fields.map(({ name }) => name), Object.keys(attributes));
    assert.equal(schema.fields.length, 1 + 3 + 1 + 3 + 4 + 45);
    // Red of the third coefficient beside the first of a quaternion: rows are of one Gaussian, in the order of tiles.
    const first = attributes.POSITION.value.subarray(0, 3);
    const of = tiles.find(({ centres }) => centres[0] === first[0] && centres[1] === first[1] && centres[2] === first[2])!;
    const row = ["rot_0", "f_dc_2", "f_rest_2", "f_rest_16", "opacity", "scale_1"].map((name) => attributes[name].value[0]);
    assert.deepEqual(row, [of.quats[0], of.sh[2], of.sh[9], of.sh[7], of.opacity[0], of.scales[1]]);
  });

  it("is refused as a whole where a part is damaged", async () => {
    const damaged = bytes.map((b, i) => (i === bytes.length - 3000 ? b ^ 1 : b));
    await assert.rejects(parse(damaged.buffer, ScarLoader, options), { id: "crc-mismatch" });
  });
});
