// Draws the scene with WebGPU, where there is: compute passes project the splats and sort them anew for every frame, so that the
// order never lags behind; they are then blended as in renderer.js, the way where there is only WebGL2.

import { viewOf } from "./camera.js";
import { constantsOf, flatList, writeLook } from "./layout.js";

/** Keys of a work-group of the sort, as sort.wgsl has it. */
const BLOCK = 4096;
const DIGITS = 256;
const THREADS = 256;
/** Shifts of the passes of the sort, from the lowest bits to the highest. */
const SHIFTS = [0, 8, 16, 24];
/** Bytes of a projected splat. */
const SPLAT_BYTES = 48;
/** Of blended pictures: 8 bits, rounded splat by splat, would show in smooth places. */
const BLENDED = "rgba16float";
/** What splats are blended with: each over what lies behind it. */
const OVER = { srcFactor: "one", dstFactor: "one-minus-src-alpha", operation: "add" };

/**
 * Sources by the names of their files.
 * @typedef {{"project-wgsl": string, "sort-wgsl": string, "splats-wgsl": string}} GpuShaders
 */

/**
 * Whether what the device draws reaches a canvas: some drivers compute, and have no pictures to share with the browser.
 * @param {any} device
 * @param {string} format
 */
async function reachesCanvas(device, format) {
  const canvas = document.createElement("canvas");
  const context = /** @type {any} */ (canvas.getContext("webgpu"));
  if (!context) return false;
  context.configure({ device, format });
  const encoder = device.createCommandEncoder();
  const view = context.getCurrentTexture().createView();
  encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 1] }] }).end();
  device.queue.submit([encoder.finish()]);
  await device.queue.onSubmittedWorkDone();
  context.unconfigure();
  return true;
}

export class GpuRenderer {
  /**
   * A renderer, or null where this browser or device has none that does: then the canvas is as it was.
   * @param {HTMLCanvasElement} canvas
   * @param {any} scene the worker's answer
   * @param {GpuShaders} shaders
   * @returns {Promise<GpuRenderer | null>}
   */
  static async create(canvas, scene, shaders) {
    const gpu = /** @type {any} */ (navigator).gpu;
    const adapter = await gpu?.requestAdapter({ powerPreference: "high-performance" });
    if (!adapter) return null;
    const { texels, count } = scene;
    const data = [texels.geometry, texels.sh, texels.offsets].map((of) => of.data.byteLength);
    const largest = Math.max(...data, SPLAT_BYTES * count, 4 * DIGITS * Math.ceil(count / BLOCK));
    const limits = { maxStorageBufferBindingSize: largest, maxBufferSize: largest };
    if (Object.entries(limits).some(([name, value]) => adapter.limits[name] < value)) return null;
    const device = await adapter.requestDevice({ requiredLimits: limits });
    let made = null;
    try {
      made = await GpuRenderer.createOn(device, canvas, scene, shaders, gpu.getPreferredCanvasFormat());
      return made;
    } finally {
      // Its buffers would stay in the way of WebGL2.
      if (!made) device.destroy();
    }
  }

  /**
   * A renderer on this device, or null where it cannot draw to the canvas.
   * @param {any} device
   * @param {HTMLCanvasElement} canvas
   * @param {any} scene
   * @param {GpuShaders} shaders
   * @param {string} format of the canvas
   */
  static async createOn(device, canvas, scene, shaders, format) {
    device.pushErrorScope("validation");
    device.pushErrorScope("out-of-memory");
    const made = new GpuRenderer(canvas, device, scene);
    await made.makePipelines(shaders, format);
    const works = await reachesCanvas(device, format);
    const faults = [await device.popErrorScope(), await device.popErrorScope()];
    const context = works && !faults.some((fault) => fault) ? canvas.getContext("webgpu") : null;
    if (!context) return null;
    made.context = /** @type {any} */ (context);
    made.context.configure({ device, format, alphaMode: "opaque" });
    return made;
  }

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {any} device
   * @param {any} scene
   */
  constructor(canvas, device, scene) {
    this.canvas = canvas;
    this.device = device;
    this.scene = scene;
    /** Nobody need sort for it. */
    this.sortsItself = true;
    this.background = [0, 0, 0];
    /** Brightness of what is not selected. */
    this.dim = 1;
    this.rowTexels = scene.texels.rows;
    this.blendedSize = [0, 0];
    const { count, rows, texels } = scene;
    const flat = flatList(rows);
    const pairs = new Uint32Array(2 * Math.max(1, count));
    flat.sources.forEach((source, i) => pairs.set([source, flat.rows[i]], 2 * i));
    this.blocks = Math.max(1, Math.ceil(count / BLOCK));
    const words = 4 * Math.max(1, count);
    this.buffers = {
      view: this.buffer(112, "UNIFORM"),
      screen: this.buffer(32, "UNIFORM"),
      geometry: this.filled(texels.geometry.data),
      sh: this.filled(texels.sh.data),
      offsets: this.filled(texels.offsets.data),
      rows: this.filled(texels.rows.data),
      flat: this.filled(pairs),
      splats: this.buffer(SPLAT_BYTES * Math.max(1, count), "STORAGE"),
      keys: [this.buffer(words, "STORAGE"), this.buffer(words, "STORAGE")],
      values: [this.buffer(words, "STORAGE"), this.buffer(words, "STORAGE")],
      counts: this.buffer(4 * DIGITS * this.blocks, "STORAGE"),
      draw: this.buffer(16, "STORAGE", "INDIRECT"),
      passes: SHIFTS.map((shift, i) => this.filled(Uint32Array.of(count, shift, this.blocks, Number(i === 0)), "UNIFORM")),
    };
  }

  /**
   * @param {number} size bytes
   * @param {string[]} usages names in GPUBufferUsage
   */
  buffer(size, ...usages) {
    const of = /** @type {any} */ (globalThis).GPUBufferUsage;
    return this.device.createBuffer({ size, usage: usages.reduce((sum, name) => sum | of[name], of.COPY_DST) });
  }

  /**
   * @param {Float32Array | Uint32Array} data
   * @param {string} usage
   */
  filled(data, usage = "STORAGE") {
    const made = this.buffer(data.byteLength, usage);
    this.device.queue.writeBuffer(made, 0, data);
    return made;
  }

  /**
   * @param {GpuShaders} shaders
   * @param {string} format of the canvas
   */
  async makePipelines(shaders, format) {
    const { device, buffers } = this;
    const constants = Object.entries(constantsOf(this.scene.texels)).map(([name, value]) => `const ${name} = ${value};\n`);
    const module = (/** @type {string} */ code) => device.createShaderModule({ code });
    const project = module(constants.join("") + shaders["project-wgsl"]);
    const [sort, splats] = [module(shaders["sort-wgsl"]), module(shaders["splats-wgsl"])];
    const sortLayout = this.layoutOf(["uniform", "read-only-storage", "read-only-storage", "storage", "storage", "storage"]);
    const compute = (/** @type {any} */ of, /** @type {string} */ entryPoint, /** @type {any} */ layout) =>
      device.createComputePipelineAsync({ layout, compute: { module: of, entryPoint } });
    const bySort = device.createPipelineLayout({ bindGroupLayouts: [sortLayout] });
    const render = (/** @type {string[]} */ [vertex, pixel], /** @type {object} */ target) => device.createRenderPipelineAsync({
      layout: "auto",
      vertex: { module: splats, entryPoint: vertex },
      fragment: { module: splats, entryPoint: pixel, targets: [target] },
    });
    const [projection, count, sum, scatter, quads, screen] = await Promise.all([
      compute(project, "project_all", "auto"),
      compute(sort, "count_digits", bySort),
      compute(sort, "sum_counts", bySort),
      compute(sort, "scatter", bySort),
      render(["quad", "splat_pixel"], { format: BLENDED, blend: { color: OVER, alpha: OVER } }),
      render(["screen", "screen_pixel"], { format }),
    ]);
    this.pipelines = { projection, count, sum, scatter, quads, screen };
    const { view, geometry, sh, offsets, rows, flat, keys, values, counts, draw, passes } = buffers;
    const projected = [view, geometry, sh, offsets, rows, flat, buffers.splats, keys[0], draw];
    this.groups = {
      projection: this.group(projection.getBindGroupLayout(0), projected),
      // An even number of passes: the order ends up where it began.
      sort: passes.map((pass, i) => {
        const [from, to] = [i % 2, 1 - (i % 2)];
        return this.group(sortLayout, [pass, keys[from], values[from], keys[to], values[to], counts]);
      }),
      quads: this.group(quads.getBindGroupLayout(0), [buffers.screen, buffers.splats, values[0]]),
    };
  }

  /** @param {string[]} types of buffers of a compute pass, by binding */
  layoutOf(types) {
    const visibility = /** @type {any} */ (globalThis).GPUShaderStage.COMPUTE;
    const entries = types.map((type, binding) => ({ binding, visibility, buffer: { type } }));
    return this.device.createBindGroupLayout({ entries });
  }

  /**
   * @param {any} layout
   * @param {any[]} buffers by binding
   */
  group(layout, buffers) {
    return this.device.createBindGroup({ layout, entries: buffers.map((buffer, binding) => ({ binding, resource: { buffer } })) });
  }

  /** @param {number} row @param {import("./layout.js").Look} look */
  setLook(row, look) {
    writeLook(this.rowTexels.data, row, look);
    this.rowsChanged = true;
  }

  /** @param {import("./camera.js").CameraFile} camera what is drawn; the canvas gets its size */
  draw(camera) {
    const { device, buffers, pipelines, groups, scene } = this;
    if (!pipelines || !groups) return;
    const { width, height } = camera;
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    this.sizeBlended(width, height);
    this.writeView(camera);
    const encoder = device.createCommandEncoder();
    const compute = encoder.beginComputePass();
    const run = (/** @type {any} */ pipeline, /** @type {any} */ group, /** @type {number} */ workgroups) => {
      compute.setPipeline(pipeline);
      compute.setBindGroup(0, group);
      compute.dispatchWorkgroups(workgroups);
    };
    run(pipelines.projection, groups.projection, Math.max(1, Math.ceil(scene.count / THREADS)));
    for (const group of groups.sort) {
      run(pipelines.count, group, this.blocks);
      run(pipelines.sum, group, 1);
      run(pipelines.scatter, group, this.blocks);
    }
    compute.end();
    const splats = this.renderPass(encoder, this.blended.createView());
    splats.setPipeline(pipelines.quads);
    splats.setBindGroup(0, groups.quads);
    splats.drawIndirect(buffers.draw, 0);
    splats.end();
    const screen = this.renderPass(encoder, this.context.getCurrentTexture().createView());
    screen.setPipeline(pipelines.screen);
    screen.setBindGroup(0, this.screenGroup);
    screen.draw(3);
    screen.end();
    device.queue.submit([encoder.finish()]);
  }

  /** @param {any} encoder @param {any} view of the texture that is drawn to; it begins empty */
  renderPass(encoder, view) {
    return encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] }] });
  }

  /**
   * What the shaders take of a frame, as project.wgsl and splats.wgsl lay it out.
   * @param {import("./camera.js").CameraFile} camera
   */
  writeView(camera) {
    const { scene, buffers } = this;
    const { queue } = this.device;
    const { view, position, near } = viewOf(camera, scene.near);
    const data = new Float32Array(28);
    data.set([...view, ...position, near, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height]);
    data.set([scene.dilation, scene.antialias ? 1 : 0, this.dim], 22);
    new Uint32Array(data.buffer)[25] = scene.count;
    queue.writeBuffer(buffers.view, 0, data);
    queue.writeBuffer(buffers.screen, 0, Float32Array.of(...this.background, 0, camera.width, camera.height, 0, 0));
    queue.writeBuffer(buffers.draw, 0, Uint32Array.of(0, 1, 0, 0));
    if (this.rowsChanged) queue.writeBuffer(buffers.rows, 0, this.rowTexels.data);
    this.rowsChanged = false;
  }

  /** Waits until what was asked for is drawn. */
  finish() {
    return this.device.queue.onSubmittedWorkDone();
  }

  /**
   * Makes the picture that splats are blended to.
   * @param {number} width
   * @param {number} height
   */
  sizeBlended(width, height) {
    if (this.blendedSize[0] === width && this.blendedSize[1] === height) return;
    const { RENDER_ATTACHMENT, TEXTURE_BINDING } = /** @type {any} */ (globalThis).GPUTextureUsage;
    this.blended?.destroy();
    const usage = RENDER_ATTACHMENT | TEXTURE_BINDING;
    this.blended = this.device.createTexture({ size: [width, height], format: BLENDED, usage });
    const resources = [{ buffer: this.buffers.screen }, this.blended.createView()];
    const entries = [0, 3].map((binding, i) => ({ binding, resource: resources[i] }));
    this.screenGroup = this.device.createBindGroup({ layout: this.pipelines?.screen.getBindGroupLayout(0), entries });
    this.blendedSize = [width, height];
  }
}
