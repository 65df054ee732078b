/** The page: scenes by `?url=` and `&beside=`, or dropped; one camera for all that is shown. */

import type { Budgets } from "../src/plan/types.js";
import { ScarStream } from "../src/stream/scar_stream.js";
import type { StreamError } from "../src/stream/errors.js";
import { cameraOf, type Frame, namedView, outsideView, UPWARD, viewName } from "./framing.js";
import { Panel } from "./panel.js";
import type { Pilot } from "./pilot.js";
import { type Origin, Showing } from "./showing.js";
import type { Stage } from "./stage.js";

const ALL_DEGREES = 3;
/** Controls move the camera by rounding errors for ever; smaller changes than this share are none. */
const STILL = 1e-7;

const MEGABYTE = 1e6;

type Drawing = typeof import("./drawing.js");

const TWO = 2;

function element<Kind extends HTMLElement>(id: string): Kind {
  return document.getElementById(id) as Kind;
}

class Viewer {
  readonly #stages = element("stages");
  readonly #panels = element("panels");
  /** Null until they have come. */
  #drawing: Drawing | null = null;
  #pilot: Pilot | null = null;
  /** Made before it is asked for: that takes as long as many frames. */
  #spare: Stage | null = null;
  #shown: { showing: Showing; panel: Panel }[] = [];
  #home: Frame | null = null;
  #upward = 0;
  #degree = ALL_DEGREES;
  #frame = 0;
  /** What streams were last told of the view. */
  #told: number[] | null = null;

  /** @param budgets of each scene */
  constructor(private readonly budgets: Partial<Budgets>) {
    new ResizeObserver(() => this.#needFrame()).observe(this.#stages);
    this.#listen();
  }

  /** Makes what draws, also for scenes that have begun to come. */
  begin(drawing: Drawing): void {
    this.#drawing = drawing;
    this.#pilot = new drawing.Pilot(this.#stages, () => this.#needFrame());
    if (this.#home !== null) this.#pilot.place(this.#home);
    this.#shown.forEach(({ showing }) => this.#setUp(drawing, showing));
    if (this.#shown.length === 0) {
      this.#spare = new drawing.Stage();
      this.#spare.prepare();
    }
    this.#layOut();
  }

  #setUp(drawing: Drawing, showing: Showing): void {
    showing.drawOn(this.#spare ?? new drawing.Stage());
    this.#spare = null;
  }

  /** Shows scenes, one or two, in place of those shown. */
  open(subjects: Origin[]): void {
    this.#shown.forEach(({ showing }) => showing.close());
    this.#home = null;
    this.#shown = [];
    subjects.forEach((subject) => this.#add(subject, Infinity));
    document.title = subjects.map(({ name }) => name).join(" | ") || "scar viewer";
    element("message").hidden = true;
    this.#layOut();
  }

  #add(origin: Origin, layers: number): void {
    const events = {
      onFront: () => this.#begin(showing, panel),
      onView: (view: Frame) => this.#beginAt(showing, view),
      onChange: () => this.#needFrame(),
      onError: ({ message, fatal }: StreamError) => this.tell(message, fatal),
    };
    const showing: Showing = new Showing(origin, { layers, degree: this.#degree }, events, this.budgets);
    const panel = new Panel(showing);
    this.#shown.push({ showing, panel });
    if (this.#drawing !== null) this.#setUp(this.#drawing, showing);
  }

  #layOut(): void {
    this.#stages.replaceChildren(...this.#shown.flatMap(({ showing }) => showing.stage?.canvas ?? []));
    this.#panels.replaceChildren(...this.#shown.map(({ panel }) => panel.element));
    element("beside").ariaPressed = String(this.#shown.length > 1);
    this.#told = null;
    this.#needFrame();
  }

  #begin(showing: Showing, panel: Panel): void {
    panel.build();
    if (this.#home === null && showing.front !== null) {
      this.#home = namedView(location.hash) ?? outsideView(showing.front);
      this.#upward = UPWARD.findIndex((axis) => axis.every((x, i) => x === this.#home?.up[i]));
      this.#pilot?.place(this.#home);
    }
    this.#told = null;
    this.#tellView();
    this.#needFrame();
  }

  /** Goes to the view that the first scene names, unless the address names one or someone has moved already. */
  #beginAt(showing: Showing, view: Frame): void {
    if (showing !== this.#shown[0]?.showing || namedView(location.hash) !== null || this.#pilot?.moved) return;
    this.#home = view;
    this.#upward = -1;
    this.#pilot?.place(view);
    this.#tellView();
  }

  /** Beside the scene, itself with its first layer alone; again: the scene alone. */
  compare(): void {
    const [first, second] = this.#shown;
    if (first === undefined) return;
    if (second === undefined) {
      this.#add(first.showing.origin, Infinity);
      first.panel.wish(1);
    } else {
      second.showing.close();
      this.#shown.pop();
      first.panel.wish(Infinity);
    }
    this.#layOut();
  }

  turnUpward(): void {
    if (this.#home === null) return;
    this.#upward = (this.#upward + 1) % UPWARD.length;
    this.#home = { ...this.#home, up: [...UPWARD[this.#upward]] };
    this.#pilot?.place(this.#home);
  }

  goHome(): void {
    if (this.#home !== null) this.#pilot?.place(this.#home);
  }

  /** Puts the view into the address, and that on the clipboard. */
  async link(): Promise<void> {
    const frame = this.#pilot?.frame() ?? this.#home;
    if (frame === null) return;
    history.replaceState(null, "", viewName(frame));
    const button = element("link");
    // Where a page may not write to the clipboard, the address line has it.
    const copied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    button.textContent = copied ? "Copied" : "In the address";
    setTimeout(() => (button.textContent = "Link"), 1500);
  }

  toggleHarmonics(): void {
    this.#degree = this.#degree === 0 ? ALL_DEGREES : 0;
    element("harmonics").ariaPressed = String(this.#degree > 0);
    this.#shown.forEach(({ showing }) => showing.wishDegree(this.#degree));
  }

  togglePanels(): void {
    element("fold").ariaPressed = String(!document.body.classList.toggle("folded"));
  }

  wishLayers(layers: number): void {
    this.#shown[this.#shown.length - 1]?.panel.wish(layers);
  }

  again(): void {
    element("message").hidden = true;
    this.#shown.filter(({ showing }) => showing.error !== null).forEach(({ showing }) => showing.again());
  }

  #needFrame(): void {
    if (this.#frame === 0) this.#frame = requestAnimationFrame((now) => this.#draw(now));
  }

  #draw(now: number): void {
    this.#frame = 0;
    const moves = this.#pilot?.advance(now) ?? false;
    this.#tellView();
    const camera = this.#pilot?.camera;
    const more = this.#shown.map(({ showing }) => camera !== undefined && showing.stage?.draw(camera));
    this.#shown.forEach(({ panel }) => panel.update());
    const busy = moves || more.includes(true) || this.#drawing === null;
    const done = this.#shown.every(({ showing }) => showing.done || showing.error !== null);
    document.body.dataset.state = this.#shown.length === 0 ? "empty" : !done ? "reading" : busy ? "drawing" : "still";
    if (busy && this.#drawing !== null) this.#needFrame();
  }

  /** Of the picture of one scene. */
  #size(): [number, number] {
    const canvas = this.#shown[0]?.showing.stage?.canvas;
    if (canvas !== undefined) return [canvas.clientWidth, canvas.clientHeight];
    const { clientWidth, clientHeight } = this.#stages;
    return [clientWidth / Math.max(this.#shown.length, 1), clientHeight];
  }

  /** Tells streams where the camera is, once for each place. */
  #tellView(): void {
    const [width, height] = this.#size();
    if (this.#home === null || height === 0) return;
    this.#pilot?.fit(width, height);
    const view = this.#pilot?.view(width, height) ?? cameraOf(this.#home, width, height);
    const said = [...view.position, ...view.forward, view.fovY, width, height];
    if (this.#told !== null && said.every((x, i) => Math.abs(x - this.#told![i]) <= STILL * Math.abs(x))) return;
    this.#told = said;
    this.#shown.forEach(({ showing }) => showing.setView(view));
  }

  /** @param lasting whether nothing more comes until someone tries again */
  tell(text: string, lasting: boolean): void {
    const message = element("message");
    message.querySelector("span")!.textContent = text;
    message.hidden = false;
    element("again").hidden = !lasting;
    this.#needFrame();
  }

  #listen(): void {
    element("beside").onclick = () => this.compare();
    element("harmonics").onclick = () => this.toggleHarmonics();
    element("upward").onclick = () => this.turnUpward();
    element("home").onclick = () => this.goHome();
    element("link").onclick = () => void this.link();
    element("fold").onclick = () => this.togglePanels();
    element("again").onclick = () => this.again();
    const choose = element<HTMLInputElement>("choose");
    choose.onchange = () => this.open(chosen(choose.files ?? []).slice(0, TWO));
    this.#listenForKeys();
    this.#listenForDrops();
  }

  #listenForKeys(): void {
    const keys: Record<string, () => void> = {
      KeyC: () => this.compare(),
      KeyH: () => this.toggleHarmonics(),
      KeyU: () => this.turnUpward(),
      KeyR: () => this.goHome(),
      KeyL: () => void this.link(),
      KeyP: () => this.togglePanels(),
      KeyF: () => void (document.fullscreenElement ? document.exitFullscreen() : document.body.requestFullscreen()),
    };
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLInputElement) return;
      const digit = /^(?:Digit|Numpad)([1-9])$/.exec(event.code);
      if (digit) this.wishLayers(Number(digit[1]));
      else keys[event.code]?.();
    });
  }

  #listenForDrops(): void {
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      document.body.classList.add("dragging");
    });
    document.addEventListener("dragleave", () => document.body.classList.remove("dragging"));
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      document.body.classList.remove("dragging");
      const files = chosen(event.dataTransfer?.files ?? []);
      const links = (event.dataTransfer?.getData("text/uri-list") ?? "").split(/\r?\n/);
      const subjects = [...files, ...links.filter((line) => /^[^#]/.test(line)).map(linked)].slice(0, TWO);
      if (subjects.length > 0) this.open(subjects);
    });
  }
}

function chosen(files: Iterable<File>): Origin[] {
  return Array.from(files, (file) => ({ name: file.name, source: file }));
}

/** @param text a URL, relative to the page */
function linked(text: string): Origin {
  const url = new URL(text, location.href);
  return { name: decodeURIComponent(url.pathname.split("/").pop() ?? "") || url.host, source: url.href };
}

/** What the address of the page asks for: `url`, `beside`, and `memory`, megabytes for each. */
const said = new URLSearchParams(location.search);
const memory = Number(said.get("memory") ?? NaN) * MEGABYTE;
const viewer = new Viewer(memory > 0 ? { bytes: memory } : {});
const named = ["url", "beside"].flatMap((key) => said.getAll(key)).slice(0, TWO);
if (named.length > 0) viewer.open(named.map(linked));
else ScarStream.prepare();
element("stages").focus();
// The first request is on its way before the largest script.
import("./drawing.js").then(
  (drawing) => viewer.begin(drawing),
  (error: unknown) => viewer.tell(`the page could not be loaded: ${String(error)}`, false),
);
