#!/usr/bin/env python3
"""Exports a Grounding DINO checkpoint to ONNX: the detector of `instgs-vk masks --prompt`.

    python3 tools/models/export_grounding_dino.py --out MODELS [--model IDEA-Research/grounding-dino-tiny]

--model is a name on the Hugging Face hub (downloaded there and kept in its cache) or a folder of save_pretrained with
model, tokenizer and image processor. Writes grounding_dino.onnx and tokenizer.json, and its part of models.json.

The graph: inputs pixel_values f32 [1,3,H,W], pixel_mask i64 [1,H,W], input_ids, token_type_ids and attention_mask i64
[1,L]; outputs logits f32 [1,Q,T] before the sigmoid, -inf beyond L, and pred_boxes f32 [1,Q,4], cx cy w h in 0..1. H, W
and L are free: L at most T, and H x W must hold at least Q cells of 8, 16, 32 and 64 px together. The photo is resized
as the checkpoint's image processor does it: bilinear with antialiasing, rounded to 8 bits a channel, divided by 255 and
normalised.
"""

import argparse
import contextlib
import json
import pathlib

from onnx_models import check, export_part, fail, is_bilinear, load_model, load_part, plain_errors
from onnx_models import run_graph, save_graph, source_name, trace_to_onnx

import onnx
import torch
import transformers
import transformers.models.grounding_dino.modeling_grounding_dino as dino
import transformers.models.swin.modeling_swin as swin
from torch.nn.functional import pad

GRAPH = "grounding_dino.onnx"
INPUTS = ("pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask")
# Prompts of several lengths and numbers of phrases, for the comparison.
PROMPTS = ("chair.", "car. potted plant. person with a vase.")


class Detector(torch.nn.Module):
    """The model with tensors in place of its output structure."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, *tensors):
        outputs = self.model(**dict(zip(INPUTS, tensors)))
        return outputs.logits, outputs.pred_boxes


# What follows replaces parts of transformers during the export. Each computes what the original does; the originals
# hold operators that ONNX lacks (isin, cummax, cummin), or take sizes of the example as constants.


def phrase_masks(input_ids, special_tokens):
    """Which tokens see each other (those up to the same separator, and each itself), and their places in the phrase."""
    count = input_ids.shape[1]
    index = torch.arange(count, device=input_ids.device)
    here, other = index[None, :, None], index[None, None, :]
    special = (input_ids[..., None] == special_tokens).any(-1)[:, None, :]
    following = torch.where(special & (other >= here), other, count).amin(-1)
    previous = torch.where(special & (other < here), other, -1).amax(-1)
    inside = (following != 0) & (following != count - 1) & (following != count)
    together = (following[:, :, None] == following[:, None, :]) & inside[:, None, :]
    return (here == other) | together, torch.where(inside, index[None] - previous - 1, 0)


def pad_to_patches(self, pixel_values, height, width):
    return pad(pixel_values, (0, -width % self.patch_size[1], 0, -height % self.patch_size[0]))


def pad_to_even(_, features, height, width):
    return pad(features, (0, 0, 0, width % 2, 0, height % 2))


def pad_to_windows(self, states, height, width):
    padding = (0, 0, 0, -width % self.window_size, 0, -height % self.window_size)
    # The caller crops where this says that it padded; cropping nothing does no harm.
    return pad(states, padding), (0, 0, 0, 1, 0, 1)


def reference_points(spatial_shapes_list, valid_ratios, device):
    levels = []
    for level, (height, width) in enumerate(spatial_shapes_list):
        rows = torch.arange(height, device=device).to(valid_ratios.dtype) + 0.5
        columns = torch.arange(width, device=device).to(valid_ratios.dtype) + 0.5
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        y = y.reshape(-1)[None] / (valid_ratios[:, None, level, 1] * height)
        x = x.reshape(-1)[None] / (valid_ratios[:, None, level, 0] * width)
        levels.append(torch.stack((x, y), -1))
    return torch.cat(levels, 1)[:, :, None] * valid_ratios[:, None]


class TorchWithArange:
    """torch, but linspace(0, n - 1, n) counts: the exporter's linspace is wrong for a free n."""

    def __getattr__(self, name):
        return getattr(torch, name)

    @staticmethod
    def linspace(start, _end, steps, dtype=None, device=None):
        return torch.arange(steps, device=device).to(dtype) + start


def with_counting(original):
    def replaced(*args):
        dino.torch = TorchWithArange()
        try:
            return original(*args)
        finally:
            dino.torch = torch

    return replaced


def with_free_shapes(original):
    def replaced(*args, spatial_shapes=None, spatial_shapes_list=None, **others):
        rows = [torch.stack([torch.as_tensor(size) for size in shape]) for shape in spatial_shapes_list]
        return original(*args, spatial_shapes=torch.stack(rows), spatial_shapes_list=spatial_shapes_list, **others)

    return replaced


@contextlib.contextmanager
def exportable():
    attention = dino.GroundingDinoMultiscaleDeformableAttention
    proposals = dino.GroundingDinoModel.generate_encoder_output_proposals
    replacements = [
        (dino, "generate_masks_with_special_tokens_and_transfer_map", phrase_masks),
        (dino, "torch_compilable_check", lambda *_, **__: None),
        (dino.GroundingDinoEncoder, "get_reference_points", staticmethod(reference_points)),
        (dino.GroundingDinoModel, "generate_encoder_output_proposals", with_counting(proposals)),
        (attention, "forward", with_free_shapes(attention.forward)),
        (swin.SwinPatchEmbeddings, "maybe_pad", pad_to_patches),
        (swin.SwinPatchMerging, "maybe_pad", pad_to_even),
        (swin.SwinLayer, "maybe_pad", pad_to_windows),
    ]
    originals = []
    for owner, name, replacement in replacements:
        if name not in vars(owner):
            fail(f"transformers has no {owner.__name__}.{name}: tools/models/README.md names a version that fits")
        originals.append((owner, name, vars(owner)[name]))
        setattr(owner, name, replacement)
    try:
        yield
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)


def example(tokenizer, prompt: str, height: int, width: int, seed: int) -> dict:
    """Noise as a picture, `prompt` as text."""
    text = tokenizer(prompt, return_tensors="pt", return_token_type_ids=True)
    noise = torch.Generator().manual_seed(seed)
    tensors = {
        "pixel_values": torch.randn(1, 3, height, width, generator=noise),
        "pixel_mask": torch.ones(1, height, width, dtype=torch.int64),
        **{name: text[name] for name in INPUTS[2:]},
    }
    return {name: tensors[name] for name in INPUTS}


def trace(model, inputs: dict, folder: pathlib.Path):
    config = model.config
    outputs = {"logits": (1, config.num_queries, config.max_text_len), "pred_boxes": (1, config.num_queries, 4)}
    text = {1: "L"}
    dynamic = {"pixel_values": {2: "H", 3: "W"}, "pixel_mask": {1: "H", 2: "W"}}
    dynamic |= {name: text for name in INPUTS[2:]}
    with exportable():
        return trace_to_onnx(Detector(model).eval(), inputs, outputs, dynamic, folder / GRAPH)


def proposals_output(graph) -> str:
    """The name of the chosen proposals, best first."""
    names = [node.output[1] for node in graph.node if node.op_type == "TopK"]
    if len(names) != 1:
        fail(f"the exported graph has {len(names)} TopK nodes, not 1")
    return names[0]


def expected_outputs(model, inputs: dict, chosen: torch.Tensor) -> dict:
    """PyTorch's outputs with the graph's order of proposals: of two that score alike to the last bits either may come
    first, and everything behind depends on the order. Ends where the order is not one of the best proposals."""
    original = torch.topk

    def given(scores, count, dim):
        values = scores.gather(dim, chosen)
        best = original(scores, count, dim=dim).values
        if not torch.allclose(values, best, rtol=1e-4, atol=1e-3):
            fail("the exported graph chooses other proposals than PyTorch")
        return values, chosen

    with torch.no_grad():
        torch.topk = given
        try:
            outputs = model(**inputs)
        finally:
            torch.topk = original
    # What counts is the score, not its logarithm far below zero.
    return {"logits": outputs.logits.sigmoid(), "pred_boxes": outputs.pred_boxes}


def compare(model, tokenizer, onnx_model, shortest: int, folder: pathlib.Path) -> None:
    """Two sizes, upright and wide and odd, and two prompts."""
    name = proposals_output(onnx_model.graph)
    onnx_model.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.INT64, None))
    save_graph(onnx_model, folder / GRAPH)
    del onnx_model.graph.output[-1]
    sizes = (shortest, shortest * 4 // 3 + 1), (shortest * 5 // 4 + 1, shortest - 3)
    for seed, ((height, width), prompt) in enumerate(zip(sizes, PROMPTS)):
        inputs = example(tokenizer, prompt, height, width, seed)
        got = run_graph(folder / GRAPH, inputs)
        expected = expected_outputs(model, inputs, torch.from_numpy(got.pop(name)))
        got["logits"] = torch.from_numpy(got["logits"]).sigmoid().numpy()
        tokens = inputs["input_ids"].shape[1]
        check(f"detector, {width}x{height}, {tokens} tokens", expected, got)


def preprocessing(processor) -> dict:
    """The photo's side of models.json. Ends in words where the processor does something else than the Rust side."""
    if not (is_bilinear(processor) and processor.do_resize and processor.do_rescale and processor.do_normalize):
        fail("the checkpoint's image processor does not resize bilinearly, divide by 255 and normalise")
    if abs(processor.rescale_factor * 255 - 1) > 1e-6:
        fail(f"the checkpoint's image processor scales by {processor.rescale_factor}, not by 1/255")
    size = dict(processor.size)
    return {
        "shortest_px": size["shortest_edge"],
        "longest_px": size["longest_edge"],
        "canvas_px": None,
        "mean": list(processor.image_mean),
        "std": list(processor.image_std),
    }


def save_tokenizer(tokenizer, path: pathlib.Path) -> None:
    """Ends in words where the tokenizer's separators are not the ones that the model's code looks for."""
    separators = tokenizer.convert_tokens_to_ids(["[CLS]", "[SEP]", ".", "?"])
    if separators != dino.SPECIAL_TOKENS:
        fail(f"the tokenizer has [CLS] [SEP] . ? at {separators}, the model wants {dino.SPECIAL_TOKENS}")
    content = json.loads(tokenizer.backend_tokenizer.to_str())
    content["truncation"] = content["padding"] = None
    with plain_errors(f"cannot write {path.name}"):
        path.write_text(json.dumps(content, ensure_ascii=False) + "\n", encoding="utf-8")


def export_detector(model, tokenizer, processor, source: str, out: pathlib.Path) -> None:
    model.eval()
    settings = preprocessing(processor)
    shortest = settings["shortest_px"]

    def make(folder: pathlib.Path) -> dict:
        inputs = example(tokenizer, PROMPTS[1], shortest, shortest * 4 // 3 + 1, 7)
        onnx_model = trace(model, inputs, folder)
        compare(model, tokenizer, onnx_model, shortest, folder)
        save_graph(onnx_model, folder / GRAPH)
        save_tokenizer(tokenizer, folder / "tokenizer.json")
        return {**settings, "max_tokens": model.config.max_text_len, "fixed_tokens": None}

    files = {"graph": GRAPH, "tokenizer": "tokenizer.json"}
    export_part("detector", ("grounding-dino", source), [model], files, make, out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="IDEA-Research/grounding-dino-tiny", help="name on the hub, or a folder")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the models folder")
    args = parser.parse_args()
    model = load_model(transformers.GroundingDinoForObjectDetection, args.model)
    tokenizer = load_part(transformers.AutoTokenizer, args.model)
    processor = load_part(transformers.AutoImageProcessor, args.model)
    export_detector(model, tokenizer, processor, source_name(args.model), args.out)


if __name__ == "__main__":
    main()
