"""Small scenes made in numpy, a renderer for all tests, and the command-line program beside it."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

# As the programs do, so that their pictures and ours come of the same kernels; the driver reads it when it is loaded.
os.environ.setdefault("LP_NATIVE_VECTOR_WIDTH", "256")

import instgs  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[3]


def ball(count, radius, rgb, seed, sh_coefficients=4):
    """Opaque Gaussians in a ball around the origin, all of one base colour, with a little view dependence."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(count, 3))
    means *= radius * rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(means, axis=1, keepdims=True)
    sh = np.zeros((count, sh_coefficients, 3))
    sh[:, 0] = (np.asarray(rgb) - 0.5) / 0.28209479177387814
    sh[:, 1:] = 0.05 * rng.normal(size=(count, sh_coefficients - 1, 3))
    quats = rng.normal(size=(count, 4))
    return instgs.Gaussians(means, quats, np.full((count, 3), np.log(0.4 * radius)), np.full(count, 4.0), sh)


def placed(x, y, z, scale=1.0, degrees=0.0):
    """A similarity: turned about y, scaled, moved."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return np.hstack([scale * turn, [[x], [y], [z]]])


@pytest.fixture
def scene():
    """Three red balls of one template, a green one of another, and a wall behind them."""
    wall = ball(60, 0.5, (0.2, 0.2, 0.9), 3)
    far = wall.means * [8, 8, 0.2] + [0, 0, 12]
    background = instgs.Gaussians(far, wall.quats, wall.log_scales + 2, wall.opacity_logits, wall.sh)
    return instgs.Scene(
        background,
        templates=[ball(40, 0.4, (0.9, 0.1, 0.1), 1), ball(25, 0.4, (0.1, 0.8, 0.1), 2)],
        instances=[
            (0, placed(-1.5, 0, 5)),
            (0, placed(0, 0, 5, 1.2, 40)),
            (1, placed(0, 1.2, 5)),
            (0, placed(1.5, 0, 5, 0.8, 90)),
        ],
        names=["red", "green"],
    )


@pytest.fixture
def camera():
    return instgs.Camera(96, 64, 70, 70, 48, 32, np.eye(4), name="front")


@pytest.fixture(scope="session")
def renderer():
    return instgs.Renderer()


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    """A data set of three cars, ten small views."""
    folder = tmp_path_factory.mktemp("data") / "cars"
    instgs.synth(folder, "cars", views=10, size=(96, 54), instances=3)
    return folder


@pytest.fixture(scope="session")
def program():
    """Runs the command-line program with --json and returns its report."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    built = [os.environ.get("INSTGS_VK"), *(target / profile / "instgs-vk" for profile in ("demo", "release", "debug"))]
    path = next((str(path) for path in built if path and Path(path).is_file()), shutil.which("instgs-vk"))
    if path is None:
        pytest.skip("instgs-vk is not built, and INSTGS_VK names none")

    def run(*arguments):
        done = subprocess.run([path, *map(str, arguments), "--json"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def ktx2(path):
    """The float image in a KTX2 file of one level, [H, W, channels]."""
    raw = Path(path).read_bytes()
    width, height = np.frombuffer(raw, "<u4", 2, 20)
    offset, length = np.frombuffer(raw, "<u8", 2, 80)
    return np.frombuffer(raw, "<f4", int(length) // 4, int(offset)).reshape(height, width, -1)
