// Draws the scene with WebGL2: one quad per splat, from the farthest to the nearest, into a picture of half floats, and that over
// the background.

import { NEAR } from "./camera.js";
import { ROW_TEXELS, TEXTURE_WIDTH } from "./layout.js";

const GEOMETRY_UNIT = 0;
const SH_UNIT = 1;
const OFFSETS_UNIT = 2;
const ROWS_UNIT = 3;
const BLENDED_UNIT = 4;

/** @typedef {{splatVertex: string, splatFragment: string, screenVertex: string, screenFragment: string}} Shaders */
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
    this.background = [0, 0, 0];
    /** Brightness of what is not selected. */
    this.dim = 1;
    const { texels } = scene;
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if ([texels.geometry, texels.sh, texels.offsets].some((t) => t.height > most)) {
      throw new Error("the scene has more Gaussians than this graphics card takes in one texture");
    }
    this.splats = program(gl, withConstants(shaders.splatVertex, texels), shaders.splatFragment);
    this.screen = program(gl, shaders.screenVertex, shaders.screenFragment);
    // Half floats where they can be blended to; else 8 bits, whose rounding shows in smooth places.
    const hasHalf = gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float");
    this.blendedFormat = hasHalf ? gl.RGBA16F : gl.RGBA8;
    texture(gl, GEOMETRY_UNIT, texels.geometry);
    texture(gl, SH_UNIT, texels.sh);
    texture(gl, OFFSETS_UNIT, texels.offsets);
    this.rowTexels = texels.rows;
    texture(gl, ROWS_UNIT, texels.rows);
    this.framebuffer = gl.createFramebuffer();
    this.blendedSize = [0, 0];
    this.drawList = gl.createBuffer();
    this.vertexArray = this.vertexArrayOfList();
    // Without attributes: the triangle over the picture.
    this.noAttributes = gl.createVertexArray();
    this.setConstants();
  }

  vertexArrayOfList() {
    const { gl } = this;
    const made = gl.createVertexArray();
    gl.bindVertexArray(made);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.drawList);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(8, 8 * this.scene.count), gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 2, gl.UNSIGNED_INT, 8, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
    return made;
  }

  setConstants() {
    const { gl, splats, screen, scene } = this;
    gl.useProgram(splats.program);
    gl.uniform1i(splats.at("u_geometry"), GEOMETRY_UNIT);
    gl.uniform1i(splats.at("u_sh"), SH_UNIT);
    gl.uniform1i(splats.at("u_offsets"), OFFSETS_UNIT);
    gl.uniform1i(splats.at("u_rows"), ROWS_UNIT);
    gl.uniform1f(splats.at("u_dilation_px2"), scene.dilation);
    gl.uniform1f(splats.at("u_antialias"), scene.antialias ? 1 : 0);
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
    gl.bindBuffer(gl.ARRAY_BUFFER, this.drawList);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, list, 0, 2 * count);
    this.count = count;
  }

  /**
   * How a row looks.
   * @param {number} row
   * @param {{shown: boolean, selected: boolean, tint: number[]}} look `tint` is red, green, blue, and how much
   */
  setLook(row, look) {
    const at = 4 * ROW_TEXELS * row;
    this.rowTexels.data.set(look.tint, at + 24);
    this.rowTexels.data.set([Number(look.shown), Number(look.selected)], at + 30);
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
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.drawSplats(camera);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.BLEND);
    gl.useProgram(this.screen.program);
    gl.uniform3fv(this.screen.at("u_background"), this.background);
    gl.bindVertexArray(this.noAttributes);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** @param {CameraFile} camera */
  drawSplats(camera) {
    const { gl, splats } = this;
    const rows = camera.view_from_world.slice(0, 3);
    const position = [0, 1, 2].map((k) => -rows.reduce((sum, row) => sum + row[k] * row[3], 0));
    gl.useProgram(splats.program);
    gl.uniform4fv(splats.at("u_view"), rows.flat());
    gl.uniform3fv(splats.at("u_position"), position);
    gl.uniform2f(splats.at("u_focal_px"), camera.fx, camera.fy);
    gl.uniform2f(splats.at("u_principal_px"), camera.cx, camera.cy);
    gl.uniform2f(splats.at("u_size_px"), camera.width, camera.height);
    gl.uniform1f(splats.at("u_near"), NEAR);
    gl.uniform1f(splats.at("u_dim"), this.dim);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.vertexArray);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
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
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.blendedFormat, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.blended, 0);
    this.blendedSize = [width, height];
  }
}

/**
 * The shader for scenes of this kind: what a scene has not, its shader has no code for.
 * @param {string} source
 * @param {import("./textures.js").SceneTexels} texels
 */
function withConstants(source, texels) {
  const constants = {
    COEFFICIENTS: texels.coefficients,
    SH_TEXELS: texels.sh.texels,
    OFFSET_TEXELS: texels.offsets.texels,
    OFFSET_SHAPE: texels.hasShape ? 1 : 0,
    OFFSET_SH_REST: texels.hasShRest ? 1 : 0,
    FIRST_SH_REST: texels.hasShape ? 4 : 2,
  };
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
 * Uploads texels to a texture unit, in place of what was there.
 * @param {WebGL2RenderingContext} gl
 * @param {number} unit
 * @param {import("./textures.js").Texels} texels
 */
function texture(gl, unit, texels) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  let bound = gl.getParameter(gl.TEXTURE_BINDING_2D);
  if (!bound) {
    bound = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, bound);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }
  const { data, height } = texels;
  const [inner, format, type] =
    data instanceof Float32Array ? [gl.RGBA32F, gl.RGBA, gl.FLOAT] : [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT];
  gl.texImage2D(gl.TEXTURE_2D, 0, inner, TEXTURE_WIDTH, height, 0, format, type, data);
}
