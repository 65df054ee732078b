/** The page: scenes by `?url=` and `&beside=`, or dropped; one camera for all that is shown. */

import type { SourceLike } from "../src/stream/source.js";
import { createViewer, type Viewer, type ViewerState } from "../src/viewer/viewer.js";
import { namedView, viewName } from "./address.js";
import { Panel } from "./panel.js";
import { element, listen } from "./tools.js";

/** Where a scene comes from. */
interface Origin {
  name: string;
  source: SourceLike;
}

interface Shown {
  origin: Origin;
  place: HTMLElement;
  viewer: Viewer;
  panel: Panel;
}

const TWO = 2;
/** Without an answer for so long, the page says whom it waits for. */
const PATIENCE_MS = 2500;
/** The page's state is the first of these that a viewer has. */
const STATES: ViewerState[] = ["loading", "reading", "drawing", "failed", "still", "empty"];

/** What the address of the page asks for. */
const said = new URLSearchParams(location.search);
const memory = Number(said.get("memory") ?? NaN) * 1e6;

/** The answer to the first request, which the page makes before this script is there; to be taken once. */
let { firstAnswer = null } = globalThis as { firstAnswer?: Promise<Response | null> | null };

/** `fetch`, but for what is under way already. */
async function fetchNext(...asked: Parameters<typeof fetch>): Promise<Response> {
  if (asked[0] !== new URL(said.get("url") ?? "", location.href).href) return fetch(...asked);
  const answer = firstAnswer;
  firstAnswer = null;
  return (await answer) ?? fetch(...asked);
}

export class Page {
  #shown: Shown[] = [];
  #wait: ReturnType<typeof setTimeout> | undefined;

  /** Shows scenes, one or two, in place of those shown. */
  open(subjects: Origin[]): void {
    this.#shown.splice(0).forEach(remove);
    element("message").hidden = true;
    document.title = subjects.map(({ name }) => name).join(" | ") || "scar viewer";
    subjects.forEach((subject) => this.#add(subject));
    this.#layOut();
  }

  /** Beside the scene, itself with its first layer alone; again: the scene alone. */
  compare(): void {
    const [first, second] = this.#shown;
    if (first === undefined) return;
    if (second === undefined) {
      this.#add(first.origin);
      first.panel.wish(1);
    } else {
      this.#shown.splice(1).forEach(remove);
      first.panel.wish(Infinity);
    }
    this.#layOut();
  }

  /** The viewers, the first of which the tools speak of. */
  get viewers(): Viewer[] {
    return this.#shown.map(({ viewer }) => viewer);
  }

  wishLayers(layers: number): void {
    this.#shown.at(-1)?.panel.wish(layers);
  }

  /** Goes to a view of the first scene's, by name. */
  go(name: string): void {
    const view = this.viewers[0]?.views[name];
    if (view !== undefined) this.viewers.forEach((viewer) => (viewer.view = view));
  }

  again(): void {
    element("message").hidden = true;
    this.viewers.forEach((viewer) => viewer.again());
  }

  /** Puts the view into the address, and that on the clipboard. @returns what was done */
  async link(): Promise<string> {
    const view = this.viewers[0]?.view;
    if (!view) return "";
    history.replaceState(null, "", viewName(view));
    // Where a page may not write to the clipboard, the address line has it.
    const copied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    return copied ? "The link is copied" : "The link is in the address";
  }

  /** Saves the picture of the first scene. */
  async shoot(): Promise<void> {
    const [first] = this.#shown;
    if (first?.viewer.front == null) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await first.viewer.screenshot());
    link.download = `${first.origin.name.replace(/\.scar$/, "")}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), PATIENCE_MS);
  }

  /** @param lasting whether nothing more comes until someone tries again */
  tell(text: string, lasting: boolean): void {
    const message = element("message");
    message.querySelector("span")!.textContent = text;
    message.hidden = false;
    element("again").hidden = !lasting;
  }

  #add(origin: Origin): void {
    const place = document.createElement("div");
    element("stages").append(place);
    const view = this.viewers[0]?.view ?? namedView(location.hash) ?? undefined;
    const viewer = createViewer({
      container: place,
      url: origin.source,
      view,
      background: element<HTMLInputElement>("background").value,
      poster: said.get("poster") ?? undefined,
      stream: { fetch: fetchNext, budgets: memory > 0 ? { bytes: memory } : {} },
    });
    const panel = new Panel(viewer, origin.name);
    this.#shown.push({ origin, place, viewer, panel });
    viewer.on("front", () => {
      // What was tried again has answered.
      element("message").hidden = true;
      panel.build();
      this.#tellViews();
    });
    viewer.on("frame", () => panel.update());
    viewer.on("state", () => this.#tellState());
    viewer.on("view", (view) => this.viewers.forEach((other) => other !== viewer && (other.view = view)));
    viewer.on("retry", ({ message }) => viewer.front === null && this.tell(`${message}. Trying again …`, false));
    viewer.on("error", ({ message, fatal }) => this.tell(message, fatal));
    document.dispatchEvent(new CustomEvent("scar-viewer", { detail: viewer }));
  }

  #layOut(): void {
    element("panels").replaceChildren(...this.#shown.map(({ panel }) => panel.element));
    element("beside").ariaPressed = String(this.#shown.length > 1);
    this.#tellState();
  }

  #tellViews(): void {
    const names = Object.keys(this.viewers[0]?.views ?? {});
    element("views").replaceChildren(...names.map((name) => new Option(name[0].toUpperCase() + name.slice(1), name)));
  }

  #tellState(): void {
    const states = this.viewers.map(({ state }) => state);
    const state = STATES.find((one) => states.includes(one)) ?? "empty";
    if (state === document.body.dataset.state) return;
    document.body.dataset.state = state;
    clearTimeout(this.#wait);
    if (state !== "loading") return;
    element("loading").textContent = "Loading …";
    this.#wait = setTimeout(() => {
      const { source, name } = this.#shown[0].origin;
      element("loading").textContent = `Waiting for ${typeof source === "string" ? new URL(source).host : name} …`;
    }, PATIENCE_MS);
  }
}

function remove({ viewer, place }: Shown): void {
  viewer.dispose();
  place.remove();
}

/** Origins of chosen or dropped files and of links; at most two. */
function origins(files: Iterable<File>, links: string[] = []): Origin[] {
  const chosen = Array.from(files, (file) => ({ name: file.name, source: file as SourceLike }));
  return [...chosen, ...links.map(linked)].slice(0, TWO);
}

/** @param text a URL, relative to the page */
function linked(text: string): Origin {
  const url = new URL(text, location.href);
  return { name: decodeURIComponent(url.pathname.split("/").pop() ?? "") || url.host, source: url.href };
}

const page = new Page();
document.body.classList.toggle("noui", said.has("noui"));
listen(page, (files, links) => page.open(origins(files, links)));
/** In a page of one file. */
const { scene } = (globalThis as { scarFiles?: { scene: File } }).scarFiles ?? {};
const named = origins(scene ? [scene] : [], scene ? [] : ["url", "beside"].flatMap((key) => said.getAll(key)));
if (named.length > 0) page.open(named);
