/**
 * `<scar-view src="scene.scar">`: a viewer as an element of a page. Attributes: src, background, poster, layers, autorotate.
 * Its events "scar-front", "scar-state" and "scar-error" have what those of a viewer have in `detail`.
 */

import { createViewer, type Viewer } from "./viewer.js";

const STYLE = "<style>:host { display: block; position: relative; height: 20rem } div { position: absolute; inset: 0 }</style>";
const PASSED_ON = ["front", "state", "error"] as const;

export class ScarView extends HTMLElement {
  static readonly observedAttributes = ["src", "background", "layers", "autorotate"];
  /** Null while it is not in a page, or has no src. */
  viewer: Viewer | null = null;
  readonly #container = document.createElement("div");

  constructor() {
    super();
    const root = this.attachShadow({ mode: "open" });
    root.innerHTML = STYLE;
    root.append(this.#container);
  }

  connectedCallback(): void {
    this.#show();
  }

  disconnectedCallback(): void {
    this.viewer?.dispose();
    this.viewer = null;
  }

  attributeChangedCallback(name: string): void {
    if (name === "src") return this.#show();
    if (this.viewer === null) return;
    if (name === "background") this.viewer.background = this.getAttribute(name) ?? "#000";
    else if (name === "layers") this.viewer.layers = this.#layers;
    else this.viewer.autoRotate = this.hasAttribute(name);
  }

  get #layers(): number {
    return Number(this.getAttribute("layers") ?? Infinity);
  }

  #show(): void {
    const src = this.getAttribute("src");
    if (src === null || !this.isConnected) return;
    if (this.viewer !== null) return this.viewer.open(new URL(src, document.baseURI));
    const viewer = createViewer({
      container: this.#container,
      url: new URL(src, document.baseURI),
      background: this.getAttribute("background") ?? undefined,
      poster: this.getAttribute("poster") ?? undefined,
      autoRotate: this.hasAttribute("autorotate"),
      stream: { layers: this.#layers },
    });
    for (const name of PASSED_ON) viewer.on(name, (detail) => this.dispatchEvent(new CustomEvent(`scar-${name}`, { detail })));
    this.viewer = viewer;
  }
}

customElements.define("scar-view", ScarView);
