// The worker: unpacks the scene, keeps it, sorts it for each view, and says what a pixel shows.
//
// Takes {load: text}, {sort: View, shown, buffer} and {pick: View, x, y, shown}; each but the first has an `id` that the answer
// repeats. Answers {scene}, {order, count}, {picked}, or {error}.

import { bytesOfBase85 } from "./base85.js";
import { DepthOrder, writeDrawList } from "./order.js";
import { pick } from "./pick.js";
import { parseScene } from "./scene.js";
import { sceneTexels } from "./textures.js";

/** @type {DepthOrder | undefined} */
let order;
/** What `sorted` holds the order for. */
let sortedFor = "";
/** @type {Uint32Array} */
let sorted = new Uint32Array(0);

/**
 * Flat indices in the order of a view, nearest first; sorted anew only if the view is another one.
 * @param {DepthOrder} of
 * @param {import("./pick.js").View} view
 * @param {Uint8Array} shown
 */
function sortedOf(of, { view, near }, shown) {
  const key = `${view.slice(8)} ${near} ${shown}`;
  if (key !== sortedFor) sorted = of.sorted(view, near, shown);
  sortedFor = key;
  return sorted;
}

/** @param {string} text */
async function load(text) {
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old for the page: it cannot inflate");
  const packed = new Blob([bytesOfBase85(text)]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const file = new Uint8Array(await new Response(packed).arrayBuffer());
  const scene = parseScene(file);
  order = new DepthOrder(scene);
  const texels = sceneTexels(scene);
  const { rows, names, templateCounts, backgroundCount, near, dilation, antialias } = scene;
  const { count } = order.flat;
  const answer = { texels, rows, names, templateCounts, backgroundCount, near, dilation, antialias, count, file };
  const buffers = [texels.geometry, texels.sh, texels.offsets, texels.rows].map((t) => t.data.buffer);
  postMessage({ scene: answer }, { transfer: [...buffers, file.buffer] });
}

/** @param {any} message */
async function answer(message) {
  if (message.load !== undefined) return load(message.load);
  if (!order) throw new Error("the scene is not there yet");
  const { id, shown } = message;
  if (message.sort) {
    const list = sortedOf(order, message.sort, shown);
    const out = message.buffer?.length >= 2 * order.flat.count ? message.buffer : new Uint32Array(2 * order.flat.count);
    writeDrawList(list, order.flat, out);
    return postMessage({ id, order: out, count: list.length }, { transfer: [out.buffer] });
  }
  const list = sortedOf(order, message.pick, shown);
  postMessage({ id, picked: pick(order.scene, order.flat, list, message.pick, message.x, message.y) });
}

self.onmessage = (event) => {
  answer(event.data).catch((error) => postMessage({ id: event.data.id, error: String(error?.message ?? error) }));
};
