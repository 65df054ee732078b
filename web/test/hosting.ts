/** A page and a scene from one origin, as a static server has them. */

import { existsSync, readFileSync } from "node:fs";
import { createServer, get } from "node:http";
import type { AddressInfo } from "node:net";

const TYPES: Record<string, string> = {
  html: "text/html",
  js: "text/javascript",
  mjs: "text/javascript",
  css: "text/css",
  wasm: "application/wasm",
};

export interface Host {
  /** Files that were asked for, by name, and those of them that are not there. */
  asked: string[];
  missing?: string[];
  /** What is awaited before one is sent. */
  before?: (name: string) => Promise<void>;
}

/**
 * Runs with the address of a server that is stopped whatever happens.
 * @param folder whose files are sent
 * @param scene address of another server, whose answers are sent as /scene.scar
 */
export async function hosting(
  folder: URL,
  scene: string,
  host: Host,
  run: (address: string) => Promise<void>,
): Promise<void> {
  const server = createServer(async (request, response) => {
    const { pathname } = new URL(request.url ?? "/", "http://host/");
    if (pathname === "/scene.scar") {
      const { host: _, ...headers } = request.headers;
      const asked = get(scene, { headers }, (answer) => {
        response.writeHead(answer.statusCode ?? 502, answer.headers);
        answer.on("error", () => response.destroy()).pipe(response);
      });
      asked.on("error", () => response.destroy());
      response.on("close", () => asked.destroy());
      return;
    }
    const name = pathname === "/" ? "index.html" : pathname.slice(1);
    host.asked.push(name);
    await host.before?.(name);
    const file = new URL(name, folder);
    const found = existsSync(file);
    if (!found) host.missing?.push(name);
    const type = TYPES[name.split(".").pop() ?? ""] ?? "text/plain";
    response.writeHead(found ? 200 : 404, { "Content-Type": type }).end(found ? readFileSync(file) : "");
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  try {
    await run(`http://127.0.0.1:${(server.address() as AddressInfo).port}/`);
  } finally {
    server.closeAllConnections();
    server.close();
  }
}
