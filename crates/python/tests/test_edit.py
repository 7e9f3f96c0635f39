import numpy as np
import pytest

import instgs


def xs(scene):
    return [round(float(i.centre[0]), 3) for i in scene.instances]


def test_moves_rotations_and_scales(scene):
    before = [i.centre for i in scene.instances]
    done = scene.edit("move", "group:red", by=(0, 0, 1))
    assert done == {"changed": [0, 1, 3], "added": [], "removed": [], "warnings": []}
    assert np.allclose([i.centre - b for i, b in zip(scene.instances, before)], [[0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 0, 1]])
    scene.edit("move", 2, to=[1, 2, 3])
    assert np.allclose(scene.instances[2].centre, [1, 2, 3], atol=1e-5)
    centre = scene.instances[0].centre
    scene.edit("rotate", [0], axis=(0, 1, 0), angle=90)
    scene.edit("scale", np.int64(0), by=2)
    turned = scene.instances[0]
    assert np.allclose(turned.world_from_template[:, :3], [[0, 0, 2], [0, 2, 0], [-2, 0, 0]], atol=1e-5)
    assert np.allclose(turned.centre, centre, atol=1e-5)


def test_copies_deletions_and_swaps(scene):
    left = xs(scene)[0]
    assert scene.edit("duplicate", "id:1", by=(0, 3, 0), yaw=30)["added"] == [4]
    assert xs(scene)[4] == left and scene.instances[4].group == "red"
    assert scene.edit("swap", 4, template=1)["changed"] == [4]
    assert [i.template for i in scene.instances] == [0, 0, 1, 0, 1]
    assert scene.edit("delete", "template:0")["removed"] == [0, 1, 3]
    assert [i.template for i in scene.instances] == [1, 1]


def test_a_group_is_recoloured_in_its_template(scene):
    templates = scene.templates
    scene.edit("recolour", "group:red", rgb=(0, 0.5, 0))
    assert scene.offsets["means"].shape == (0, 3)
    change = scene.templates[0].sh[:, 0] - templates[0].sh[:, 0]
    assert np.allclose(change, [0, 0.5 / 0.28209479177387814, 0], atol=1e-5)
    scene.edit("recolor", 0, rgb=[0.1, 0, 0])
    assert scene.offsets["sh_dc"].shape == (40, 3) and scene.instances[0].first_offset == 0
    assert np.allclose(scene.offsets["sh_dc"], [0.1 / 0.28209479177387814, 0, 0], atol=1e-5)


def test_scattering_cropping_erasing(scene):
    done = scene.edit("scatter", template=1, count=5, point=(0, 0, 8), extent=(9, 9), normal=(0, -1, 0), distance=1, seed=3)
    assert done["added"] == [4, 5, 6, 7, 8]
    path = scene.edit("scatter", template=0, count=3, path=[(0, 0, 9), (4, 0, 9)], up=(0, -1, 0))
    assert [xs(scene)[k] for k in path["added"]] == pytest.approx([0, 2, 4], abs=0.2)
    corners = [(10, 0, 8), (14, 0, 8), (14, 0, 12), (10, 0, 12)]
    area = scene.edit("scatter", template=1, count=4, area=corners, up=(0, -1, 0), seed=2)
    places = [scene.instances[k].centre for k in area["added"]]
    assert len(places) == 4 and all(9.99 < x < 14.01 and 7.99 < z < 12.01 for x, _, z in places)
    inside = int((scene.templates[0].means[:, 0] <= 0).sum())
    scene.edit("crop", template=0, box=[(-np.inf,) * 3, (0, np.inf, np.inf)])
    assert len(scene.templates[0]) == inside < 40
    first = scene.templates[1].means[0]
    scene.edit("erase", template=1, at=[first], radius=1e-3)
    assert len(scene.templates[1]) == 24


@pytest.mark.parametrize(
    "call, words",
    [
        (("move", 9, {"by": (0, 0, 1)}), "move: there is no instance 9: there are 0 to 3"),
        (("move", 0, {}), "move: want either by="),
        (("move", 0, {"by": (0, 0)}), "move: by has shape [2], want [3]"),
        (("move", 0, {"by": (0, 0, 1), "speed": 2}), "move: has no speed"),
        (("delete", None, {}), "delete: want an instance"),
        (("delete", "chair", {}), 'delete: "chair" names no instance'),
        (("scale", 0, {}), "scale: by=... is missing"),
        (("scale", 0, {"by": "large"}), "scale: by=large is not of the right kind"),
        (("erase", 0, {"template": 0, "at": [(0, 0, 0)], "radius": 1}), "erase: is for a template or the scene"),
        (("rotate", 0, {"yaw": 9, "up": (0, 0, 0)}), "rotate: up has no direction"),
        (("duplicate", 0, {"yaw": 9, "up": (0, np.nan, 0)}), "duplicate: up has no direction"),
        (("move", 0, {"by": (0, 0, 1), "up": (0, 1, 0)}), "move: has no up"),
        (
            ("scatter", None, {"template": 0, "count": 9_999_999, "point": (0, 0, 0), "extent": (1, 1)}),
            "scatter: count=9999999 is too many: at most 1000000",
        ),
        (
            ("scatter", None, {"template": 0, "count": 2, "path": np.eye(3), "area": np.eye(3)}),
            "scatter: want either path=... or area=...",
        ),
        (("fly", 0, {}), "fly: is no operation: there are duplicate, move"),
    ],
)
def test_what_is_wrong_is_said_and_changes_nothing(scene, call, words):
    operation, which, values = call
    before = xs(scene)
    with pytest.raises(instgs.Error) as error:
        scene.edit(operation, which, **values)
    assert str(error.value).startswith(words) and xs(scene) == before
