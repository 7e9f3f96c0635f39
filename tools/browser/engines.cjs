// Other engines that draw .glb files with KHR_gaussian_splatting. Each `start` runs in the page, with the engine's scripts loaded:
// it opens /scene.glb and defines window.showCamera(camera), which draws that camera of instgs-vk from then on.
"use strict";

/** Loads the file and turns the camera's frame into glTF's: the node "world" of our files has turned the scene. */
async function startPlayCanvas() {
  const canvas = document.querySelector("canvas");
  const app = new pc.Application(canvas, { graphicsDeviceOptions: { antialias: false, alpha: false } });
  app.setCanvasFillMode(pc.FILLMODE_NONE);
  app.start();
  const asset = new pc.Asset("scene", "container", { url: "/scene.glb", filename: "scene.glb" });
  app.assets.add(asset);
  await new Promise((resolve, reject) => {
    asset.ready(resolve);
    asset.on("error", (error) => reject(new Error(String(error))));
    app.assets.load(asset);
  });
  // What is small or faint is drawn, too, as instgs-vk does.
  app.scene.gsplat.minPixelSize = 0;
  app.scene.gsplat.minContribution = 0;
  app.root.addChild(asset.resource.instantiateRenderEntity());
  const eye = new pc.Entity();
  eye.addComponent("camera", { clearColor: new pc.Color(0, 0, 0, 1), nearClip: 0.05, farClip: 1000 });
  app.root.addChild(eye);
  window.showCamera = ({ width, height, fy, view_from_world: rows }) => {
    app.setCanvasResolution(pc.RESOLUTION_FIXED, width, height);
    // Cameras of instgs-vk look along +z with y down, those of the engine along -z with y up.
    const worldFromEye = new pc.Mat4();
    rows.forEach((row, r) => row.forEach((v, c) => (worldFromEye.data[4 * c + r] = r === 1 || r === 2 ? -v : v)));
    worldFromEye.invert();
    worldFromEye.mul2(app.root.findByName("world").getWorldTransform(), worldFromEye);
    eye.setPosition(worldFromEye.getTranslation());
    eye.setRotation(new pc.Quat().setFromMat4(worldFromEye));
    eye.camera.fov = (2 * Math.atan(height / 2 / fy) * 180) / Math.PI;
  };
}

async function startBabylon() {
  const engine = new BABYLON.Engine(document.querySelector("canvas"), false);
  const scene = new BABYLON.Scene(engine);
  // glTF's frame: otherwise a node of the loader's own mirrors everything.
  scene.useRightHandedSystem = true;
  scene.clearColor = new BABYLON.Color4(0, 0, 0, 1);
  const eye = new BABYLON.FreeCamera("eye", BABYLON.Vector3.Zero(), scene);
  eye.minZ = 0.05;
  eye.maxZ = 1000;
  await BABYLON.AppendSceneAsync("/scene.glb", scene);
  engine.runRenderLoop(() => scene.render());
  window.showCamera = ({ width, height, fy, view_from_world: rows }) => {
    engine.setSize(width, height);
    const flipped = rows.map((row, r) => row.map((v) => (r === 1 || r === 2 ? -v : v)));
    // The engine multiplies rows by matrices: it stores the transpose, row by row.
    const eyeFromScene = BABYLON.Matrix.FromArray([0, 1, 2, 3].flatMap((c) => flipped.map((row) => row[c])));
    const world = scene.getNodeByName("world").computeWorldMatrix(true);
    const worldFromEye = eyeFromScene.invert().multiply(world);
    const at = (x, y, z) => BABYLON.Vector3.TransformCoordinates(new BABYLON.Vector3(x, y, z), worldFromEye);
    eye.position = at(0, 0, 0);
    eye.upVector = at(0, 1, 0).subtract(eye.position);
    eye.setTarget(at(0, 0, -1));
    eye.fov = 2 * Math.atan(height / 2 / fy);
  };
}

/**
 * The engines. `leastPsnr`, dB: PlayCanvas cuts Gaussians at the edge of their quads so that they end at zero there, Babylon.js rounds
 * colours, rotations and SH to 8 bits. `sortsAll`: whether Gaussians of all meshes are put in one order. Babylon.js sorts those of
 * each mesh, and meshes by the middles of their bounds.
 */
const ENGINES = [
  { name: "PlayCanvas", scripts: ["playcanvas/build/playcanvas.js"], start: startPlayCanvas, leastPsnr: 31, sortsAll: true },
  { name: "Babylon.js", scripts: ["babylonjs/babylon.js", "babylonjs-loaders/babylonjs.loaders.min.js"], start: startBabylon,
    leastPsnr: 36, sortsAll: false },
];

module.exports = { ENGINES };
