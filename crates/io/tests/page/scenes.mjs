// What the page reads of a scene file, what it draws in which order, and what a pixel shows: node scenes.mjs FILE CAMERAS STEP,
// where every STEPth pixel of a row and of a column is picked. Writes JSON, for the test that holds it against Rust's values.

import fs from "node:fs";
import { viewOf, wholeCamera } from "../../web/camera.js";
import { DepthOrder } from "../../web/order.js";
import { pick } from "../../web/pick.js";
import { parseScene } from "../../web/scene.js";
import { sceneTexels } from "../../web/textures.js";

const [file, camerasFile, step] = process.argv.slice(2);
const scene = parseScene(new Uint8Array(fs.readFileSync(file)));
const shown = new Uint8Array(scene.rows.length).fill(1);
const order = new DepthOrder(scene);

const views = JSON.parse(fs.readFileSync(camerasFile, "utf8")).map((given) => {
  const camera = wholeCamera(given);
  const view = viewOf(camera, scene.near);
  const sorted = order.sorted(view.view, view.near, shown);
  const picked = [];
  for (let y = 0.5; y < camera.height; y += Number(step)) {
    for (let x = 0.5; x < camera.width; x += Number(step)) {
      const found = pick(scene, order.flat, sorted, view, x, y);
      picked.push(found && { row: found.row, point: found.point });
    }
  }
  return { sorted: Array.from(sorted), picked };
});

const { geometry, sh } = sceneTexels(scene);
const texels = { geometry: Array.from(geometry.data.slice(0, 12 * scene.pool.count)), shTexels: sh.texels };
const plain = (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
process.stdout.write(JSON.stringify({ ...scene, texels, views }, plain));
