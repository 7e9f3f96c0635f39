#!/usr/bin/env python3
"""Makes the weights file that `instgs-vk eval` needs for LPIPS.

    pip install torch torchvision lpips safetensors
    python3 tools/models/convert_lpips.py --net alex --out lpips_alex.safetensors

Takes the backbone's ImageNet weights from torchvision (which downloads them) and the linear heads, version 0.1, from the
lpips package. Without network access give the files: --backbone alexnet-owt-7be5be79.pth, --heads alex.pth.

The file: F32 tensors under the names of the two sources, `features.N.weight` [out, in, h, w] and `features.N.bias` [out]
(squeeze: `features.N.squeeze.weight`, `features.N.expand1x1.weight`, `features.N.expand3x3.weight` and their biases), and
`linK.model.1.weight` [1, channels, 1, 1]; metadata `format` = "instgs-lpips/1", `net`. The licences of the weights are
their publishers'.
"""

import argparse
import importlib.util
import os
import pathlib
import sys

import torch
from safetensors.torch import save_file

# Network: torchvision's name, tensors of its feature extractor, linear heads.
NETS = {"alex": ("alexnet", 10, 5), "vgg": ("vgg16", 26, 5), "squeeze": ("squeezenet1_1", 50, 7)}


def backbone(name: str, path: "pathlib.Path | None") -> dict:
    if path:
        return torch.load(path, map_location="cpu")
    import torchvision

    return getattr(torchvision.models, name)(weights="IMAGENET1K_V1").state_dict()


def heads(net: str, path: "pathlib.Path | None") -> dict:
    if not path:
        # Found without importing it: an import would need all that its training code needs.
        package = importlib.util.find_spec("lpips")
        if package is None:
            sys.exit("error: the package lpips is not installed: pip install lpips, or give --heads FILE")
        path = pathlib.Path(package.origin).parent / "weights" / "v0.1" / f"{net}.pth"
    return torch.load(path, map_location="cpu")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", choices=NETS, required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--backbone", type=pathlib.Path, help="torchvision's .pth of this network, instead of downloading")
    parser.add_argument("--heads", type=pathlib.Path, help="the lpips package's .pth of this network, version 0.1")
    args = parser.parse_args()
    name, count, layers = NETS[args.net]
    features = {k: v for k, v in backbone(name, args.backbone).items() if k.startswith("features.")}
    linear = heads(args.net, args.heads)
    names = [f"lin{k}.model.1.weight" for k in range(layers)]
    if len(features) != count:
        sys.exit(f"error: not the backbone of {args.net}: {len(features)} tensors features.*, not {count}")
    missing = [n for n in names if n not in linear]
    if missing:
        sys.exit(f"error: not the heads of {args.net}: no {missing[0]} in them")
    tensors = {k: v.float().contiguous() for k, v in {**features, **{n: linear[n] for n in names}}.items()}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    # Beside it first, so that no half file has its name.
    partial = args.out.with_name(args.out.name + ".partial")
    save_file(tensors, partial, metadata={"format": "instgs-lpips/1", "net": args.net})
    os.replace(partial, args.out)
    print(f"{args.out}: {len(tensors)} tensors of {args.net}")


if __name__ == "__main__":
    main()
