/** Buttons, keys, and what is dropped on the page. */

import type { Page } from "./page.js";

const BACKGROUNDS = ["#000000", "#808080", "#ffffff"];
const NOTE_MS = 2000;

export function element<Kind extends HTMLElement>(id: string): Kind {
  return document.getElementById(id) as Kind;
}

/** @param open shows what was chosen or dropped: files, and addresses */
export function listen(page: Page, open: (files: Iterable<File>, links?: string[]) => void): void {
  const background = element<HTMLInputElement>("background");
  const views = element<HTMLSelectElement>("views");
  const colour = (value: string) => {
    background.value = value;
    page.viewers.forEach((viewer) => (viewer.background = value));
  };
  /** By the button that does it, and its key. */
  const actions: Record<string, [key: string, act: () => void]> = {
    home: ["KeyR", () => page.go("start")],
    rotate: ["KeyT", () => page.viewers.slice(0, 1).forEach((viewer) => (viewer.autoRotate = !viewer.autoRotate))],
    full: ["KeyF", () => void (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen())],
    beside: ["KeyC", () => page.compare()],
    picture: ["KeyI", () => void page.shoot()],
    link: ["KeyL", () => void page.link().then(note)],
    headset: ["KeyX", () => void page.viewers[0]?.enterXR().catch(({ message }: Error) => note(message))],
    help: ["", () => toggleHelp()],
    again: ["", () => page.again()],
  };
  for (const [id, [, act]] of Object.entries(actions)) element(id).onclick = act;
  element("stages").onpointerdown = () => (element<HTMLDetailsElement>("more").open = false);
  background.oninput = () => colour(background.value);
  views.onchange = () => page.go(views.value);
  void navigator.xr?.isSessionSupported("immersive-vr").then((has) => (element("headset").hidden = !has));
  const keys = Object.fromEntries(Object.values(actions));
  keys["KeyB"] = () => colour(BACKGROUNDS[(BACKGROUNDS.indexOf(background.value) + 1) % BACKGROUNDS.length]);
  keys["KeyP"] = () => document.querySelectorAll<HTMLDetailsElement>(".panel").forEach((panel) => (panel.open = !panel.open));
  keys["KeyV"] = () => {
    views.selectedIndex = (views.selectedIndex + 1) % Math.max(views.length, 1);
    page.go(views.value);
  };
  listenForKeys(page, keys);
  const choose = element<HTMLInputElement>("choose");
  choose.onchange = () => open(choose.files ?? []);
  listenForDrops(open);
}

function toggleHelp(): void {
  const help = element<HTMLDialogElement>("keys");
  if (help.open) help.close();
  else help.showModal();
}

/** Says something for a moment. */
function note(text: string): void {
  const shown = element("note");
  shown.textContent = text;
  setTimeout(() => (shown.textContent = ""), NOTE_MS);
}

function listenForKeys(page: Page, keys: Record<string, () => void>): void {
  document.addEventListener("keydown", (event) => {
    const { target, code, key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target instanceof HTMLInputElement || target instanceof HTMLSelectElement) return;
    const digit = /^(?:Digit|Numpad)([1-9])$/.exec(code);
    if (key === "?") toggleHelp();
    else if (digit) page.wishLayers(Number(digit[1]));
    else if (code !== "") keys[code]?.();
  });
}

function listenForDrops(open: (files: Iterable<File>, links?: string[]) => void): void {
  const dragging = (is: boolean) => document.body.classList.toggle("dragging", is);
  document.addEventListener("dragover", (event) => {
    event.preventDefault();
    dragging(true);
  });
  document.addEventListener("dragleave", () => dragging(false));
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    dragging(false);
    const files = event.dataTransfer?.files ?? [];
    const links = (event.dataTransfer?.getData("text/uri-list") ?? "").split(/\r?\n/).filter((line) => /^[^#]/.test(line));
    if (files.length + links.length > 0) open(files, links);
  });
}
