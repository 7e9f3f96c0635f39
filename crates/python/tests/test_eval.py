"""The figures of a scene beside photos, and the remarks about them."""

import json
import shutil
import struct
import warnings
import zlib

import numpy as np
import pytest

import instgs
from conftest import ball


@pytest.fixture
def seen(data):
    """A ball in front of the first test view."""
    camera = instgs.Camera.of_data(data)[0]
    cloud = ball(50, 0.3, (0.9, 0.1, 0.1), 7)
    means = cloud.means + camera.position + 3 * camera.view_from_world[2, :3]
    return instgs.Scene(instgs.Gaussians(means, cloud.quats, cloud.log_scales, cloud.opacity_logits, cloud.sh))


def write_squeeze_weights(path):
    """A file of weights as tools/models/convert_lpips.py writes it for SqueezeNet, of random numbers."""
    shapes = {"features.0.weight": (64, 3, 3, 3), "features.0.bias": (64,)}
    inputs = 64
    fires = [(3, 16, 64), (4, 16, 64), (6, 32, 128), (7, 32, 128), (9, 48, 192), (10, 48, 192), (11, 64, 256), (12, 64, 256)]
    for index, squeeze, expand in fires:
        parts = {
            "squeeze": (squeeze, inputs, 1, 1),
            "expand1x1": (expand, squeeze, 1, 1),
            "expand3x3": (expand, squeeze, 3, 3),
        }
        for part, shape in parts.items():
            shapes[f"features.{index}.{part}.weight"] = shape
            shapes[f"features.{index}.{part}.bias"] = shape[:1]
        inputs = 2 * expand
    for k, channels in enumerate([64, 128, 256, 384, 384, 512, 512]):
        shapes[f"lin{k}.model.1.weight"] = (1, channels, 1, 1)
    rng, at, parts = np.random.default_rng(5), 0, []
    header = {"__metadata__": {"format": "instgs-lpips/1", "net": "squeeze"}}
    for name, shape in shapes.items():
        values = 0.05 * rng.normal(size=shape)
        parts.append((abs(values) if name.startswith("lin") else values).astype("<f4").tobytes())
        header[name] = {"dtype": "F32", "shape": list(shape), "data_offsets": [at, at + len(parts[-1])]}
        at += len(parts[-1])
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + b"".join(parts))


def test_lpips_has_the_range_that_is_asked_for(seen, data, tmp_path):
    weights = tmp_path / "squeeze.safetensors"
    write_squeeze_weights(weights)

    def lpips(**how):
        return instgs.eval(seen, data, lpips="squeeze", lpips_weights=weights, **how)["mean"]["lpips"]

    usual, of_3dgs = lpips(), lpips(lpips_range="01")
    assert usual == lpips(lpips_range="11") and usual > 0 and of_3dgs > 0 and usual != of_3dgs
    with pytest.warns(UserWarning, match="LPIPS has no mean: some pictures are too small for squeeze"):
        assert lpips(width=8) is None


def test_lpips_without_weights_is_left_out(seen, data, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert instgs.eval(seen, data)["mean"]["lpips"] is None
    with pytest.warns(UserWarning, match="LPIPS is left out: .*lpips_vgg.safetensors does not exist; make it with: python3"):
        assert instgs.eval(seen, data, lpips="vgg")["mean"]["lpips"] is None


def test_exposures_are_figures_if_asked_for(seen, data):
    figures = instgs.eval(seen, data, exposures=True)
    assert all(isinstance(part["psnr_exposed"], float) for part in [figures["mean"], *figures["views"]])
    assert "psnr_exposed" not in instgs.eval(seen, data)["mean"]


def black_png(width, height):
    """A PNG of black pixels, 8 bits of grey."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width + 1) * height))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_photos_of_which_no_pixel_counts_are_left_out(seen, data, tmp_path):
    copy = tmp_path / "data"
    shutil.copytree(data, copy)
    shutil.rmtree(copy / "masks")  # with masks of objects there, mask_path would name such a mask
    first, *others = instgs.Camera.of_data(data, "all")
    (copy / "black.png").write_bytes(black_png(first.width, first.height))
    for file in copy.glob("transforms*.json"):
        views = json.loads(file.read_text())
        for frame in views["frames"]:
            if first.name in frame["file_path"]:
                frame["mask_path"] = "black.png"
        file.write_text(json.dumps(views))
    with pytest.warns(UserWarning, match=first.name):
        report = instgs.eval(seen, copy, split="all")
    assert [view["name"] for view in report["views"]] == [view.name for view in others]


def test_views_that_show_nothing_are_warned_of(seen, data):
    with pytest.warns(UserWarning, match="nothing is visible from these views .near is 1000; see near="):
        instgs.eval(seen, data, near=1000)


@pytest.mark.parametrize(
    "values, words",
    [
        ({"width": 0}, "width is 0: want 1 or more, or leave it out"),
        ({"lpips": "lenet"}, 'lpips "lenet" is none of alex, vgg and squeeze'),
        ({"lpips_range": "10"}, 'lpips_range "10" is neither 11 nor 01'),
    ],
)
def test_faulty_values_are_refused(seen, data, values, words):
    with pytest.raises(instgs.Error) as error:
        instgs.eval(seen, data, **values)
    assert str(error.value) == words
