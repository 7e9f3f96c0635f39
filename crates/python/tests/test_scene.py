import warnings

import numpy as np
import pytest

import instgs
from conftest import ball, placed


def arrays(cloud):
    return [cloud.means, cloud.quats, cloud.log_scales, cloud.opacity_logits, cloud.sh]


def same(a, b):
    return all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in zip(arrays(a), arrays(b)))


def test_arrays_come_back_as_float32_copies():
    means = np.arange(6.0).reshape(2, 3)
    cloud = instgs.Gaussians(means, [[1, 0, 0, 0]] * 2, [[-1] * 3] * 2, [0, 1], np.ones((2, 9, 3)))
    assert cloud.means.dtype == np.float32 and np.array_equal(cloud.means, means)
    assert cloud.quats.shape == (2, 4) and cloud.log_scales.shape == (2, 3) and cloud.sh.shape == (2, 9, 3)
    assert (cloud.sh_degree, len(cloud), cloud.opacity_logits.tolist()) == (2, 2, [0, 1])
    cloud.means[0, 0] = 7
    assert cloud.means[0, 0] == 0
    # Any strides and any number type.
    turned = instgs.Gaussians(means.T.copy().T[::-1], cloud.quats, cloud.log_scales, cloud.opacity_logits, cloud.sh)
    assert np.array_equal(turned.means, means[::-1])


@pytest.mark.parametrize(
    "change, words",
    [
        ({"means": np.zeros((2, 4))}, "means has shape [2, 4], want [N, 3]"),
        ({"quats": np.zeros((3, 4))}, "quats has shape [3, 4], want [2, 4]"),
        ({"sh": np.zeros((2, 5, 3))}, "sh has 5 coefficients, want 1, 4, 9 or 16"),
        ({"opacity_logits": ["x", "y"]}, "opacity_logits: "),
    ],
)
def test_wrong_arrays_are_named(change, words):
    right = {
        "means": np.zeros((2, 3)),
        "quats": np.ones((2, 4)),
        "log_scales": np.zeros((2, 3)),
        "opacity_logits": np.zeros(2),
        "sh": np.zeros((2, 1, 3)),
    }
    instgs.Gaussians(**right)
    with pytest.raises(instgs.Error) as error:
        instgs.Gaussians(**{**right, **change})
    assert str(error.value).startswith(words)


def test_a_scene_says_what_it_holds(scene):
    assert (len(scene), scene.counts["template"], scene.counts["background"]) == (3 * 40 + 25 + 60, 65, 60)
    assert [i.template for i in scene.instances] == [0, 0, 1, 0]
    assert [(i.group, i.id) for i in scene.instances] == [("red", 1), ("red", 2), ("green", 3), ("red", 4)]
    assert [(g.template, g.name, g.instance_ids) for g in scene.groups] == [(0, "red", [1, 2, 4]), (1, "green", [3])]
    second = scene.instances[1]
    assert second.world_from_template.shape == (3, 4) and second.world_from_template.dtype == np.float32
    assert np.allclose(second.world_from_template, placed(0, 0, 5, 1.2, 40), atol=1e-6)
    assert second.scale == pytest.approx(1.2, abs=1e-6) and second.first_offset is None and second.gaussians == 40
    centre = second.world_from_template @ np.append(scene.templates[0].means.astype(float).mean(0), 1)
    assert np.allclose(second.centre, centre, atol=1e-5)
    assert len(scene.templates) == 2 and same(scene.templates[0], ball(40, 0.4, (0.9, 0.1, 0.1), 1))


def test_flatten_places_every_instance(scene):
    cloud = scene.flatten()
    assert len(cloud) == len(scene)
    rows = scene.instances[1].world_from_template.astype(float)
    want = scene.templates[0].means.astype(float) @ rows[:, :3].T + rows[:, 3]
    assert np.allclose(cloud.means[40:80], want, atol=1e-5)
    assert np.allclose(cloud.log_scales[40:80], scene.templates[0].log_scales + np.log(1.2), atol=1e-5)
    assert np.array_equal(cloud.means[-60:], scene.background.means)


def test_a_page_holds_the_scene(scene, tmp_path):
    scene.save(tmp_path / "small.html")
    scene.save(tmp_path / "f32.html", pack="f32")
    pages = [(tmp_path / f"{pack}.html").read_text() for pack in ("small", "f32")]
    assert all(page.lower().startswith("<!doctype html>") for page in pages)
    assert len(pages[0]) < len(pages[1]) and len(pages[0]) < 300_000


def test_saved_scenes_come_back(scene, tmp_path):
    scene.save(tmp_path / "new folder" / "a.instgs")
    (tmp_path / "new folder" / "a.instgs").rename(tmp_path / "a.instgs")
    back = instgs.Scene.load(tmp_path / "a.instgs")
    assert same(back.background, scene.background) and same(back.templates[1], scene.templates[1])
    assert [i.group for i in back.instances] == [i.group for i in scene.instances]
    for name in ("b.ply", "c.spz", "d.sog"):
        scene.save(tmp_path / name)
        back = instgs.Scene.load(str(tmp_path / name))
        assert len(back) == len(scene) and not back.instances
        assert np.allclose(np.sort(back.background.means[:, 0]), np.sort(scene.flatten().means[:, 0]), atol=5e-3)
    scene.save(tmp_path / "e.glb", up=(0, -1, 0))
    # What is placed once is background of a .glb.
    glb = instgs.Scene.load(tmp_path / "e.glb")
    assert len(glb.instances) == 3 and len(glb) == len(scene)
    sizes = {}
    for pack in ("f32", "f16", "q8", "small"):
        scene.save(tmp_path / f"{pack}.instgs", pack=pack)
        sizes[pack] = (tmp_path / f"{pack}.instgs").stat().st_size
        assert len(instgs.Scene.load(tmp_path / f"{pack}.instgs")) == len(scene)
    assert sizes["f32"] > sizes["f16"] and sizes["f16"] > sizes["small"]


def test_errors_are_one_line_of_one_class(scene, tmp_path):
    for call, words in [
        (lambda: instgs.Scene.load(tmp_path / "missing.ply"), "missing.ply"),
        (lambda: instgs.Scene.load(tmp_path / "x.obj"), "scenes are .instgs, .ply"),
        (lambda: scene.save(tmp_path / "x.xyz"), "export to .ply"),
        (lambda: scene.save(tmp_path / "x.ply", pack="f16"), "is for .instgs and .html files"),
        (lambda: scene.save(tmp_path / "x.glb", up=(0, 0, 0)), "up has no direction"),
        (lambda: scene.orbit(3, up=(0, float("nan"), 0)), "up has no direction"),
        (lambda: scene.save(tmp_path / "x.instgs", pack="f8"), "none of f32, f16, q8 and small"),
        (lambda: instgs.Scene(instances=[(0, placed(0, 0, 0))]), "instance 0 uses template 0, but there are 0"),
        (lambda: instgs.Scene(templates=[], instances=[(0, np.zeros((3, 4)))]), "the matrix of instance 0 has determinant"),
        (lambda: instgs.Camera.load(tmp_path / "c.json"), "c.json"),
        (lambda: instgs.Camera(0, 4, 1, 1, 1, 1, np.eye(4)), "size 0x4"),
        (lambda: instgs.Camera(4, 4, 1, 1, 1, 1, np.eye(3)), "view_from_world has shape [3, 3], want [4, 4]"),
        (lambda: instgs.Camera.look_at((0, 0, 0), (0, 0, 0), (0, 0, 1)), "eye and target must differ"),
        (lambda: instgs.Camera.of_data(tmp_path), "has no cameras"),
        (lambda: instgs.Renderer("no such device"), "no such device"),
        (lambda: instgs.Renderer(-1), "no device -1"),
        (lambda: instgs.Camera(-4, 4, 1, 1, 1, 1, np.eye(4)), "size -4x4"),
        (lambda: scene.orbit(-1), "-1 cameras"),
        (lambda: scene.own(-1), "no instance -1"),
        (lambda: scene.save(tmp_path / "x.instgs", pack="small", data=tmp_path, finish=-1), "finish is -1"),
        (lambda: instgs.eval(scene, tmp_path, width=-1), "width is -1"),
        (lambda: instgs.synth(tmp_path / "data", views=-1), "views is -1"),
        (lambda: instgs.Poses([{"ids": [1], "world_from_template": np.eye(4)[None, :3], "score": "x"}]), '"score" of group 0'),
    ]:
        with pytest.raises(instgs.Error) as error:
            call()
        assert words in str(error.value) and "\n" not in str(error.value), error.value


def test_remarks_on_files_are_warnings(tmp_path):
    good = ball(5, 1, (0.5, 0.5, 0.5), 0)
    means = good.means
    means[2] = np.nan
    broken = instgs.Scene(instgs.Gaussians(means, good.quats, good.log_scales, good.opacity_logits, good.sh))
    broken.save(tmp_path / "a.instgs")
    with pytest.warns(UserWarning, match="dropped 1 Gaussians"):
        assert len(instgs.Scene.load(tmp_path / "a.instgs")) == 4


def test_values_without_a_use_are_warned_of(scene, tmp_path):
    with pytest.warns(UserWarning, match="up is for .glb, .usda, .usdc and .html"):
        scene.save(tmp_path / "a.ply", up=(0, 0, 1))
    with pytest.warns(UserWarning, match="device is for data"):
        scene.save(tmp_path / "a.instgs", pack="small", device=0)
    assert (tmp_path / "a.ply").is_file() and (tmp_path / "a.instgs").is_file()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        scene.save(tmp_path / "a.html", up=(0, 0, 1))


def test_a_background_can_be_replaced(scene):
    copy = scene.copy()
    scene.background = ball(3, 1, (1, 1, 1), 5)
    assert (scene.counts["background"], copy.counts["background"]) == (3, 60)
