// What the checks in headless Chromium share: how it is started, and how two pictures are compared.
"use strict";
const { chromium } = require("playwright-core");

/** Software rendering, and no request that a page did not ask for. */
const ARGUMENTS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox", "--headless",
  "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic", "--no-first-run"];

function startBrowser() {
  return chromium.launch({ executablePath: "/usr/bin/chromium", args: ARGUMENTS });
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

module.exports = { startBrowser, psnr };
