// What the checks in headless Chromium share: how it is started, how a page is opened, and how two pictures are compared.
"use strict";
const { execFileSync } = require("child_process");
const fs = require("fs");
const path = require("path");
const { chromium } = require("playwright-core");

/** Software rendering, and no request that a page did not ask for. */
const ARGUMENTS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox", "--headless",
  "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic", "--no-first-run"];

/** WebGPU in software too; without these a page finds no adapter. */
const WEBGPU_ARGUMENTS = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan",
  "--use-vulkan=swiftshader"];
/** What Chromium itself says where there is no WebGPU. */
const NO_WEBGPU = "No available adapters.";

/** tools/browser/setup.sh says where Chromium is. @param {boolean} withWebgpu whether pages find WebGPU beside WebGL2 */
function startBrowser(withWebgpu = false) {
  const args = withWebgpu ? [...ARGUMENTS, ...WEBGPU_ARGUMENTS] : ARGUMENTS;
  return chromium.launch({ executablePath: process.env.CHROMIUM, args });
}

/** Sizes of the windows that screenshots are taken of, CSS pixels. */
const SIZES = { desktop: { width: 1280, height: 800 }, phone: { width: 390, height: 844 } };
const PATIENCE_MS = 120_000;

/** Opens a page in a context of its own; `failures` gets what its console says, its errors, and requests to other places. */
async function openPage(browser, address, options, failures) {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  page.on("console", (message) => {
    if (message.text() !== NO_WEBGPU) failures.push(`console: ${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => failures.push(`error: ${error.message}`));
  page.on("request", (request) => {
    if (!/^(file|blob|data|about):/.test(request.url())) failures.push(`the page asks for ${request.url()}`);
  });
  page.setDefaultTimeout(PATIENCE_MS);
  await page.goto(address);
  return { page, close: () => context.close() };
}

/** Options of a context for each size and theme, by name. */
function looks() {
  return Object.entries(SIZES).flatMap(([name, viewport]) => ["light", "dark"].map((colorScheme) => {
    const isPhone = name === "phone";
    const options = { viewport, colorScheme, hasTouch: isPhone, isMobile: isPhone, deviceScaleFactor: isPhone ? 2 : 1 };
    return { name: `${name}_${colorScheme}`, isPhone, options };
  }));
}

/** PNGs of a scene from cameras with names, by `instgs-vk render`. */
function renderedBy(program, scene, cameras, folder) {
  const list = path.join(folder, "cameras.json");
  const out = path.join(folder, "ours");
  fs.writeFileSync(list, JSON.stringify(cameras));
  execFileSync(program, ["render", "--scene", scene, "--camera", list, "--out", out], { stdio: ["ignore", "ignore", "inherit"] });
  return cameras.map((camera) => fs.readFileSync(path.join(out, `${camera.name}.png`)));
}

/** PSNR of two PNGs of the same size, dB, over their 8-bit values; computed in a page of the browser. */
async function psnr(page, one, two) {
  const urls = [one, two].map((png) => `data:image/png;base64,${png.toString("base64")}`);
  return page.evaluate(async (of) => {
    const pixels = async (url) => {
      const image = await createImageBitmap(await (await fetch(url)).blob(), { colorSpaceConversion: "none" });
      const canvas = new OffscreenCanvas(image.width, image.height);
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      return context.getImageData(0, 0, image.width, image.height);
    };
    const [a, b] = await Promise.all(of.map(pixels));
    if (a.width !== b.width || a.height !== b.height) return 0;
    let squares = 0;
    a.data.forEach((value, i) => {
      if (i % 4 !== 3) squares += (value - b.data[i]) ** 2;
    });
    return 10 * Math.log10((255 * 255) / (squares / (0.75 * a.data.length)));
  }, urls);
}

module.exports = { looks, openPage, psnr, renderedBy, startBrowser };
