/** The page: scenes by `?url=` and `&beside=`, or dropped; one camera for all that is shown. */

import type { SourceLike } from "../src/stream/source.js";
import type { StreamError } from "../src/stream/errors.js";
import { type Frame, namedView, outsideView, UPWARD, viewName } from "./framing.js";
import { Panel } from "./panel.js";
import { Pilot } from "./pilot.js";
import { Showing } from "./showing.js";

const ALL_DEGREES = 3;
/** Controls move the camera by rounding errors for ever; smaller changes than this share are none. */
const STILL = 1e-7;

/** A scene that can be opened again. */
interface Subject {
  name: string;
  source: SourceLike;
}

function element<Kind extends HTMLElement>(id: string): Kind {
  return document.getElementById(id) as Kind;
}

class Viewer {
  readonly #stages = element("stages");
  readonly #panels = element("panels");
  readonly #pilot = new Pilot(this.#stages, () => this.#needFrame());
  #shown: { showing: Showing; panel: Panel }[] = [];
  #home: Frame | null = null;
  #upward = 0;
  #degree = ALL_DEGREES;
  #frame = 0;
  /** What streams were last told of the view. */
  #told: number[] | null = null;

  constructor() {
    new ResizeObserver(() => this.#needFrame()).observe(this.#stages);
    this.#listen();
  }

  /** Shows scenes, one or two, in place of those shown. */
  open(subjects: Subject[]): void {
    this.#shown.forEach(({ showing }) => showing.close());
    this.#home = null;
    this.#shown = [];
    subjects.forEach((subject) => this.#add(subject, Infinity));
    document.title = subjects.map(({ name }) => name).join(" | ") || "scar viewer";
    element("message").hidden = true;
    this.#layOut();
  }

  #add(subject: Subject, layers: number): void {
    const { name, source } = subject;
    const showing: Showing = new Showing(name, source, { layers, degree: this.#degree }, {
      onFront: () => this.#begin(showing, panel),
      onView: (view) => this.#beginAt(showing, view),
      onChange: () => this.#needFrame(),
      onError: (error) => this.#tell(error),
    });
    const panel = new Panel(showing);
    this.#shown.push({ showing, panel });
  }

  #layOut(): void {
    this.#stages.replaceChildren(...this.#shown.map(({ showing }) => showing.stage.canvas));
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
      this.#pilot.place(this.#home);
    }
    this.#told = null;
    this.#needFrame();
  }

  /** Goes to the view that the first scene names, unless the address names one or someone has moved already. */
  #beginAt(showing: Showing, view: Frame): void {
    if (showing !== this.#shown[0]?.showing || namedView(location.hash) !== null || this.#pilot.moved) return;
    this.#home = view;
    this.#upward = -1;
    this.#pilot.place(view);
  }

  /** Beside the scene, itself with its first layer alone; again: the scene alone. */
  compare(): void {
    const [first, second] = this.#shown;
    if (first === undefined) return;
    if (second === undefined) {
      this.#add({ name: first.showing.name, source: first.showing.origin }, Infinity);
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
    this.#pilot.place(this.#home);
  }

  goHome(): void {
    if (this.#home !== null) this.#pilot.place(this.#home);
  }

  /** Puts the view into the address, and that on the clipboard. */
  async link(): Promise<void> {
    history.replaceState(null, "", viewName(this.#pilot.frame()));
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
    const moves = this.#pilot.advance(now);
    const { clientWidth, clientHeight } = this.#shown[0]?.showing.stage.canvas ?? this.#stages;
    this.#pilot.fit(clientWidth, clientHeight);
    const more = this.#shown.map(({ showing }) => showing.stage.draw(this.#pilot.camera));
    this.#shown.forEach(({ panel }) => panel.update());
    this.#tellView(clientWidth, clientHeight);
    const busy = moves || more.includes(true);
    const done = this.#shown.every(({ showing }) => showing.done || showing.error !== null);
    document.body.dataset.state = this.#shown.length === 0 ? "empty" : !done ? "reading" : busy ? "drawing" : "still";
    if (busy) this.#needFrame();
  }

  /** Tells streams where the camera is, once for each place. */
  #tellView(width: number, height: number): void {
    if (this.#home === null || height === 0) return;
    const view = this.#pilot.view(width, height);
    const said = [...view.position, ...view.forward, view.fovY, width, height];
    if (this.#told !== null && said.every((x, i) => Math.abs(x - this.#told![i]) <= STILL * Math.abs(x))) return;
    this.#told = said;
    this.#shown.forEach(({ showing }) => showing.setView(view));
  }

  #tell(error: StreamError): void {
    const message = element("message");
    message.querySelector("span")!.textContent = error.message;
    message.hidden = false;
    element("again").hidden = !error.fatal;
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
    choose.onchange = () => this.open([...(choose.files ?? [])].map(asSubject));
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
      const files = [...(event.dataTransfer?.files ?? [])].slice(0, 2);
      if (files.length > 0) this.open(files.map(asSubject));
    });
  }
}

function asSubject(file: File): Subject {
  return { name: file.name, source: file };
}

/** What the address of the page names. */
function namedSubjects(address: URL): Subject[] {
  const named = ["url", "beside"].flatMap((key) => address.searchParams.getAll(key)).slice(0, 2);
  return named.map((text) => {
    const url = new URL(text, address);
    return { name: decodeURIComponent(url.pathname.split("/").pop() ?? "") || url.host, source: url.href };
  });
}

const viewer = new Viewer();
const named = namedSubjects(new URL(location.href));
if (named.length > 0) viewer.open(named);
document.getElementById("stages")?.focus();
