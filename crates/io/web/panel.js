// The list of groups and instances, and what can be done with the selected ones. All text from the scene is set as text, never
// as HTML.

import { BACKGROUND } from "./viewer.js";

/** Groups of at most this many instances are open from the start. */
const OPEN_UP_TO = 30;

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Partial<HTMLElementTagNameMap[K]> & Record<string, any>} properties
 * @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[K]}
 */
function element(tag, properties = {}, children = []) {
  const made = document.createElement(tag);
  Object.assign(made, properties);
  made.append(...children);
  return made;
}

/** @param {string} id */
export function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found;
}

/** @param {number} count */
export function grouped(count) {
  return count.toLocaleString("en");
}

/** @param {number[]} rgb 0 to 1 */
const hexOf = (rgb) => `#${rgb.map((v) => Math.round(255 * v).toString(16).padStart(2, "0")).join("")}`;

/** @param {string} hex @returns {number[]} */
export const rgbOf = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);

export class Panel {
  /** @param {import("./viewer.js").Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    /** @type {{label: string, objects: number[], mark: HTMLElement}[]} lines of the list that exist so far */
    this.lines = [];
    this.colour = /** @type {HTMLInputElement} */ (byId("colour"));
    this.fillList();
    this.connectSelection();
    this.refresh();
  }

  fillList() {
    const { scene } = this.viewer;
    const list = byId("list");
    scene.templateCounts.forEach((/** @type {number} */ gaussians, /** @type {number} */ template) => {
      const objects = [...scene.names.keys()].filter((k) => scene.names[k].template === template);
      objects.sort((a, b) => scene.names[a].id - scene.names[b].id);
      if (objects.length > 0) list.append(this.group(objects, gaussians));
    });
    if (scene.backgroundCount > 0) {
      const note = `${grouped(scene.backgroundCount)} Gaussians`;
      list.append(this.line("Background", note, [BACKGROUND]));
    }
  }

  /**
   * @param {number[]} objects
   * @param {number} gaussians
   */
  group(objects, gaussians) {
    const { name } = this.viewer.scene.names[objects[0]];
    const title = this.line(name, `${objects.length} × ${grouped(gaussians)}`, objects);
    const body = element("div", { className: "members" });
    const isOpen = objects.length <= OPEN_UP_TO;
    const fold = element("button", { className: "fold", type: "button", title: "Show or hide the list" });
    const fill = (/** @type {boolean} */ open) => {
      if (open && body.childElementCount === 0) {
        body.append(...objects.map((k) => this.line(`${name} ${this.viewer.scene.names[k].id}`, "", [k])));
        this.refresh();
      }
      body.hidden = !open;
      fold.setAttribute("aria-expanded", String(open));
      fold.setAttribute("aria-label", `Instances of ${name}`);
    };
    fold.onclick = () => fill(body.hidden === true);
    title.prepend(fold);
    body.hidden = true;
    if (isOpen) queueMicrotask(() => fill(true));
    return element("section", {}, [title, body]);
  }

  /**
   * A line that selects objects, and an eye that hides them.
   * @param {string} label
   * @param {string} note
   * @param {number[]} objects
   */
  line(label, note, objects) {
    const select = element("button", { className: "name", type: "button" }, [
      element("span", { textContent: label }), element("small", { textContent: note }),
    ]);
    select.onclick = () => this.toggle(objects);
    const dot = element("span", { className: "dot" });
    const eye = element("button", { className: "eye", type: "button" });
    eye.onclick = () => this.viewer.setLook(objects, { shown: !this.isShown(objects) });
    const mark = element("div", { className: "line" }, [dot, select, eye]);
    eye.addEventListener("click", () => this.refresh());
    this.lines.push({ label, objects, mark });
    return mark;
  }

  /** @param {number[]} objects */
  isShown(objects) {
    return objects.some((object) => this.viewer.looks.get(object)?.shown);
  }

  /** @param {number[]} objects */
  isSelected(objects) {
    const { selected } = this.viewer;
    return selected.size === objects.length && objects.every((object) => selected.has(object));
  }

  /**
   * Selects objects, or nothing if just these are selected.
   * @param {number[]} objects
   */
  toggle(objects) {
    this.viewer.select(this.isSelected(objects) ? [] : objects);
    this.refresh();
    const line = this.lines.find(({ objects: of }) => this.isSelected(of));
    line?.mark.scrollIntoView({ block: "nearest" });
  }

  connectSelection() {
    const { viewer } = this;
    const acts = {
      "hide-selected": () => this.hideSelected(),
      "only-selected": () => {
        const others = [...viewer.looks.keys()].filter((object) => !viewer.selected.has(object));
        viewer.setLook(others, { shown: false });
        viewer.setLook(viewer.selected, { shown: true });
      },
      "whole-group": () => {
        const [first] = viewer.selected;
        const template = viewer.scene.names[first]?.template;
        viewer.select([...viewer.scene.names.keys()].filter((k) => viewer.scene.names[k].template === template));
      },
      "uncolour": () => viewer.setLook(viewer.selected, { tint: null }),
      "show-all": () => viewer.setLook(viewer.looks.keys(), { shown: true }),
      "deselect": () => viewer.select([]),
    };
    for (const [id, act] of Object.entries(acts)) {
      byId(id).addEventListener("click", () => {
        act();
        this.refresh();
      });
    }
    // A browser tells of changes alone: the colour that is shown is given when it is clicked, as it may be the wanted one.
    for (const event of ["click", "input"]) {
      this.colour.addEventListener(event, () => {
        viewer.setLook(viewer.selected, { tint: rgbOf(this.colour.value) });
        this.refresh();
      });
    }
  }

  /** Hides what is selected, or shows it again. */
  hideSelected() {
    const { viewer } = this;
    viewer.setLook(viewer.selected, { shown: !this.isShown([...viewer.selected]) });
    this.refresh();
  }

  /** Brings list and buttons to what the picture shows. */
  refresh() {
    const { viewer } = this;
    for (const { objects, mark, label } of this.lines) {
      const shown = this.isShown(objects);
      mark.classList.toggle("hidden", !shown);
      mark.classList.toggle("selected", this.isSelected(objects));
      mark.querySelector(".name")?.setAttribute("aria-pressed", String(this.isSelected(objects)));
      const eye = mark.querySelector(".eye");
      eye?.setAttribute("aria-label", `${shown ? "Hide" : "Show"} ${label}`);
      eye?.setAttribute("title", shown ? "Hide" : "Show");
      const tints = new Set(objects.map((object) => String(viewer.looks.get(object)?.tint ?? "")));
      const tint = tints.size === 1 ? viewer.looks.get(objects[0])?.tint : null;
      const dot = /** @type {HTMLElement | null} */ (mark.querySelector(".dot"));
      if (dot) dot.style.background = tint ? hexOf(tint) : "";
    }
    const chosen = [...viewer.selected];
    // Without a colour of its own the last one is shown, so that it can be given again.
    const tint = viewer.looks.get(chosen[0])?.tint;
    if (tint) this.colour.value = hexOf(tint);
    byId("selection").hidden = chosen.length === 0;
    byId("selected-name").textContent = this.nameOf(chosen);
    byId("whole-group").hidden = chosen.length !== 1 || chosen[0] === BACKGROUND;
    byId("hide-selected").textContent = chosen.length > 0 && !this.isShown(chosen) ? "Show" : "Hide";
    byId("uncolour").hidden = !chosen.some((object) => viewer.looks.get(object)?.tint);
    byId("show-all").hidden = [...viewer.looks.values()].every((look) => look.shown);
  }

  /** @param {number[]} objects */
  nameOf(objects) {
    if (objects.length === 0) return "";
    if (objects[0] === BACKGROUND) return "Background";
    const { name, id } = this.viewer.scene.names[objects[0]];
    return objects.length === 1 ? `${name} ${id}` : `${name}: all ${objects.length}`;
  }
}
