import gc
import json
import os
import threading

import numpy as np
import pytest

import instgs
from conftest import ktx2


def test_a_picture_has_colour_alpha_depth_and_ids(scene, camera, renderer):
    picture = renderer.render(scene, camera)
    assert picture.colour.shape == (64, 96, 3) and picture.colour.dtype == np.float32
    assert picture.alpha.shape == picture.depth.shape == picture.instance_ids.shape == (64, 96)
    assert picture.instance_ids.dtype == np.int32
    for k, instance in enumerate(scene.instances):
        x, y, z = instance.centre
        pixel = int(70 * y / z + 32), int(70 * x / z + 48)
        assert picture.instance_ids[pixel] == k
        assert abs(picture.depth[pixel] - z) < 0.6 and picture.alpha[pixel] > 0.95
        assert picture.colour[pixel].argmax() == (1 if instance.group == "green" else 0)
    ids = picture.instance_ids
    assert set(np.unique(ids)) <= {instgs.NOTHING, instgs.BACKGROUND, 0, 1, 2, 3}
    wall = ids == instgs.BACKGROUND
    assert wall.sum() > 100 and (picture.depth[wall] > 8).all()
    nothing = ids == instgs.NOTHING
    assert (picture.alpha[nothing] < 0.6).all() and (picture.alpha[~nothing] > 0.4).all()


def test_pictures_are_those_of_the_program(scene, camera, renderer, program, tmp_path):
    scene.save(tmp_path / "s.instgs")
    view = {name: getattr(camera, name) for name in ("name", "width", "height", "fx", "fy", "cx", "cy")}
    view["view_from_world"] = camera.view_from_world.tolist()
    (tmp_path / "c.json").write_text(json.dumps(view))
    report = program(
        *("render", "--scene", tmp_path / "s.instgs", "--camera", tmp_path / "c.json", "--out", tmp_path),
        # The package draws in f32, the program in f16 unless told otherwise.
        *("--format", "ktx2", "--depth", "--background", "0.2,0.4,0.6", "--device-precision", "f32"),
    )
    assert report["device"] == renderer.device
    picture = renderer.render(scene, camera, background=(0.2, 0.4, 0.6))
    want = ktx2(tmp_path / "front.ktx2")
    assert want.shape == (64, 96, 4) and want[..., 3].max() > 0.9
    assert np.abs(picture.colour - want[..., :3]).max() <= 1e-6
    assert np.abs(picture.alpha - want[..., 3]).max() <= 1e-6
    assert np.abs(picture.depth - ktx2(tmp_path / "front.depth.ktx2")[..., 0]).max() <= 1e-5
    assert report["frames"][0]["visible"] == picture.visible


def test_a_flattened_scene_looks_the_same(scene, camera, renderer):
    flat = instgs.Scene(scene.flatten())
    a, b = renderer.render(scene, camera), renderer.render(flat, camera, ids=False)
    assert np.abs(a.colour - b.colour).max() < 5e-4 and b.instance_ids is None
    # Planted: the comparison sees one Gaussian that moved.
    means = flat.background.means
    means[45] += 0.3
    cloud = flat.background
    flat.background = instgs.Gaussians(means, cloud.quats, cloud.log_scales, cloud.opacity_logits, cloud.sh)
    assert np.abs(a.colour - renderer.render(flat, camera).colour).max() > 0.01


def test_an_edited_scene_is_drawn_anew(scene, camera, renderer):
    before = renderer.render(scene, camera)
    scene.edit("recolour", "group:red", rgb=(-0.8, 0, 0.8))
    after = renderer.render(scene, camera)
    red = np.isin(before.instance_ids, [0, 1, 3])
    assert (after.colour[red][:, 2] > after.colour[red][:, 0]).mean() > 0.95
    # All instances of the template changed, and no other.
    for k in (0, 1, 3):
        assert np.abs(after.colour - before.colour)[before.instance_ids == k].mean() > 0.2
    sure = (before.instance_ids == 2) & (before.alpha > 0.99)
    assert np.abs(after.colour - before.colour)[sure].mean() < 0.05


def test_a_scene_may_be_edited_while_it_is_drawn(scene, camera, renderer):
    failed = []

    def draw():
        try:
            for _ in range(20):
                renderer.render(scene, camera)
        except BaseException as error:
            failed.append(error)

    before = scene.instances[0].centre
    thread = threading.Thread(target=draw)
    thread.start()
    edits = 0
    while thread.is_alive() or edits == 0:
        scene.edit("move", 0, by=(0, 0, 0.25))
        scene.background = scene.background
        edits += 1
    thread.join()
    assert not failed
    assert scene.instances[0].centre[2] - before[2] == pytest.approx(0.25 * edits, rel=1e-3)


def test_hidden_instances_come_back(scene, camera, renderer):
    whole = renderer.render(scene, camera)
    part = renderer.render(scene, camera, hide="group:red")
    assert set(np.unique(part.instance_ids)) & {0, 1, 2, 3} == {2}
    alone = scene.copy()
    alone.edit("delete", "group:red")
    assert np.array_equal(part.colour, renderer.render(alone, camera).colour)
    assert np.array_equal(whole.colour, renderer.render(scene, camera, hide=None).colour)
    assert np.array_equal(whole.colour, renderer.render(scene, camera, hide=[]).colour)
    with pytest.raises(instgs.Error, match="hide: there is no instance 7"):
        renderer.render(scene, camera, hide=7)


def test_options_are_checked_and_used(scene, camera, renderer):
    plain = renderer.render(scene, camera)
    assert np.array_equal(plain.colour, renderer.render(scene, camera).colour)
    assert np.allclose(
        renderer.render(scene, camera, background=(1, 0.5, 0)).colour,
        plain.colour + (1 - plain.alpha[..., None]) * np.float32([1, 0.5, 0]),
        atol=1e-5,
    )
    assert renderer.render(scene, camera, near=8).instance_ids.max() < 0
    assert not np.array_equal(renderer.render(scene, camera, dilation=4).colour, plain.colour)
    assert not np.array_equal(renderer.render(scene, camera, antialias=True).colour, plain.colour)
    assert renderer.render(scene, camera, lod=20).colour.shape == plain.colour.shape
    with pytest.raises(instgs.Error, match="near: -1"):
        renderer.render(scene, camera, near=-1)


def test_pictures_are_saved_and_shown(scene, camera, renderer, tmp_path):
    picture = renderer.render(scene, camera)
    rgb = picture.rgb8()
    assert rgb.dtype == np.uint8 and np.array_equal(rgb, (picture.colour.clip(0, 1) * np.float32(255) + 0.5).astype(np.uint8))
    picture.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == picture._repr_png_()
    assert picture._repr_png_().startswith(b"\x89PNG")


def test_cameras_of_circles_and_data(scene, renderer, data):
    circle = scene.orbit(3, (40, 30))
    assert [c.name for c in circle] == ["000", "001", "002"] and (circle[0].width, circle[0].height) == (40, 30)
    assert all(renderer.render(scene, c).alpha.max() > 0.5 for c in circle)
    views = [len(instgs.Camera.of_data(data, split)) for split in ("train", "test", "all")]
    assert views[0] + views[1] == views[2] == 10 and views[1] > 0
    camera = instgs.Camera.look_at((0, -3, 0), (0, 0, 0), (0, 0, 1), fov=40, size=(60, 40))
    assert np.allclose(camera.position, [0, -3, 0]) and camera.resized(120, 80).fx == pytest.approx(2 * camera.fx)


def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="memory is read from /proc")
def test_a_thousand_pictures_take_no_more_memory_than_a_hundred(scene, renderer):
    small = instgs.Camera(32, 24, 24, 24, 16, 12, np.eye(4))

    def draw(count):
        for _ in range(count):
            renderer.render(scene, small)
        gc.collect()
        return resident_bytes()

    after_hundred = draw(100)
    assert draw(1000) - after_hundred < 4 << 20
