/** What is told of a scene: a line for each layer, how many layers are wanted, and sums. */

import type { Showing } from "./showing.js";

const NUMBER = new Intl.NumberFormat("en");

export class Panel {
  readonly element = document.createElement("section");
  readonly #title = document.createElement("h2");
  readonly #table = document.createElement("tbody");
  readonly #slider = document.createElement("input");
  readonly #sum = document.createElement("p");
  #rows: { row: HTMLTableRowElement; bar: HTMLElement; time: HTMLTableCellElement }[] = [];

  constructor(private readonly showing: Showing) {
    this.element.className = "panel";
    this.#title.textContent = this.#title.title = showing.name;
    const table = document.createElement("table");
    table.append(this.#table);
    this.#sum.className = "sum";
    Object.assign(this.#slider, { type: "range", min: "1", step: "1", ariaLabel: "Layers" });
    this.#slider.addEventListener("input", () => this.wish(Number(this.#slider.value)));
    this.element.append(this.#title, table, this.#slider, this.#sum);
  }

  /** Asks for so many layers. */
  wish(layers: number): void {
    const most = this.showing.front?.layers.length ?? layers;
    const wanted = Math.min(Math.max(layers, 1), most);
    this.#slider.value = String(wanted);
    if (wanted !== Math.min(this.showing.wish.layers, most)) this.showing.wishLayers(wanted);
    this.update();
  }

  /** Lines for the layers of a front that has just been read. */
  build(): void {
    const { front, wish } = this.showing;
    if (front === null) return;
    const layers = front.layers.length;
    this.#slider.max = String(layers);
    this.#slider.value = String(Math.min(wish.layers, layers));
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
    const { front, wish, done } = this.showing;
    if (front === null) return;
    const { tilesAtLayer, layerAt, bytesRead, splatsShown, decodeMs } = this.showing.stats();
    this.#rows.forEach(({ row, bar, time }, i) => {
      const share = front.index.tiles === 0 ? 1 : (tilesAtLayer[i] ?? 0) / front.index.tiles;
      bar.style.width = `${100 * share}%`;
      row.classList.toggle("complete", share === 1);
      row.classList.toggle("left-out", i >= wish.layers);
      const at = layerAt[i];
      time.textContent = at == null ? "" : `${(at / 1000).toFixed(2)} s`;
    });
    const state = done ? "" : " …";
    this.#sum.textContent = `${NUMBER.format(splatsShown)} Gaussians, ${bytes(bytesRead)} read, ${(decodeMs / 1000).toFixed(1)} s decoding${state}`;
  }
}

function bytes(count: number): string {
  return count < 1e6 ? `${Math.round(count / 1e3)} kB` : `${(count / 1e6).toFixed(2)} MB`;
}
