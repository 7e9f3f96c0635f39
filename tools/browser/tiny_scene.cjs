// A scene of a few hundred Gaussians as .glb (binary glTF with KHR_gaussian_splatting): four balls of one shape on a floor. Their
// meshes share the accessors of scale, rotation and SH of degree 1, and have their own positions, opacities and colours, so that
// instgs-vk reads a template with four instances and offsets. Axes are glTF's: y up, right-handed.
"use strict";

const EXTENSION = "KHR_gaussian_splatting";
const BALL = 160;
const FLOOR_SIDE = 15;
const SH_0 = 0.28209479177387814;
const FLOAT = 5126;
const POINTS = 0;
const ARRAY_BUFFER = 34962;
const TYPES = { 1: "SCALAR", 3: "VEC3", 4: "VEC4" };

/** The quaternion (x, y, z, w) that turns z to a unit vector. */
function towards([x, y, z]) {
  const q = z > -0.999 ? [-y, x, 0, 1 + z] : [1, 0, 0, 0];
  const length = Math.hypot(...q);
  return q.map((v) => v / length);
}

/** Coefficient of degree 0 of a colour from 0 to 1. */
const dc = (rgb) => rgb.map((v) => (v - 0.5) / SH_0);

/** A point of the unit sphere for each Gaussian. */
const DIRECTIONS = Array.from({ length: BALL }, (_, i) => {
  const y = 1 - (2 * i + 1) / BALL;
  const angle = 2.399963229728653 * i;
  const ring = Math.sqrt(1 - y * y);
  return [ring * Math.cos(angle), y, ring * Math.sin(angle)];
});

/** Flat discs on a sphere, striped, brighter from one side of the ball's own frame: SH must turn with the ball. */
const SHAPE = {
  SCALE: DIRECTIONS.map(() => [0.11, 0.11, 0.02]),
  ROTATION: DIRECTIONS.map(towards),
  SH_DEGREE_1_COEF_0: DIRECTIONS.map(() => [0.3, 0.0, 0.0]),
  SH_DEGREE_1_COEF_1: DIRECTIONS.map(() => [0.0, 0.0, 0.4]),
  SH_DEGREE_1_COEF_2: DIRECTIONS.map(() => [0.0, 0.25, 0.0]),
};

/** What a ball has of its own: it is a little higher or flatter than the others, and has its own colours. */
function ball(color, height) {
  return {
    POSITION: DIRECTIONS.map(([x, y, z]) => [0.5 * x, 0.5 * height * y, 0.5 * z]),
    OPACITY: DIRECTIONS.map(() => [0.9]),
    SH_DEGREE_0_COEF_0: DIRECTIONS.map(([x]) => dc(Math.sin(9 * x) > 0 ? color : color.map((v) => 0.35 * v))),
  };
}

const AXIS = Math.SQRT1_2;
const BALLS = [
  { name: "red", own: ball([0.9, 0.2, 0.15], 1), at: [-1.4, 0.5, 1.6], rotation: [0, 0, 0, 1], scale: 1 },
  { name: "green", own: ball([0.2, 0.8, 0.3], 0.8), at: [1.3, 0.5, 0.4], rotation: [0, AXIS, 0, AXIS], scale: 1.2 },
  { name: "blue", own: ball([0.2, 0.35, 0.95], 1.2), at: [-1.1, 0.7, -1.2], rotation: [AXIS, 0, 0, AXIS], scale: 1.1 },
  { name: "yellow", own: ball([0.95, 0.85, 0.2], 1), at: [1.2, 0.4, -2.4], rotation: [0.5, 0.5, -0.5, 0.5], scale: 0.9 },
];

/** A chequered floor that reaches from in front of all balls to behind them. */
function floor() {
  const cells = Array.from({ length: FLOOR_SIDE ** 2 }, (_, i) => [i % FLOOR_SIDE, Math.floor(i / FLOOR_SIDE)]);
  const middle = (FLOOR_SIDE - 1) / 2;
  return {
    POSITION: cells.map(([i, k]) => [0.45 * (i - middle), -0.1, 0.45 * (k - middle)]),
    SCALE: cells.map(() => [0.2, 0.02, 0.2]),
    ROTATION: cells.map(() => [0, 0, 0, 1]),
    OPACITY: cells.map(() => [0.95]),
    SH_DEGREE_0_COEF_0: cells.map(([i, k]) => dc((i + k) % 2 ? [0.7, 0.7, 0.72] : [0.3, 0.33, 0.4])),
    ...Object.fromEntries([0, 1, 2].map((c) => [`SH_DEGREE_1_COEF_${c}`, cells.map(() => [0, 0, 0])])),
  };
}

/** A file to which meshes are added. */
class GlbFile {
  #chunks = [];
  #length = 0;
  #json = {
    asset: { version: "2.0", generator: "tools/check_viewers" },
    extensionsUsed: [EXTENSION],
    scene: 0,
    scenes: [{ nodes: [] }],
    nodes: [],
    meshes: [],
    accessors: [],
    bufferViews: [],
  };

  #accessor(rows) {
    const bytes = Buffer.from(new Float32Array(rows.flat()).buffer);
    this.#json.bufferViews.push({ buffer: 0, byteOffset: this.#length, byteLength: bytes.length, target: ARRAY_BUFFER });
    const bounds = (fold) => rows[0].map((_, k) => Math.fround(fold(...rows.map((row) => row[k]))));
    this.#json.accessors.push({ bufferView: this.#json.bufferViews.length - 1, componentType: FLOAT, count: rows.length,
      type: TYPES[rows[0].length], min: bounds(Math.min), max: bounds(Math.max) });
    this.#chunks.push(bytes);
    this.#length += bytes.length;
    return this.#json.accessors.length - 1;
  }

  /** Attributes by name, from columns by the extension's names. */
  attributes(columns) {
    const named = Object.entries(columns).map(([name, rows]) =>
      [name === "POSITION" ? name : `${EXTENSION}:${name}`, this.#accessor(rows)]);
    return Object.fromEntries(named);
  }

  /** Adds a mesh and its node. */
  place(name, attributes, node = {}) {
    const kind = { kernel: "ellipse", colorSpace: "srgb_rec709_display", projection: "perspective", sortingMethod: "cameraDistance" };
    this.#json.meshes.push({ name, primitives: [{ attributes, mode: POINTS, extensions: { [EXTENSION]: kind } }] });
    this.#json.scenes[0].nodes.push(this.#json.nodes.length);
    this.#json.nodes.push({ name, mesh: this.#json.meshes.length - 1, ...node });
  }

  bytes() {
    const padded = (buffer, by) => Buffer.concat([buffer, Buffer.alloc((4 - (buffer.length % 4)) % 4, by)]);
    const words = (...values) => Buffer.from(new Uint32Array(values).buffer);
    const chunk = (kind, bytes) => Buffer.concat([words(bytes.length), Buffer.from(kind, "latin1"), bytes]);
    const json = JSON.stringify({ ...this.#json, buffers: [{ byteLength: this.#length }] });
    const body = Buffer.concat([chunk("JSON", padded(Buffer.from(json), " ")), chunk("BIN\0", Buffer.concat(this.#chunks))]);
    return Buffer.concat([Buffer.from("glTF", "latin1"), words(2, 12 + body.length), body]);
  }
}

/** The bytes of a file with four balls of one shape, on a floor or without it. */
function tinyScene(withFloor) {
  const file = new GlbFile();
  const shape = file.attributes(SHAPE);
  for (const { name, own, at, rotation, scale } of BALLS) {
    file.place(name, { ...file.attributes(own), ...shape }, { translation: at, rotation, scale: [scale, scale, scale] });
  }
  if (withFloor) file.place("floor", file.attributes(floor()));
  return file.bytes();
}

/**
 * The bytes of the smallest file that shows how viewers order meshes: a red Gaussian, which occurs twice, before a grey one, whose
 * mesh has another grey one near the first camera, so that the middle of the grey mesh is nearer than the red Gaussian.
 */
function smallestScene() {
  const mesh = (positions, size, color) => ({
    POSITION: positions,
    SCALE: positions.map(() => [size, size, size]),
    ROTATION: positions.map(() => [0, 0, 0, 1]),
    OPACITY: positions.map(() => [0.99]),
    SH_DEGREE_0_COEF_0: positions.map(() => dc(color)),
  });
  const file = new GlbFile();
  const red = file.attributes(mesh([[0, 0, 0]], 0.3, [0.9, 0.2, 0.15]));
  file.place("red", red, { translation: [0, 0, -1.5] });
  file.place("red", red, { translation: [-1.2, 0, 1] });
  file.place("grey", file.attributes(mesh([[0, 0, -2.5], [1.2, 0.3, 2.5]], 0.5, [0.6, 0.6, 0.6])));
  return file.bytes();
}

/** Cameras of instgs-vk that look at the scene, whose axes after reading are right, down, front. */
function tinyCameras() {
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((v) => v / Math.hypot(...a));
  const lookAt = (eye, target) => {
    const forward = unit(target.map((v, k) => v - eye[k]));
    const right = unit(cross([0, 1, 0], forward));
    const row = (axis) => [...axis, -axis.reduce((sum, v, k) => sum + v * eye[k], 0)];
    return [row(right), row(cross(forward, right)), row(forward), [0, 0, 0, 1]];
  };
  const eyes = [[0.4, -2.6, -5.6], [5.2, -2.2, 1.0], [-2.0, -3.0, 5.0]];
  return eyes.map((eye, i) => ({ name: `view${i}`, width: 320, height: 240, fx: 290, fy: 290, cx: 160, cy: 120,
    view_from_world: lookAt(eye, [0, -0.2, 0.3]) }));
}

module.exports = { smallestScene, tinyCameras, tinyScene };
