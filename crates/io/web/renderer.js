// Draws the scene with WebGL2: projects each splat once, draws them as quads from the farthest to the nearest into a picture of
// half floats, and that over the background.

import { viewOf } from "./camera.js";
import { TEXTURE_WIDTH, constantsOf, writeLook } from "./layout.js";

const GEOMETRY_UNIT = 0;
const SH_UNIT = 1;
const OFFSETS_UNIT = 2;
const ROWS_UNIT = 3;
const BLENDED_UNIT = 4;

const LIST_UNIT = 5;
/** Texture units of what project.frag writes for a splat, and their names in quad.vert. */
const PROJECTED = [{ unit: 6, name: "u_place" }, { unit: 7, name: "u_color" }, { unit: 8, name: "u_reach" }];
/** Splats in each instance of the draw call. */
const BATCH = 1024;

/**
 * Sources by the names of their files.
 * @typedef {{"project-frag": string, "quad-vert": string, "quad-frag": string, "screen-vert": string,
 *   "screen-frag": string}} Shaders
 */
/** @typedef {import("./camera.js").CameraFile} CameraFile */

export class Renderer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {any} scene the worker's answer
   * @param {Shaders} shaders
   */
  constructor(canvas, scene, shaders) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser offers no WebGL2, which the picture needs");
    this.gl = gl;
    this.canvas = canvas;
    this.scene = scene;
    this.count = 0;
    /** The worker sorts for it. */
    this.sortsItself = false;
    this.background = [0, 0, 0];
    /** Brightness of what is not selected. */
    this.dim = 1;
    const { texels } = scene;
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (Math.max(texels.geometry.height, texels.sh.height, texels.offsets.height, linesOf(scene.count)) > most) {
      throw new Error("the scene has more Gaussians than this graphics card takes in one texture");
    }
    this.projection = program(gl, shaders["screen-vert"], withConstants(shaders["project-frag"], constantsOf(texels)));
    this.quads = program(gl, withConstants(shaders["quad-vert"], { BATCH }), shaders["quad-frag"]);
    this.screen = program(gl, shaders["screen-vert"], shaders["screen-frag"]);
    // For what is projected, and for blending: 8 bits, rounded splat by splat, would show in smooth places.
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("this browser cannot draw to floats, which the picture needs");
    texture(gl, GEOMETRY_UNIT, texels.geometry);
    texture(gl, SH_UNIT, texels.sh);
    texture(gl, OFFSETS_UNIT, texels.offsets);
    this.rowTexels = texels.rows;
    texture(gl, ROWS_UNIT, texels.rows);
    this.framebuffer = gl.createFramebuffer();
    this.blendedSize = [0, 0];
    /** Pairs of Gaussian and row, in whole lines of a texture. */
    this.list = new Uint32Array(2 * TEXTURE_WIDTH * linesOf(scene.count));
    this.projected = this.makeProjected();
    this.quadArray = this.arrayOfQuads();
    // Without attributes: the triangle over the picture.
    this.noAttributes = gl.createVertexArray();
    this.setConstants();
  }

  /** Two triangles for each quad of a batch. */
  arrayOfQuads() {
    const { gl } = this;
    const made = gl.createVertexArray();
    gl.bindVertexArray(made);
    const corners = Uint16Array.from({ length: 6 * BATCH }, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return made;
  }

  /** Room for the list, and for projected splats. */
  makeProjected() {
    const { gl } = this;
    const height = linesOf(this.scene.count);
    gl.activeTexture(gl.TEXTURE0 + LIST_UNIT);
    nearestTexture(gl);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RG32UI, TEXTURE_WIDTH, height);
    const made = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, made);
    PROJECTED.forEach(({ unit }, k) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      const to = nearestTexture(gl);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, TEXTURE_WIDTH, height);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, to, 0);
    });
    gl.drawBuffers(PROJECTED.map((_, k) => gl.COLOR_ATTACHMENT0 + k));
    return made;
  }

  setConstants() {
    const { gl, projection, screen, scene } = this;
    gl.useProgram(projection.program);
    gl.uniform1i(projection.at("u_list"), LIST_UNIT);
    gl.uniform1i(projection.at("u_geometry"), GEOMETRY_UNIT);
    gl.uniform1i(projection.at("u_sh"), SH_UNIT);
    gl.uniform1i(projection.at("u_offsets"), OFFSETS_UNIT);
    gl.uniform1i(projection.at("u_rows"), ROWS_UNIT);
    gl.uniform1f(projection.at("u_near"), scene.near);
    gl.uniform1f(projection.at("u_dilation_px2"), scene.dilation);
    gl.uniform1f(projection.at("u_antialias"), scene.antialias ? 1 : 0);
    gl.useProgram(this.quads.program);
    PROJECTED.forEach(({ unit, name }) => gl.uniform1i(this.quads.at(name), unit));
    gl.useProgram(screen.program);
    gl.uniform1i(screen.at("u_blended"), BLENDED_UNIT);
  }

  /**
   * Takes a new order.
   * @param {Uint32Array} list pairs of Gaussian and row, the farthest first
   * @param {number} count
   */
  setOrder(list, count) {
    const { gl } = this;
    this.list.set(list.subarray(0, 2 * count));
    gl.activeTexture(gl.TEXTURE0 + LIST_UNIT);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TEXTURE_WIDTH, linesOf(count), gl.RG_INTEGER, gl.UNSIGNED_INT, this.list);
    this.count = count;
  }

  /** @param {number} row @param {import("./layout.js").Look} look */
  setLook(row, look) {
    writeLook(this.rowTexels.data, row, look);
    this.rowsChanged = true;
  }

  /** @param {CameraFile} camera what is drawn; the canvas gets its size */
  draw(camera) {
    const { gl } = this;
    const { width, height } = camera;
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    if (this.rowsChanged) texture(gl, ROWS_UNIT, this.rowTexels);
    this.rowsChanged = false;
    this.sizeBlended(width, height);
    if (this.count > 0) this.project(camera);
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.quads.program);
    gl.uniform2f(this.quads.at("u_size_px"), width, height);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform1i(this.quads.at("u_count"), this.count);
    gl.bindVertexArray(this.quadArray);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * BATCH, gl.UNSIGNED_SHORT, 0, Math.ceil(this.count / BATCH));
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.BLEND);
    gl.useProgram(this.screen.program);
    gl.uniform3fv(this.screen.at("u_background"), this.background);
    gl.bindVertexArray(this.noAttributes);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** @param {CameraFile} camera */
  project(camera) {
    const { gl, projection } = this;
    const { view, position } = viewOf(camera, this.scene.near);
    gl.useProgram(projection.program);
    gl.uniform4fv(projection.at("u_view"), view);
    gl.uniform3fv(projection.at("u_position"), position);
    gl.uniform2f(projection.at("u_focal_px"), camera.fx, camera.fy);
    gl.uniform2f(projection.at("u_principal_px"), camera.cx, camera.cy);
    gl.uniform2f(projection.at("u_size_px"), camera.width, camera.height);
    gl.uniform1f(projection.at("u_dim"), this.dim);
    gl.uniform1i(projection.at("u_count"), this.count);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.projected);
    gl.viewport(0, 0, TEXTURE_WIDTH, linesOf(this.count));
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.noAttributes);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Waits until what was asked for is drawn. */
  finish() {
    const { gl } = this;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /**
   * Makes the picture that splats are blended to.
   * @param {number} width
   * @param {number} height
   */
  sizeBlended(width, height) {
    if (this.blendedSize[0] === width && this.blendedSize[1] === height) return;
    const { gl } = this;
    gl.deleteTexture(this.blended ?? null);
    this.blended = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + BLENDED_UNIT);
    gl.bindTexture(gl.TEXTURE_2D, this.blended);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.blended, 0);
    this.blendedSize = [width, height];
  }
}

/**
 * @param {string} source
 * @param {Record<string, number>} constants
 */
function withConstants(source, constants) {
  const lines = Object.entries(constants).map(([name, value]) => `#define ${name} ${value}\n`);
  // The version must be the first line.
  return source.replace("\n", `\n${lines.join("")}`);
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {string} vertex
 * @param {string} fragment
 */
function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]])) {
    const shader = gl.createShader(kind);
    if (!made || !shader) throw new Error("the graphics card was lost");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    gl.deleteShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`a shader does not compile here: ${gl.getShaderInfoLog(shader)}`);
    }
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(`shaders do not link here: ${gl.getProgramInfoLog(made)}`);
  /** @type {Map<string, WebGLUniformLocation | null>} */
  const known = new Map();
  const at = (/** @type {string} */ name) => {
    if (!known.has(name)) known.set(name, gl.getUniformLocation(made, name));
    return known.get(name) ?? null;
  };
  return { program: made, at };
}

/**
 * Lines of a texture that so many items take, one texel each.
 * @param {number} items
 */
function linesOf(items) {
  return Math.max(1, Math.ceil(items / TEXTURE_WIDTH));
}

/**
 * A new texture on the active unit that is read texel by texel.
 * @param {WebGL2RenderingContext} gl
 */
function nearestTexture(gl) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return made;
}

/**
 * Uploads texels to a texture unit, in place of what was there.
 * @param {WebGL2RenderingContext} gl
 * @param {number} unit
 * @param {import("./textures.js").Texels} texels
 */
function texture(gl, unit, texels) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  if (!gl.getParameter(gl.TEXTURE_BINDING_2D)) nearestTexture(gl);
  const { data, height } = texels;
  const [inner, format, type] =
    data instanceof Float32Array ? [gl.RGBA32F, gl.RGBA, gl.FLOAT] : [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT];
  gl.texImage2D(gl.TEXTURE_2D, 0, inner, TEXTURE_WIDTH, height, 0, format, type, data);
}
