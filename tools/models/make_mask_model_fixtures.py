#!/usr/bin/env python3
"""Writes tests/fixtures/models: a tiny Grounding DINO and a tiny SAM with random weights, exported by the functions
that export real checkpoints, and what PyTorch and transformers answer for them.

    python3 tools/models/make_mask_model_fixtures.py [--out tests/fixtures/models] [--checkpoints FOLDER]

--checkpoints also writes both models by save_pretrained (FOLDER/dino, FOLDER/sam), to try the export scripts on. Two
runs with the same versions of the packages write the same bytes.

expected.safetensors:
- photo u8 [61,93,3]: (7 x (c + 1) + 11 y + floor(x y / (5 + c))) mod 256 at column x, row y, channel c.
- detector.pixel_values f32 [1,3,h,w]: what the image processor makes of the photo. Its pixel_mask is all ones.
- for each prompt K: detector.K.input_ids, token_type_ids, attention_mask i64 [1,L]; logits f32 [1,Q,T]; pred_boxes f32
  [1,Q,4]; and of post_process_grounded_object_detection, in order: scores f32 [n], boxes f32 [n,4], x0 y0 x1 y1 in
  pixels of the photo.
- segmenter.boxes_photo f32 [3,4] in pixels of the photo, segmenter.boxes f32 [3,4] of the canvas; image f32 [1,3,S,S],
  embeddings, mask_logits f32 [3,M,P,P], scores f32 [3,M]; best i64 [3], the mask with the highest score; photo_logits
  f32 [3,61,93]: post_process_masks of that mask before > 0.
expected.json: the prompts with their thresholds and labels, texts with their token ids, how the photo was resized.
"""

import argparse
import json
import os
import pathlib
import tempfile

from onnx_models import fail, need, plain_errors

need("safetensors", "PIL")

import numpy as np
import tokenizers
import torch
import transformers
from export_grounding_dino import INPUTS, export_detector
from export_sam import HubDecoder, HubEncoder, export_segmenter
from safetensors.torch import save_file

WIDTH, HEIGHT = 93, 61
DINO_SEED, SAM_SEED = 37, 51
PROMPTS = ("car. chair. potted plant.", "vase.")
# Of the 12 boxes, about so many pass.
PASSING = range(3, 9)
TEXTS = (
    "car. chair. potted plant.",
    "vase.",
    "Cars. CHAIRS with wheels. a zebra?",
    "  caf\u00e9 person,potted-plant  . ",
    "",
)
# At the ids that the model's code expects; the rest of the vocabulary is filled up with names nobody writes.
SPECIAL = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012, "?": 1029}
WORDS = "car chair vase person with wheel pot plant cafe a , - ! ##s ##ted ##er ##c c".split()
FIRST_WORD = 1030
BOXES = ((8.0, 5.0, 40.5, 33.25), (30.0, 12.0, 88.0, 58.0), (1.5, 40.0, 25.0, 60.0))
# Scores and thresholds keep this distance, so that a test that allows 1e-3 decides alike.
MARGIN = 5e-3


def photo() -> np.ndarray:
    y, x, c = np.mgrid[0:HEIGHT, 0:WIDTH, 0:3]
    return ((7 * x * (c + 1) + 11 * y + x * y // (5 + c)) % 256).astype(np.uint8)


def randomise(model: torch.nn.Module, seed: int) -> None:
    """Weights under which outputs depend on inputs: transformers' own start is zero in many places."""
    noise = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for name, tensor in sorted(model.named_parameters()):
            values = torch.randn(tensor.shape, generator=noise)
            if tensor.ndim > 1:
                table = "embed" in name and tensor.ndim == 2 and "bbox" not in name
                fan_in = 1 if table or "rel_pos" in name or "position" in name else tensor[0].numel()
                values *= fan_in**-0.5
            elif name.endswith("weight"):
                values = 1 + 0.1 * values
            else:
                values *= 0.2
            tensor.copy_(values)


def tokenizer() -> transformers.PreTrainedTokenizerFast:
    """BERT's uncased tokenizer with a vocabulary of a few words."""
    ids = {**SPECIAL, **{word: FIRST_WORD + i for i, word in enumerate(WORDS)}}
    size = max(ids.values()) + 1
    names = {number: word for word, number in ids.items()}
    vocabulary = {names.get(i, f"[unused{i}]"): i for i in range(size)}
    return transformers.BertTokenizerFast(vocab=vocabulary, do_lower_case=True)


def tiny_dino(vocabulary: int, seed: int = DINO_SEED) -> transformers.GroundingDinoForObjectDetection:
    backbone = transformers.SwinConfig(
        image_size=64,
        embed_dim=4,
        depths=[1, 2, 1, 1],
        num_heads=[1, 2, 2, 2],
        window_size=4,
        mlp_ratio=2.0,
        out_features=["stage2", "stage3", "stage4"],
    )
    text = transformers.BertConfig(
        vocab_size=vocabulary,
        hidden_size=8,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=16,
        max_position_embeddings=64,
    )
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone.to_dict(),
        text_config=text.to_dict(),
        d_model=32,  # its GroupNorm has 32 groups
        encoder_layers=1,
        decoder_layers=2,
        encoder_ffn_dim=16,
        decoder_ffn_dim=16,
        encoder_attention_heads=4,
        decoder_attention_heads=4,
        encoder_n_points=2,
        decoder_n_points=2,
        num_queries=12,
        max_text_len=48,
    )
    model = transformers.GroundingDinoForObjectDetection(config).eval()
    randomise(model, seed)
    with torch.no_grad():
        # Scores in the middle of 0..1, boxes that keep near their proposals.
        model.model.decoder.layer_norm.weight *= 0.25
        for head in (*model.bbox_embed, model.model.encoder_output_bbox_embed):
            head.layers[-1].weight *= 0.7
            head.layers[-1].bias.copy_(torch.tensor([0.0, 0.0, 0.7, 1.0]))
        for layer in model.model.encoder.layers:
            layer.fusion_layer.vision_param.abs_()
            layer.fusion_layer.text_param.abs_()
    return model


def tiny_sam(seed: int = SAM_SEED) -> transformers.SamModel:
    side, channels = 64, 16
    vision = dict(
        hidden_size=16,
        output_channels=channels,
        num_hidden_layers=2,
        num_attention_heads=2,
        image_size=side,
        window_size=3,  # does not divide the 4 x 4 patches, as 14 does not divide 64
        global_attn_indexes=[1],
        num_pos_feats=channels // 2,
        mlp_dim=32,
    )
    prompts = dict(hidden_size=channels, image_size=side)
    decoder = dict(hidden_size=channels, mlp_dim=32, num_attention_heads=2, iou_head_hidden_dim=16)
    config = transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder)
    model = transformers.SamModel(config).eval()
    randomise(model, seed)
    return model


def dino_processor() -> transformers.GroundingDinoImageProcessor:
    # 56 px would give 85 in the other direction: the limit of the longest edge is met.
    return transformers.GroundingDinoImageProcessor(size={"shortest_edge": 56, "longest_edge": 80})


def sam_processor() -> transformers.SamImageProcessor:
    return transformers.SamImageProcessor(
        size={"longest_edge": 64},
        pad_size={"height": 64, "width": 64},
        mask_size={"longest_edge": 16},
        mask_pad_size={"height": 16, "width": 16},
    )


def box_threshold(scores: torch.Tensor) -> float:
    """The middle of the widest gap between scores that lets a part of the boxes pass, rounded."""
    ordered = scores.sort(descending=True).values
    gap, passing = max(((ordered[n - 1] - ordered[n]).item(), n) for n in PASSING)
    if gap < 2 * MARGIN:
        fail(f"scores that differ by {gap:.4f} are too near to each other for a threshold: change the seed")
    return round((ordered[passing - 1] + ordered[passing]).item() / 2, 3)


def text_threshold(probabilities: torch.Tensor) -> float:
    """A value that three tenths of the tokens exceed and from which all keep their distance."""
    start = probabilities[probabilities > 0].quantile(0.7).item()
    for value in (start + 0.001 * step for step in range(200)):
        if (probabilities - round(value, 3)).abs().min() > MARGIN / 2:
            return round(value, 3)
    fail("no text threshold keeps a distance from all scores: change the seed")


def check_order(model, inputs: dict) -> None:
    """The order of the proposals may not hang on the last bits."""
    seen = []
    original = torch.topk
    torch.topk = lambda scores, count, dim: (seen.append(scores), original(scores, count, dim=dim))[1]
    try:
        with torch.no_grad():
            model(**inputs)
    finally:
        torch.topk = original
    best = seen[0][0].sort(descending=True).values[: model.config.num_queries + 1]
    if (best[:-1] - best[1:]).min() < 1e-4:
        fail("two proposals score alike: change the seed")


def detections(model, words, images, image: np.ndarray) -> tuple:
    """The detector's tensors, and its part of expected.json."""
    processor = transformers.GroundingDinoProcessor(images, words)
    tensors, cases = {}, []
    for number, prompt in enumerate(PROMPTS):
        inputs = dict(processor(images=image, text=prompt, return_tensors="pt"))
        check_order(model, inputs)
        with torch.no_grad():
            outputs = model(**inputs)
        probabilities = outputs.logits.sigmoid()[0]
        threshold = box_threshold(probabilities.max(-1).values)
        by_word = text_threshold(probabilities[probabilities.max(-1).values > threshold])
        result = processor.post_process_grounded_object_detection(
            outputs, inputs["input_ids"], threshold=threshold, text_threshold=by_word, target_sizes=[(HEIGHT, WIDTH)]
        )[0]
        tensors["detector.pixel_values"] = inputs["pixel_values"]
        values = {name: inputs[name] for name in INPUTS[2:]}
        values |= {"logits": outputs.logits, "pred_boxes": outputs.pred_boxes}
        values |= {"scores": result["scores"], "boxes": result["boxes"]}
        tensors |= {f"detector.{number}.{name}": value for name, value in values.items()}
        print(f"{prompt} {threshold} {by_word}: {len(result['boxes'])} boxes: {result['text_labels']}")
        cases.append(
            {"text": prompt, "threshold": threshold, "text_threshold": by_word, "labels": result["text_labels"]}
        )
    return tensors, cases


def masks(model, images, image: np.ndarray) -> dict:
    """The segmenter's tensors."""
    processor = transformers.SamProcessor(images)
    inputs = processor(images=image, input_boxes=[[list(box) for box in BOXES]], return_tensors="pt")
    with torch.no_grad():
        embeddings = model.get_image_embeddings(inputs["pixel_values"])
        boxes = inputs["input_boxes"].to(torch.float32)
        outputs = model(image_embeddings=embeddings, input_boxes=boxes, multimask_output=True)
    logits, scores = outputs.pred_masks[0], outputs.iou_scores[0]
    best = scores.argmax(-1)
    ordered = scores.sort(-1, descending=True).values
    if (ordered[:, 0] - ordered[:, 1]).min() < MARGIN:
        fail("two masks of one box score alike: change the seed")
    sizes = inputs["original_sizes"], inputs["reshaped_input_sizes"]
    photo_logits = images.post_process_masks([logits], *sizes, binarize=False)[0]
    chosen = photo_logits[torch.arange(len(best)), best]
    for value in chosen:
        inside = (value > 0).float().mean().item()
        print(f"mask covers {inside:.2f} of the photo")
        if not 0.05 < inside < 0.95:
            fail("a mask is nearly all of the photo or nearly nothing: change the seed")
    values = {
        "boxes_photo": torch.tensor(BOXES),
        "boxes": boxes[0],
        "image": inputs["pixel_values"],
        "embeddings": embeddings,
        "mask_logits": logits,
        "scores": scores,
        "best": best,
        "photo_logits": chosen,
    }
    return {f"segmenter.{name}": value for name, value in values.items()}


def pillow_difference(photo_values: torch.Tensor, processor, image: np.ndarray) -> int:
    """Largest difference of the resized photo, in levels of 0..255, between torchvision and Pillow."""
    from PIL import Image

    height, width = photo_values.shape[-2:]
    resized = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)).astype(np.float64)
    mean, std = (torch.tensor(v).reshape(3, 1, 1) for v in (processor.image_mean, processor.image_std))
    levels = ((photo_values * std + mean) * 255).permute(1, 2, 0).numpy()
    return int(np.abs(levels - resized).max().round())


def write_expected(out: pathlib.Path, tensors: dict, facts: dict) -> None:
    with plain_errors(f"cannot write to {out}"), tempfile.TemporaryDirectory(prefix=".partial-", dir=out) as folder:
        path = pathlib.Path(folder) / "expected.safetensors"
        save_file({name: value.contiguous() for name, value in tensors.items()}, path)
        path.chmod(0o644)
        os.replace(path, out / path.name)
        path = pathlib.Path(folder) / "expected.json"
        path.write_text(json.dumps(facts, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(path, out / path.name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("tests/fixtures/models"))
    parser.add_argument("--checkpoints", type=pathlib.Path, help="also write both models in transformers' format here")
    args = parser.parse_args()
    torch.set_num_threads(1)  # sums in one order
    image = photo()
    words, dino_images, sam_images = tokenizer(), dino_processor(), sam_processor()
    dino, sam = tiny_dino(len(words)), tiny_sam()
    if args.checkpoints:
        for part, folder in ((dino, "dino"), (words, "dino"), (dino_images, "dino"), (sam, "sam"), (sam_images, "sam")):
            part.save_pretrained(args.checkpoints / folder)
    export_detector(dino, words, dino_images, f"random weights, seed {DINO_SEED}", args.out)
    settings = sam_images.image_mean, sam_images.image_std
    parts = HubEncoder(sam), HubDecoder(sam), 64
    export_segmenter(*parts, *map(list, settings), f"random weights, seed {SAM_SEED}", args.out)
    tensors, cases = detections(dino, words, dino_images, image)
    tensors |= masks(sam, sam_images, image)
    tensors["photo"] = torch.from_numpy(image)
    levels = max(
        pillow_difference(tensors["detector.pixel_values"][0], dino_images, image),
        pillow_difference(tensors["segmenter.image"][0, :, :42], sam_images, image),
    )
    facts = {
        "prompts": cases,
        "texts": [{"text": text, "ids": words(text)["input_ids"]} for text in TEXTS],
        "resize": "torchvision, bilinear with antialiasing, rounded to 8 bits a channel",
        "largest_difference_to_pillow_levels": levels,
        "versions": {p.__name__: p.__version__.split("+")[0] for p in (torch, transformers, tokenizers)},
    }
    write_expected(args.out, tensors, facts)
    total = sum(path.stat().st_size for path in args.out.iterdir())
    print(f"{args.out}: {total / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
