// Runs the command line of @playcanvas/splat-transform, of which `benchmarks.rivals_tools` made a copy that asks here
// for its k-means: without a GPU its own takes hours on a large scene.
//
//     HOST_KMEANS='python -m benchmarks.rivals_kmeans' node driver.mjs ARGUMENTS

import { spawnSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

// Distances of one iteration from which another process is worth its start.
const MANY = 3e7;

// Centroids start at random points: the same ones each time, so that a file can be made again.
let state = 1;
Math.random = () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
};

/** All iterations in another process; returns how many are left to do. */
globalThis.hostKmeans = (points, rows, columns, centroids, k, labels, iterations) => {
    if (!process.env.HOST_KMEANS || rows * k < MANY) return iterations;
    const folder = mkdtempSync(join(tmpdir(), 'kmeans-'));
    const at = (name) => join(folder, name);
    const bytes = (array, length) => new Uint8Array(array.buffer, array.byteOffset, length * array.BYTES_PER_ELEMENT);
    try {
        writeFileSync(at('points.f32'), bytes(points, rows * columns));
        writeFileSync(at('centroids.f32'), bytes(centroids, k * columns));
        const [program, ...words] = process.env.HOST_KMEANS.split(' ');
        const done = spawnSync(program, [...words, folder, columns, iterations].map(String), { stdio: 'inherit' });
        if (done.status !== 0) throw new Error('k-means in another process failed');
        bytes(centroids, k * columns).set(readFileSync(at('centroids.f32')));
        bytes(labels, rows).set(readFileSync(at('labels.u32')));
    } finally {
        rmSync(folder, { recursive: true });
    }
    return 0;
};

const { main } = await import('./node_modules/@playcanvas/splat-transform/dist/cli-host-kmeans.mjs');
await main();
