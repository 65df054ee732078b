/** What is told of a scene: a line for each layer, how many layers are wanted, and sums. */

import type { Viewer } from "../src/viewer/viewer.js";

const NUMBER = new Intl.NumberFormat("en");
/** In smaller windows an open panel would hide the scene. */
const ROOMY = "(min-width: 641px) and (min-height: 421px)";

export class Panel {
  readonly element = document.createElement("details");
  readonly #table = document.createElement("tbody");
  readonly #slider = document.createElement("input");
  readonly #sum = document.createElement("p");
  #rows: { row: HTMLTableRowElement; bar: HTMLElement; time: HTMLTableCellElement }[] = [];

  constructor(
    private readonly viewer: Viewer,
    name: string,
  ) {
    this.element.className = "panel";
    this.element.hidden = true;
    this.element.open = matchMedia(ROOMY).matches;
    const title = document.createElement("summary");
    title.textContent = title.title = name;
    const table = document.createElement("table");
    table.append(this.#table);
    this.#sum.className = "sum";
    Object.assign(this.#slider, { type: "range", min: "1", step: "1", ariaLabel: "Layers" });
    this.#slider.addEventListener("input", () => this.wish(Number(this.#slider.value)));
    this.element.append(title, table, this.#slider, this.#sum);
  }

  /** Asks for so many layers. */
  wish(layers: number): void {
    const most = this.viewer.front?.layers.length ?? Infinity;
    const wanted = Math.min(Math.max(layers, 1), most);
    this.#slider.value = String(wanted);
    if (wanted !== Math.min(this.viewer.layers, most)) this.viewer.layers = layers < most ? wanted : Infinity;
    this.update();
  }

  /** Lines for the layers of a front that has just been read. */
  build(): void {
    const { front, layers: wished } = this.viewer;
    if (front === null) return;
    const layers = front.layers.length;
    this.element.hidden = false;
    this.#slider.max = String(layers);
    this.#slider.value = String(Math.min(wished, layers));
    this.#slider.hidden = layers < 2;
    this.#rows = front.layers.map((layer, i) => {
      const row = document.createElement("tr");
      row.innerHTML = `<td>Layer ${i + 1}</td><td>${bytes(layer.end_offset)}</td><td class="bar"><div><i></i></div></td><td></td>`;
      return { row, bar: row.querySelector("i")!, time: row.cells[3] };
    });
    this.#table.replaceChildren(...this.#rows.map(({ row }) => row));
    this.update();
  }

  update(): void {
    const { front, layers, state } = this.viewer;
    const stats = this.viewer.stats();
    if (front === null || stats === null) return;
    const { tilesAtLayer, layerAt, bytesRead, splatsShown, decodeMs, framesPerSecond } = stats;
    this.#rows.forEach(({ row, bar, time }, i) => {
      const share = front.index.tiles === 0 ? 1 : (tilesAtLayer[i] ?? 0) / front.index.tiles;
      bar.style.width = `${100 * share}%`;
      row.classList.toggle("complete", share === 1);
      row.classList.toggle("left-out", i >= layers);
      const at = layerAt[i];
      time.textContent = at == null ? "" : `${(at / 1000).toFixed(2)} s`;
    });
    const rate = framesPerSecond > 0 ? [`${Math.round(framesPerSecond)} frames/s`] : [];
    const read = `${bytes(bytesRead)} read${state === "reading" ? " …" : ""}`;
    const decoding = `${(decodeMs / 1000).toFixed(1)} s decoding`;
    const parts = [`${NUMBER.format(splatsShown)} Gaussians`, ...rate, read, decoding];
    // Lines break between two numbers only.
    this.#sum.textContent = parts.map((part) => part.replaceAll(" ", "\u00a0")).join(", ");
  }
}

function bytes(count: number): string {
  return count < 1e6 ? `${Math.round(count / 1e3)} kB` : `${(count / 1e6).toFixed(2)} MB`;
}
