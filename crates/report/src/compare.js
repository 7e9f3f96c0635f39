// Puts the rendering of a test view over its photograph, with a divider that the pointer or the keys move. Without scripts the two
// stand side by side. This file holds no ampersand and no angle bracket, so that the page stays well-formed XML.
"use strict";
for (const trio of document.querySelectorAll(".trio[data-view]")) {
  const [left, right] = trio.querySelectorAll("figure");
  const [photo, render] = [left, right].map((figure) => figure.querySelector("img"));
  const figure = document.createElement("figure");
  const slider = document.createElement("div");
  slider.className = "slider";
  slider.style.setProperty("--ratio", photo.getAttribute("width") / photo.getAttribute("height"));
  // The keys, and what screen readers say, are those of a range; the pointer may be anywhere on the pictures.
  const range = document.createElement("input");
  Object.assign(range, { type: "range", min: 0, max: 100, step: 1, value: 50 });
  range.setAttribute("aria-label", trio.dataset.view + ": photograph on the left, rendering on the right of the divider");
  const show = (percent) => {
    range.value = percent;
    range.setAttribute("aria-valuetext", Math.round(percent) + " % photograph");
    slider.style.setProperty("--at", percent + "%");
  };
  const follow = (event) => {
    const box = slider.getBoundingClientRect();
    show(Math.min(100, Math.max(0, (100 * (event.clientX - box.left)) / box.width)));
  };
  slider.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    event.preventDefault();
    range.focus({ preventScroll: true });
    slider.setPointerCapture(event.pointerId);
    follow(event);
  });
  slider.addEventListener("pointermove", (event) => {
    if (slider.hasPointerCapture(event.pointerId)) follow(event);
  });
  range.addEventListener("input", () => show(Number(range.value)));
  render.className = "over";
  const divider = document.createElement("span");
  divider.className = "divider";
  const caption = document.createElement("figcaption");
  caption.className = "ends";
  caption.append(...[left, right].map((of) => {
    const name = document.createElement("span");
    name.textContent = of.querySelector("figcaption").textContent;
    return name;
  }));
  slider.append(photo, render, range, divider);
  figure.append(slider, caption);
  left.replaceWith(figure);
  right.remove();
  trio.classList.add("compared");
  show(50);
}
