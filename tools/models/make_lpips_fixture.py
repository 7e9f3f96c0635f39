#!/usr/bin/env python3
"""Writes tests/fixtures/lpips.json: what the official lpips package answers for networks and pictures made by formula.

    python3 tools/models/make_lpips_fixture.py [--out tests/fixtures/lpips.json]

Needs torch, torchvision and lpips (0.1.4); downloads nothing and uses no trained weights. The same formulas stand in
crates/eval/src/lpips/fixture.rs, so the repository holds neither weights nor pictures. Everything is computed in f64, of
weights and pixels rounded to f32.

Formulas, on unsigned 64-bit integers that wrap:
- mix(z): SplitMix64's finaliser. seed(name): FNV-1a over the name's bytes.
- word(name, i) = mix(seed(name) + (i + 1) * 0x9E3779B97F4A7C15), top24 = word >> 40.
- weight: (top24 / 2^23 - 1) * sqrt(6 / fan_in), fan_in = all of its dimensions but the first; bias:
  (top24 / 2^23 - 1) * 0.1; head: top24 / 2^24 * 0.1. `name` is the tensor's name, with its network before it.
- target pixel, channel c: (3x + 5y + 40c) mod 256. Render: target + (word("render", 3(yW + x) + c) >> 59) - 16, clamped
  to 0..=255. Both divided by 255.
"""

import argparse
import json
import os
import pathlib

import lpips
import numpy as np
import torch

GAMMA = 0x9E3779B97F4A7C15
NETS = ("alex", "vgg", "squeeze")
# Of 67x50, every max pool of squeeze leaves a part of a window over in one direction, which only ceil mode counts.
SIZES = ((67, 50), (48, 64))


def words(name: str, count: int) -> np.ndarray:
    seed = 0xCBF29CE484222325
    for byte in name.encode():
        seed = ((seed ^ byte) * 0x100000001B3) % 2**64
    with np.errstate(over="ignore"):
        z = np.uint64(seed) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(GAMMA)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def tensor(net: str, name: str, shape: torch.Size) -> torch.Tensor:
    top24 = (words(f"{net}.{name}", int(np.prod(shape))) >> np.uint64(40)).astype(np.float64)
    if name.startswith("lin"):
        values = top24 / 2**24 * 0.1
    elif name.endswith("bias"):
        values = (top24 / 2**23 - 1) * 0.1
    else:
        values = (top24 / 2**23 - 1) * np.sqrt(6.0 / np.prod(shape[1:]))
    return torch.from_numpy(values.astype(np.float32).reshape(tuple(shape))).double()


def backbone_name(key: str) -> str:
    """torchvision's name of a tensor of lpips's `net`, whose keys are net.sliceK.N.*"""
    return "features." + key.split(".", 2)[2]


def network(net: str) -> lpips.LPIPS:
    model = lpips.LPIPS(net=net, pretrained=False, pnet_rand=True, verbose=False).double()
    state = model.state_dict()
    for key in state:
        if key.startswith("net."):
            state[key] = tensor(net, backbone_name(key), state[key].shape)
        elif key.startswith("lin"):
            # `lins.K` holds the same module as `linK`.
            name = key.replace("lins.", "lin") if key.startswith("lins.") else key
            state[key] = tensor(net, name, state[key].shape)
    model.load_state_dict(state)
    return model.eval()


def pictures(width: int, height: int) -> tuple[torch.Tensor, torch.Tensor]:
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    target = (3 * x + 5 * y + 40 * c) % 256
    noise = (words("render", target.size) >> np.uint64(59)).astype(np.int64).reshape(target.shape)
    render = np.clip(target + noise - 16, 0, 255)
    def planar(bytes_of: np.ndarray) -> torch.Tensor:
        return torch.from_numpy((bytes_of.astype(np.float32) / np.float32(255)).transpose(2, 0, 1)[None].copy()).double()

    return planar(render), planar(target)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("tests/fixtures/lpips.json"))
    args = parser.parse_args()
    cases = []
    for net in NETS:
        model = network(net)
        for width, height in SIZES:
            render, target = pictures(width, height)
            for input_range, normalize in (("11", True), ("01", False)):
                with torch.no_grad():
                    total, layers = model(render, target, retPerLayer=True, normalize=normalize)
                cases.append({
                    "net": net, "width": width, "height": height, "range": input_range,
                    "layers": [float(layer) for layer in layers], "total": float(total),
                })
    made_by = f"tools/models/make_lpips_fixture.py, lpips 0.1.4, torch {torch.__version__}, f64"
    # Beside it first, so that no half file has its name.
    partial = args.out.with_name(args.out.name + ".partial")
    partial.write_text(json.dumps({"made_by": made_by, "cases": cases}, indent=1) + "\n")
    os.replace(partial, args.out)


if __name__ == "__main__":
    main()
