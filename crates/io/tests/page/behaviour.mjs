// Cameras, keys and faults of the page, without a browser: what these modules ask of one stands in for it here.

import assert from "node:assert/strict";

const listeners = new Map();
const listen = (name, act) => listeners.set(name, act);
const dispatch = (name, event) => listeners.get(name)(event);
globalThis.Element = class {
  constructor(fits = "") { this.fits = fits; }
  closest(selector) { return selector.split(", ").includes(this.fits) ? this : null; }
};
globalThis.window = { devicePixelRatio: 1, addEventListener: listen };
globalThis.document = { body: Object.assign(new Element(), { classList: { toggle() {} } }), fullscreenElement: null };
globalThis.ResizeObserver = class { observe() {} };
let ratioChanged = () => {};
globalThis.matchMedia = () => ({ addEventListener: (_, act) => { ratioChanged = act; } });
const frames = [];
globalThis.requestAnimationFrame = (act) => frames.push(act);
/** Draws all frames that are due, and lets what waits for them go on. */
async function drawn() {
  for (let i = 0; i < 5; i++) {
    frames.splice(0).forEach((act) => act());
    await new Promise((resolve) => setImmediate(resolve));
  }
}

const { Camera, viewOf, wholeCamera } = await import("../../web/camera.js");
const { Controls } = await import("../../web/controls.js");
const { cross, dot, unit } = await import("../../web/linear.js");
const { rowTexels } = await import("../../web/textures.js");
const { Viewer } = await import("../../web/viewer.js");

const UP = [0, 0, 1];
const NEAR = 0.2;
/** A camera 5 above the origin that looks along `forward`, with what lies at its right. */
function cameraOf(forward, right) {
  const eye = [0, 0, 5];
  const row = (axis) => [...axis, -dot(axis, eye)];
  const view_from_world = [row(right), row(cross(forward, right)), row(forward), [0, 0, 0, 1]];
  return { width: 80, height: 60, fx: 70, fy: 70, cx: 40, cy: 30, view_from_world };
}
const startOf = (camera) => ({ camera, center: [0, 0, 0], distance: 5, up: UP });
const degrees = (a, b) => (Math.acos(Math.min(1, dot(a, b))) * 180) / Math.PI;

/** Straight down, nearly, straight up, and level: each with two horizons where the view has none. */
function firstViews() {
  const down = [0, 0, -1];
  for (const forward of [down, unit([0.001, 0, -1]), unit([0.03, 0.02, -1]), [0, 0, 1], unit([1, 2, 0.3])]) {
    for (const aside of [[1, 0, 0], [0, 1, 0], [-1, 0, 0]]) {
      const level = Math.abs(forward[2]) < 0.9;
      const right = unit(cross(forward, level ? UP : cross(aside, forward)));
      const { axes, file } = (() => {
        const camera = new Camera(startOf(cameraOf(forward, right)), NEAR);
        return { axes: camera.axes(), file: camera.file(80, 60) };
      })();
      assert.ok(viewOf(file, NEAR).view.every(Number.isFinite), `the view along ${forward} is a number`);
      assert.ok(degrees(axes.forward, forward) < 7, `the first view looks along ${forward}, not ${axes.forward}`);
      assert.ok(degrees(axes.right, right) < 7, `${right} is at the right of the first view, not ${axes.right}`);
      wholeCamera(file);
    }
  }
  const camera = new Camera(startOf(null), NEAR);
  camera.lookAt([camera.position[0], camera.position[1], -4]);
  assert.ok(camera.file(8, 6).view_from_world.flat().every(Number.isFinite), "a point straight below can be looked at");
}

function whatIsNoCamera() {
  const whole = cameraOf([0, 0, -1], [1, 0, 0]);
  assert.equal(wholeCamera(whole), whole);
  assert.equal(wholeCamera([whole, {}]), whole);
  const rows = whole.view_from_world;
  const broken = [
    null, 3, "x", [], {}, [null], { ...whole, width: 0 }, { ...whole, height: 1.5 }, { ...whole, width: 20000 },
    { ...whole, fx: -1 }, { ...whole, fy: "7" }, { ...whole, cx: null }, { ...whole, view_from_world: rows.slice(0, 3) },
    { ...whole, view_from_world: rows.map((row) => row.slice(0, 3)) },
    { ...whole, view_from_world: rows.map(() => [0, 0, 0, 0]) },
  ];
  for (const given of broken) assert.throws(() => wholeCamera(given), /not whole/, JSON.stringify(given));
}

/** A viewer whose worker answers when it is told to. */
function viewerOf(changes = {}) {
  const worker = { asked: [], postMessage(message) { this.asked.push(message); } };
  const renderer = { sortsItself: false, drawn: 0, draw() { this.drawn++; }, setOrder() {}, setLook() {}, ...changes };
  const canvas = { clientWidth: 80, clientHeight: 60, style: {}, addEventListener() {} };
  const scene = { names: [], rows: [], near: NEAR };
  const told = [];
  const start = startOf(cameraOf([0, 1, 0], [1, 0, 0]));
  const viewer = new Viewer(canvas, worker, scene, start, renderer, (error) => told.push(error.message));
  const answer = (more) => worker.onmessage({ data: { id: worker.asked.shift().id, ...more } });
  return { viewer, worker, renderer, told, answer };
}

async function picturesAndFaults() {
  const { viewer, worker, renderer, told, answer } = viewerOf();
  assert.throws(() => viewer.setFixed({}), /not whole/);
  assert.throws(() => viewer.setFixed([]), /not whole/);
  assert.equal(viewer.fixed, null, "a camera that is none changes nothing");
  const settled = viewer.settled();
  await drawn();
  answer({ order: new Uint32Array(0), count: 0 });
  await drawn();
  await settled;
  const before = renderer.drawn;
  ratioChanged();
  await drawn();
  assert.equal(renderer.drawn, before + 1, "another pixel ratio is drawn for");
  const whole = cameraOf([0, 0, -1], [1, 0, 0]);
  const refused = assert.rejects(viewer.setFixed([whole]), /no memory/);
  await drawn();
  assert.equal(viewer.fixed, whole);
  answer({ error: "no memory" });
  await refused;
  await assert.rejects(viewer.settled(), /no memory/);
  await assert.rejects(viewer.pick(1, 1), /no memory/);
  assert.deepEqual([told, viewer.isSorting], [["no memory"], false]);
  const undrawn = viewerOf({ draw() { throw new Error("lost"); } });
  const stopped = viewerOf();
  for (const other of [undrawn, stopped]) {
    const waiting = assert.rejects(other.viewer.settled(), /lost/);
    if (other === stopped) other.worker.onerror({ message: "lost" });
    await drawn();
    await waiting;
    assert.deepEqual(other.told, ["lost"], "a fault is told of once");
  }
  assert.equal(worker.asked.length, 0);
}

async function keys() {
  const { viewer, answer } = viewerOf({ sortsItself: true });
  const pressed = [];
  const controls = new Controls(viewer, { click() {}, doubleClick() {}, key: (code) => pressed.push(code) }, false);
  const press = (code, more = {}) => dispatch("keydown", event(code, more));
  const release = (code, more = {}) => dispatch("keyup", event(code, more));
  const event = (code, more) => ({ code, key: code, shiftKey: false, target: document.body, preventDefault() {}, ...more });
  const { camera } = viewer;
  /** What a key does while it is held for a tenth of a second. */
  const held = (code, more = {}) => {
    camera.reset();
    press(code, more);
    controls.flownAt = performance.now() - 100;
    release(code, more);
    return { moved: dot(camera.position, camera.position), forward: camera.forward };
  };
  const shift = { shiftKey: true };
  const still = held("KeyX");
  assert.notEqual(held("ArrowUp").moved, still.moved, "arrows move");
  const right = held("ArrowRight", shift);
  assert.ok(right.forward[0] > 0.1 && Math.abs(right.forward[2]) < 1e-9, `Shift and an arrow turn, to ${right.forward}`);
  assert.ok(held("ArrowUp", shift).forward[2] > 0.1, "and up");
  controls.isFlying = true;
  assert.ok(held("ArrowRight", shift).forward[0] > 0.1 && held("ArrowRight", shift).moved === still.moved, "or the head turns");
  controls.isFlying = false;
  for (const [key, sign] of [["+", -1], ["=", -1], ["-", 1], ["_", 1]]) {
    camera.reset();
    const before = camera.distance;
    press("", { key });
    assert.ok(sign * (camera.distance - before) > 0, `${key} changes the distance`);
  }
  press("KeyW", shift);
  assert.equal(controls.isFast, true);
  release("ShiftLeft", { key: "Shift" });
  assert.deepEqual([controls.isFast, controls.held.size], [false, 1], "without Shift, W goes on slowly");
  press("MetaLeft", { key: "Meta", metaKey: true });
  assert.equal(controls.held.size, 0, "Meta lets go of what its keys would not");
  press("KeyW", { target: new Element('input:not([type="color"])') });
  assert.equal(controls.held.size, 0, "who types does not fly");
  press("KeyW", { target: new Element("input") });
  assert.equal(controls.held.size, 1, "the field of a colour swallows no keys");
  release("KeyW");
  pressed.length = 0;
  ["Escape", "KeyH"].forEach((code) => press(code, { target: new Element("input") }));
  press("Escape");
  assert.deepEqual(pressed, ["KeyH", "Escape"], "Escape in a field closes what the field has opened, and no more");
  await drawn();
  assert.ok(answer, "nothing is asked of the worker");
}

function rowsBeyondFloats() {
  const matrix = new Array(12).fill(0);
  const row = { owner: 0, first: 2 ** 24, count: 1, firstOffset: -1, world: matrix, colour: matrix };
  assert.equal(rowTexels([row]).data[28], 2 ** 24);
  assert.throws(() => rowTexels([{ ...row, first: 2 ** 24 + 1 }]), /more Gaussians/);
}

firstViews();
whatIsNoCamera();
rowsBeyondFloats();
await picturesAndFaults();
await keys();
process.stdout.write("all is well\n");
