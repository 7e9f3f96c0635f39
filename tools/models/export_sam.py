#!/usr/bin/env python3
"""Exports a SAM or MobileSAM checkpoint to ONNX: the segmenter of `instgs-vk masks --prompt` and `--boxes`.

    python3 tools/models/export_sam.py --out MODELS [--model facebook/sam-vit-base]
    python3 tools/models/export_sam.py --out MODELS --mobile-sam mobile_sam.pt

--model is a name on the Hugging Face hub (facebook/sam-vit-base, -large, -huge) or a folder of save_pretrained with
model and image processor. --mobile-sam is a checkpoint of the mobile_sam package, which must be installed: the
checkpoint holds numbers only, the package says what to do with them. Writes sam_encoder.onnx and sam_decoder.onnx, and
its part of models.json.

Encoder: input image f32 [1,3,S,S], the photo resized so that its longest side is S (bilinear with antialiasing, rounded
to 8 bits a channel), divided by 255, normalised, zeros right and below; output embeddings f32 [1,C,E,E]. Decoder:
inputs embeddings and boxes f32 [N,4], x0 y0 x1 y1 in pixels of the S x S canvas, any N >= 1; outputs mask_logits f32
[N,M,P,P] and scores f32 [N,M], the model's own estimate of each mask's IoU. M is 3: proposals of which the best score
counts.
"""

import argparse
import pathlib
import warnings

from onnx_models import check, export_part, fail, is_bilinear, load_model, load_part, need, plain_errors
from onnx_models import run_graph, save_graph, source_name, trace_to_onnx

import torch
import transformers

ENCODER = "sam_encoder.onnx"
DECODER = "sam_decoder.onnx"


class HubEncoder(torch.nn.Module):
    """The encoder of transformers' SamModel."""

    def __init__(self, model):
        super().__init__()
        self.encoder = model.vision_encoder

    def forward(self, image):
        return self.encoder(image).last_hidden_state


class HubDecoder(torch.nn.Module):
    """Prompt encoder and mask decoder of transformers' SamModel, for one image."""

    def __init__(self, model):
        super().__init__()
        self.prompts = model.prompt_encoder
        self.decoder = model.mask_decoder
        with torch.no_grad():
            self.register_buffer("positions", model.get_image_wide_positional_embeddings())

    def forward(self, embeddings, boxes):
        sparse, dense = self.prompts(input_points=None, input_labels=None, input_boxes=boxes[None], input_masks=None)
        masks, scores = self.decoder(
            image_embeddings=embeddings,
            image_positional_embeddings=self.positions,
            sparse_prompt_embeddings=sparse,
            dense_prompt_embeddings=dense,
            multimask_output=True,
        )
        return masks[0], scores[0]


class PackageDecoder(torch.nn.Module):
    """Prompt encoder and mask decoder of the mobile_sam package, for one image."""

    def __init__(self, sam):
        super().__init__()
        self.prompts = sam.prompt_encoder
        self.decoder = sam.mask_decoder
        with torch.no_grad():
            self.register_buffer("positions", sam.prompt_encoder.get_dense_pe())

    def forward(self, embeddings, boxes):
        sparse, dense = self.prompts(points=None, boxes=boxes, masks=None)
        return self.decoder(
            image_embeddings=embeddings,
            image_pe=self.positions,
            sparse_prompt_embeddings=sparse,
            dense_prompt_embeddings=dense,
            multimask_output=True,
        )


def boxes_for(side: int, count: int, seed: int) -> torch.Tensor:
    """Random boxes [count, 4] with corners in order, in pixels of the canvas."""
    noise = torch.Generator().manual_seed(seed)
    corners = torch.rand(count, 2, 2, generator=noise).sort(dim=1).values * side
    return corners.reshape(count, 4)


def export_encoder(encoder, side: int, folder: pathlib.Path) -> torch.Tensor:
    """Returns the embeddings that PyTorch makes of another picture than the one the graph was traced with."""
    noise = torch.Generator().manual_seed(1)
    image, other = (torch.randn(1, 3, side, side, generator=noise) for _ in range(2))
    with torch.no_grad():
        embeddings = encoder(other)
    graph = trace_to_onnx(encoder, {"image": image}, {"embeddings": embeddings.shape}, {}, folder / ENCODER)
    save_graph(graph, folder / ENCODER)
    del graph
    got = run_graph(folder / ENCODER, {"image": other})
    check("encoder", {"embeddings": embeddings}, got)
    return embeddings


def export_decoder(decoder, embeddings: torch.Tensor, side: int, folder: pathlib.Path) -> int:
    """Compares with one box and with several. Returns the side of the masks, pixels."""
    inputs = {"embeddings": embeddings, "boxes": boxes_for(side, 2, 2)}
    with torch.no_grad():
        masks, _ = decoder(*inputs.values())
    outputs = {"mask_logits": ("N", *masks.shape[1:]), "scores": ("N", masks.shape[1])}
    graph = trace_to_onnx(decoder, inputs, outputs, {"boxes": {0: "N"}}, folder / DECODER)
    save_graph(graph, folder / DECODER)
    for count in (1, 5):
        inputs["boxes"] = boxes_for(side, count, 2 + count)
        with torch.no_grad():
            expected = dict(zip(outputs, decoder(*inputs.values())))
        check(f"decoder, boxes: {count}", expected, run_graph(folder / DECODER, inputs))
    return masks.shape[-1]


def export_segmenter(encoder, decoder, side: int, mean: list, std: list, source: str, out: pathlib.Path) -> None:
    """`side`: of the canvas, pixels. `mean`, `std`: of colours in 0..1."""
    encoder.eval()
    decoder.eval()

    def make(folder: pathlib.Path) -> dict:
        embeddings = export_encoder(encoder, side, folder)
        mask_px = export_decoder(decoder, embeddings, side, folder)
        return {"side_px": side, "mask_px": mask_px, "mean": mean, "std": std}

    files = {"encoder": ENCODER, "decoder": DECODER}
    export_part("segmenter", ("sam", source), [encoder, decoder], files, make, out)


def from_hub(model_name: str) -> tuple:
    """Encoder, decoder, side, mean and std of a checkpoint in transformers' format."""
    model = load_model(transformers.SamModel, model_name)
    processor = load_part(transformers.AutoImageProcessor, model_name)
    side = model.config.vision_config.image_size
    size, pad_size = dict(processor.size), dict(processor.pad_size)
    sides = [size.get("longest_edge"), pad_size.get("height"), pad_size.get("width")]
    if not is_bilinear(processor) or sides != [side] * 3:
        fail(f"the checkpoint's image processor does not make a square of {side} px by bilinear resizing and padding")
    return HubEncoder(model), HubDecoder(model), side, list(processor.image_mean), list(processor.image_std)


def from_mobile_sam(checkpoint: pathlib.Path) -> tuple:
    """The same of a checkpoint of the mobile_sam package."""
    if not checkpoint.is_file():
        fail(f"{checkpoint} does not exist: mobile_sam.pt is in the repository ChaoningZhang/MobileSAM, folder weights")
    need("timm", "mobile_sam")
    with plain_errors("cannot use the mobile_sam package"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mobile_sam
    with plain_errors(f"{checkpoint} is not a checkpoint of MobileSAM"):
        sam = mobile_sam.sam_model_registry["vit_t"](checkpoint=str(checkpoint))
    mean, std = ((values.flatten() / 255).tolist() for values in (sam.pixel_mean, sam.pixel_std))
    rounded = ([round(v, 6) for v in values] for values in (mean, std))
    return sam.image_encoder, PackageDecoder(sam), sam.image_encoder.img_size, *rounded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--model", default="facebook/sam-vit-base", help="name on the hub, or a folder")
    which.add_argument("--mobile-sam", type=pathlib.Path, metavar="CHECKPOINT", help="mobile_sam.pt")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the models folder")
    args = parser.parse_args()
    if args.mobile_sam:
        parts, source = from_mobile_sam(args.mobile_sam), f"MobileSAM {args.mobile_sam.name}"
    else:
        parts, source = from_hub(args.model), source_name(args.model)
    export_segmenter(*parts, source, args.out)


if __name__ == "__main__":
    main()
