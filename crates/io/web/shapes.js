// Sizes and rotations from logarithms of covariances, as scenes packed as `small` hold them: the twin of src/math/log_covariance.rs
// and crates/io/src/small/shapes.rs, decoding only. Scenes have millions of these: the solver's numbers
// are in arrays that stay.

const ORDERS = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
const SWEEPS = 12;
const CONVERGED = 1e-24;
const [ROOT_2, ROOT_3, ROOT_6] = [2, 3, 6].map(Math.sqrt);

/**
 * Quaternions (w, x, y, z) and logarithms of standard deviations of rows of six coordinates.
 * @param {Float32Array} coordinates
 */
export function shapesFrom(coordinates) {
  const rows = coordinates.length / 6;
  const [quats, logScales] = [new Float32Array(4 * rows), new Float32Array(3 * rows)];
  const solver = new ShapeSolver();
  for (let row = 0; row < rows; row++) {
    for (let i = 0; i < 6; i++) solver.coordinates[i] = coordinates[6 * row + i];
    solver.solve();
    quats.set(solver.quat, 4 * row);
    logScales.set(solver.logScales, 3 * row);
  }
  return { quats, logScales };
}

/**
 * Offsets of quaternions and of logarithms of standard deviations, of records that add six coordinates to those of their template's
 * Gaussian; 0 for a record that none has.
 * @param {Float32Array} coordinates
 * @param {{quats: Float32Array, logScales: Float32Array}} templates
 * @param {{first: number, count: number, firstOffset: number}[]} runs
 */
export function offsetShapesFrom(coordinates, templates, runs) {
  const records = coordinates.length / 6;
  const [quats, logScales] = [new Float32Array(4 * records), new Float32Array(3 * records)];
  // Copies of an instance share records.
  const sourceOf = new Int32Array(records).fill(-1);
  for (const { first, count, firstOffset } of runs) {
    for (let local = 0; firstOffset >= 0 && local < count; local++) sourceOf[firstOffset + local] = first + local;
  }
  const solver = new ShapeSolver();
  sourceOf.forEach((source, record) => {
    if (source < 0) return;
    const quat = templates.quats.subarray(4 * source, 4 * source + 4);
    const sizes = templates.logScales.subarray(3 * source, 3 * source + 3);
    const length = Math.hypot(quat[0], quat[1], quat[2], quat[3]);
    if (!(length > 0) || !Number.isFinite(length + sizes[0] + sizes[1] + sizes[2])) return;
    solver.beNear(quat, length);
    solver.setLogCovariance(sizes);
    for (let i = 0; i < 6; i++) solver.coordinates[i] += coordinates[6 * record + i];
    solver.solve();
    for (let i = 0; i < 4; i++) quats[4 * record + i] = length * solver.quat[i] - quat[i];
    for (let i = 0; i < 3; i++) logScales[3 * record + i] = solver.logScales[i] - sizes[i];
  });
  return { quats, logScales };
}

/** Finds the shape of six coordinates whose axes are the nearest to those of a rotation. */
class ShapeSolver {
  coordinates = new Float64Array(6);
  /** The results: a unit quaternion (w, x, y, z), and logarithms of standard deviations. */
  quat = new Float64Array(4);
  logScales = new Float64Array(3);
  /** The rotation to be near: w, x, y, z, and the axes that it turns x, y and z into, one after another. */
  near = Float64Array.of(1, 0, 0, 0);
  nearAxes = Float64Array.of(1, 0, 0, 0, 1, 0, 0, 0, 1);
  /** Symmetric matrix, and its axes, one after another. */
  matrix = new Float64Array(9);
  axes = new Float64Array(9);
  /** Component of each axis along each of those to be near. */
  along = new Float64Array(9);
  directed = new Float64Array(9);

  /**
   * @param {Float32Array} quat
   * @param {number} length of it
   */
  beNear(quat, length) {
    const [w, x, y, z] = [quat[0] / length, quat[1] / length, quat[2] / length, quat[3] / length];
    this.near.set([w, x, y, z]);
    this.nearAxes.set([
      1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
      2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
      2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y),
    ]);
  }

  /**
   * The coordinates of the shape with these sizes along the axes to be near.
   * @param {Float32Array} logScales
   */
  setLogCovariance(logScales) {
    const axes = this.nearAxes;
    const at = (/** @type {number} */ i, /** @type {number} */ j) =>
      2 * (logScales[0] * axes[i] * axes[j] + logScales[1] * axes[3 + i] * axes[3 + j] + logScales[2] * axes[6 + i] * axes[6 + j]);
    const [x, y, z] = [at(0, 0), at(1, 1), at(2, 2)];
    const c = this.coordinates;
    c[0] = (x + y + z) / ROOT_3;
    c[1] = (x - y) / ROOT_2;
    c[2] = (x + y - 2 * z) / ROOT_6;
    c[3] = ROOT_2 * at(1, 2);
    c[4] = ROOT_2 * at(0, 2);
    c[5] = ROOT_2 * at(0, 1);
  }

  solve() {
    this.findAxes();
    const { axes, near, nearAxes, along, directed, quat } = this;
    for (let k = 0; k < 3; k++) {
      for (let axis = 0; axis < 3; axis++) {
        let sum = 0;
        for (let i = 0; i < 3; i++) sum += nearAxes[3 * k + i] * axes[3 * axis + i];
        along[3 * k + axis] = sum;
      }
    }
    let [order, most] = [ORDERS[0], -1];
    for (const other of ORDERS) {
      const sum = Math.abs(along[other[0]]) + Math.abs(along[3 + other[1]]) + Math.abs(along[6 + other[2]]);
      if (sum > most) [order, most] = [other, sum];
    }
    for (let k = 0; k < 3; k++) {
      const sign = along[3 * k + order[k]] < 0 ? -1 : 1;
      for (let i = 0; i < 3; i++) directed[3 * k + i] = sign * axes[3 * order[k] + i];
      this.logScales[k] = this.matrix[4 * order[k]] / 2;
    }
    setQuat(quat, directed);
    const dot = quat[0] * near[0] + quat[1] * near[1] + quat[2] * near[2] + quat[3] * near[3];
    if (dot < 0) for (let i = 0; i < 4; i++) quat[i] *= -1;
  }

  /** Makes the matrix of the coordinates diagonal by Jacobi's method, with its axes. */
  findAxes() {
    const { coordinates, matrix, axes } = this;
    const mean = coordinates[0] / ROOT_3;
    const [half, third] = [coordinates[1] / ROOT_2, coordinates[2] / ROOT_6];
    matrix[0] = mean + half + third;
    matrix[4] = mean - half + third;
    matrix[8] = mean - 2 * third;
    matrix[5] = coordinates[3] / ROOT_2;
    matrix[2] = coordinates[4] / ROOT_2;
    matrix[1] = coordinates[5] / ROOT_2;
    axes.fill(0);
    axes[0] = axes[4] = axes[8] = 1;
    for (let sweep = 0; sweep < SWEEPS; sweep++) {
      const off = matrix[1] * matrix[1] + matrix[2] * matrix[2] + matrix[5] * matrix[5];
      const on = matrix[0] * matrix[0] + matrix[4] * matrix[4] + matrix[8] * matrix[8];
      if (off <= CONVERGED * on) break;
      this.turn(0, 1, 2, 5);
      this.turn(0, 2, 1, 5);
      this.turn(1, 2, 1, 2);
    }
  }

  /**
   * Turns in the plane of axes p < q so that the number of both becomes 0.
   * @param {number} p
   * @param {number} q
   * @param {number} toP where the number of p and the third axis is
   * @param {number} toQ where that of q and the third axis is
   */
  turn(p, q, toP, toQ) {
    const { matrix, axes } = this;
    const off = matrix[3 * p + q];
    const apart = matrix[4 * q] - matrix[4 * p];
    const reach = Math.abs(apart) + Math.sqrt(apart * apart + 4 * off * off);
    const tan = reach > 0 ? (apart < 0 ? -2 : 2) * (off / reach) : 0;
    const cos = 1 / Math.sqrt(1 + tan * tan);
    const sin = tan * cos;
    matrix[4 * p] -= tan * off;
    matrix[4 * q] += tan * off;
    matrix[3 * p + q] = 0;
    const [ofP, ofQ] = [matrix[toP], matrix[toQ]];
    matrix[toP] = cos * ofP - sin * ofQ;
    matrix[toQ] = sin * ofP + cos * ofQ;
    for (let i = 0; i < 3; i++) {
      const [x, y] = [axes[3 * p + i], axes[3 * q + i]];
      axes[3 * p + i] = cos * x - sin * y;
      axes[3 * q + i] = sin * x + cos * y;
    }
  }
}

/**
 * The unit quaternion (w, x, y, z) of a rotation, whose largest component is positive.
 * @param {Float64Array} out
 * @param {Float64Array} m the axes that it turns x, y and z into, one after another
 */
function setQuat(out, m) {
  // These are 4 w^2, 4 x^2, 4 y^2, 4 z^2.
  const [w, x, y, z] = [1 + m[0] + m[4] + m[8], 1 + m[0] - m[4] - m[8], 1 - m[0] + m[4] - m[8], 1 - m[0] - m[4] + m[8]];
  const most = Math.max(w, x, y, z);
  const row = (/** @type {number} */ a, /** @type {number} */ b, /** @type {number} */ c, /** @type {number} */ d) => {
    const length = Math.sqrt(a * a + b * b + c * c + d * d);
    out[0] = a / length;
    out[1] = b / length;
    out[2] = c / length;
    out[3] = d / length;
  };
  if (most === w) row(w, m[5] - m[7], m[6] - m[2], m[1] - m[3]);
  else if (most === x) row(m[5] - m[7], x, m[3] + m[1], m[6] + m[2]);
  else if (most === y) row(m[6] - m[2], m[3] + m[1], y, m[7] + m[5]);
  else row(m[1] - m[3], m[6] + m[2], m[7] + m[5], z);
}
