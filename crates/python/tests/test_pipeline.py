"""The stages one by one: the same results as a whole run, arrays between them, and what a user may change in them."""

import gc
import json
import shutil
import warnings
import weakref

import numpy as np
import pytest

import instgs

SMALL = {"joint.steps": 4, "max_gaussians": 3000, "checkpoint_every": 1000}


@pytest.fixture(scope="module")
def cloud(data, tmp_path_factory):
    """A plain cloud, as a file: what a stage labels is what a file holds."""
    out = tmp_path_factory.mktemp("cloud") / "run"
    instgs.train(data, out, "3dgs", config="quick", set={"steps": 60, "max_gaussians": 3000, "checkpoint_every": 1000})
    return out / "point_cloud.ply"


@pytest.fixture(scope="module")
def segmented(data, cloud, tmp_path_factory):
    """A pipeline with the true groups, after its first stage, and the events of that."""
    events = []
    pipeline = instgs.Pipeline(
        data,
        tmp_path_factory.mktemp("stages") / "out",
        config="instgs_quick",
        set={**SMALL, "groups": data / "groups.json", "init_scene": cloud},
        on_event=lambda event: events.append((event["event"], event.get("stage"))),
    )
    return pipeline, pipeline.segment(instgs.Scene.load(cloud)), list(events)


def true_groups(data):
    """The groups of the data set as the constructor of Poses takes them."""
    groups = json.loads((data / "groups.json").read_text())
    return [
        {
            "name": group.get("name"),
            "ids": [i["instance_id"] for i in group["instances"]],
            "world_from_template": [np.array(i["world_from_template"])[:3] for i in group["instances"]],
        }
        for group in groups
    ]


def test_segments_are_those_of_the_command_line(data, cloud, segmented, tmp_path, program):
    pipeline, segments, events = segmented
    count = len(segments)
    assert count == len(segments.cloud) == len(instgs.Scene.load(cloud)) > 0
    for array, kind in [(segments.labels, np.uint32), (segments.weights, np.float32), (segments.views_seen, np.uint32)]:
        assert array.shape == (count,) and array.dtype == kind
    assert ("stage_finished", "consensus") in events and ("stage_finished", "segment") in events
    assert {path.name for path in pipeline.folder.iterdir()} >= {"labels.safetensors", "consensus.json", "review.html"}
    assert len(segments.cameras) == 8 and segments.cameras[0].width == 96
    want = program(
        "segment", "--scene", cloud, "--data", data, "--out", tmp_path / "cli", "--config", "instgs_quick",
        "--set", "max_gaussians=3000",
    )
    assert segments.objects == want["consensus"]["objects"] and len(segments.objects) == 3
    ids, counts = np.unique(segments.labels, return_counts=True)
    assert dict(zip(ids.tolist(), counts.tolist())) == {
        0: want["background"],
        **{o["id"]: o["gaussians"] for o in segments.objects},
    }
    ours, theirs = ((folder / "labels.safetensors").read_bytes() for folder in (pipeline.folder, tmp_path / "cli"))
    assert ours == theirs


def test_the_stages_give_what_a_whole_run_gives(data, cloud, segmented, tmp_path):
    pipeline, segments, _ = segmented
    poses = pipeline.register(segments)
    merged = pipeline.template(segments, poses)
    assert len(poses) == 1 and poses.groups[0]["ids"].tolist() == [1, 2, 3] and poses.objects == []
    assert len(merged.scene.instances) == 3 and merged.groups[0]["template"] == 0
    for instance, pose in zip(merged.scene.instances, poses.groups[0]["world_from_template"]):
        assert instance.world_from_template == pytest.approx(pose, abs=1e-6)
    trained = pipeline.joint(merged.scene)
    assert trained.folder == pipeline.folder and trained.report["steps"] == 4
    page = (pipeline.folder / "report.html").read_text()
    assert "<h2>The scene</h2>" in page and "<iframe" in page

    whole = instgs.train(
        data,
        tmp_path / "whole",
        "instgs",
        config="instgs_quick",
        set={**SMALL, "groups": data / "groups.json", "init_scene": cloud},
    )
    assert np.array_equal(whole.scene.background.means, trained.scene.background.means)
    assert np.array_equal(whole.scene.templates[0].sh, trained.scene.templates[0].sh)
    assert np.array_equal(whole.scene.offsets["means"], trained.scene.offsets["means"])
    # The joint phase learned something, and is there once.
    assert not np.array_equal(merged.scene.templates[0].sh, trained.scene.templates[0].sh)
    with pytest.raises(instgs.Error, match="holds a joint phase already"):
        pipeline.joint(merged.scene)
    with pytest.raises(instgs.Error, match="holds segments or a run already"):
        instgs.Pipeline(data, pipeline.folder)
    again = instgs.Pipeline(data, pipeline.folder, resume=True)
    assert np.array_equal(again.segment(segments.cloud).labels, segments.labels)
    other = merged.scene.copy()
    other.edit("move", 0, by=(1, 0, 0))
    with pytest.raises(instgs.Error, match="began with another scene"):
        again.joint(other)
    # The one that it began with: all of it is done already.
    assert again.joint(merged.scene).report["steps"] == trained.report["steps"]


def test_objects_are_registered_without_groups(data, cloud, segmented, tmp_path):
    _, segments, _ = segmented
    pipeline = instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", set=SMALL)
    with warnings.catch_warnings():
        # So small a cloud may leave poses in doubt.
        warnings.simplefilter("ignore")
        poses = pipeline.register(segments)
    assert {o["instance"] for o in poses.objects} <= {1, 2, 3} and poses.objects
    assert {o["verdict"] for o in poses.objects} <= {"reference", "accepted", "symmetric", "ambiguous", "rejected"}
    assert (pipeline.folder / "groups.json").is_file()


def test_groups_and_labels_of_ones_own(data, segmented, tmp_path):
    _, segments, _ = segmented
    pipeline = instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", set=SMALL)
    [group] = true_groups(data)
    merged = pipeline.template(segments, instgs.Poses([group]))
    assert [i.id for i in merged.scene.instances] == group["ids"] and merged.scene.groups[0].name == "car"
    # Two of the three, by what register returns, changed.
    [found] = instgs.Poses([group]).groups
    assert found["world_from_template"].shape == (3, 3, 4) and found["world_from_template"].dtype == np.float32
    two = {**found, "ids": found["ids"][:2], "world_from_template": found["world_from_template"][:2]}
    assert len(pipeline.template(segments, instgs.Poses([two])).scene.instances) == 2

    nothing = segments.relabelled(np.zeros(len(segments)))
    assert not nothing.labels.any() and segments.labels.any()
    with pytest.warns(UserWarning, match="nothing is shared"):
        merged = pipeline.template(nothing, instgs.Poses([group]))
    assert merged.scene.instances == [] and len(merged.scene.background) == len(segments) - merged.hardly_seen


@pytest.mark.parametrize(
    "change, words",
    [
        ({"ids": None}, 'group 0 has no "ids"'),
        ({"ids": [1, 2, 70_000]}, "ids of group 0: 70000 is no id of an object: want whole numbers from 0 to 65535"),
        ({"ids": [1, 2, -1]}, "ids of group 0: -1 is no id"),
        ({"ids": [1, 2, 2.5]}, "ids of group 0: 2.5 is no id"),
        ({"ids": [1, 2]}, "world_from_template of group 0 has shape [3, 3, 4], want [2, 3, 4]"),
        ({"world_from_template": np.zeros((3, 3, 4))}, "world_from_template of group 0, object 0"),
    ],
)
def test_faulty_groups_are_refused(data, change, words):
    [group] = true_groups(data)
    group = {key: value for key, value in {**group, **change}.items() if value is not None}
    with pytest.raises(instgs.Error) as error:
        instgs.Poses([group])
    assert words in str(error.value)


def test_faulty_input_is_refused(data, scene, segmented, tmp_path):
    pipeline, segments, _ = segmented
    with pytest.raises(instgs.Error, match="has 4 instances already"):
        pipeline.segment(scene)
    with pytest.raises(instgs.Error, match="labels has shape"):
        segments.relabelled([1, 2, 3])
    for wrong in (70_000, -1, 1.5):
        with pytest.raises(instgs.Error, match=f"labels: {wrong} is no id"):
            segments.relabelled(np.full(len(segments), wrong))
    [group] = true_groups(data)
    other = instgs.Pipeline(data, tmp_path / "out", config="instgs_quick")
    with pytest.raises(instgs.Error, match="of an earlier instance"):
        other.template(segments, instgs.Poses([{**group, "ids": [1, 1, 2]}]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(instgs.Error, match="has no cameras"):
        instgs.Pipeline(tmp_path / "empty", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_an_exception_of_the_callback_stops_a_stage(data, cloud, tmp_path):
    class Enough(Exception):
        pass

    def on_event(event):
        raise Enough(event["event"])

    pipeline = instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", set=SMALL, on_event=on_event)
    with pytest.raises(Enough, match="stage_started"):
        pipeline.segment(instgs.Scene.load(cloud))
    assert not (tmp_path / "out" / "labels.safetensors").exists()


def test_a_stopped_joint_phase_goes_on_with_an_edited_scene(data, cloud, tmp_path):
    class Enough(Exception):
        pass

    def on_event(event):
        if event["event"] == "step":
            raise Enough

    def edited(pipeline):
        segments = pipeline.segment(instgs.Scene.load(cloud))
        scene = pipeline.template(segments, pipeline.register(segments)).scene
        scene.edit("move", 0, by=(0.01, 0, 0))
        return scene

    out = tmp_path / "out"
    settings = {**SMALL, "joint.steps": 1_000_000, "groups": data / "groups.json"}
    first = instgs.Pipeline(data, out, config="instgs_quick", set=settings, on_event=on_event)
    with pytest.raises(Enough):
        first.joint(edited(first))
    before = {name: (out / name).read_bytes() for name in ("groups.json", "initial.instgs", "point_cloud.ply")}

    started = []
    again = instgs.Pipeline(
        data,
        out,
        resume=True,
        set={"joint.steps": 60},
        on_event=lambda event: event["event"] == "started" and started.append(event),
    )
    trained = again.joint(edited(again))
    assert started[0]["resumed"] and started[0]["step"] > 0 and trained.report["steps"] == 60
    other = instgs.Scene.load(cloud)
    c = other.background
    other.background = instgs.Gaussians(c.means + 0.1, c.quats, c.log_scales, c.opacity_logits, c.sh)
    with pytest.raises(instgs.Error, match="its joint phase began with another cloud"):
        again.segment(other)
    assert {name: (out / name).read_bytes() for name in before} == before


def test_a_resumed_segmentation_refuses_other_settings(data, segmented, tmp_path):
    pipeline, segments, _ = segmented
    out = tmp_path / "out"
    shutil.copytree(pipeline.folder, out)
    before = (out / "config.toml").read_bytes()
    again = instgs.Pipeline(data, out, resume=True, set={"segment.alpha": 3.5})
    with pytest.raises(instgs.Error, match="its objects were found with segment.alpha"):
        again.segment(segments.cloud)
    assert (out / "config.toml").read_bytes() == before


def test_labels_that_are_there_need_no_masks(data, segmented, tmp_path):
    pipeline, segments, _ = segmented
    shutil.copytree(data, tmp_path / "cars")
    shutil.rmtree(tmp_path / "cars" / "masks")
    shutil.copytree(pipeline.folder, tmp_path / "out")
    again = instgs.Pipeline(tmp_path / "cars", tmp_path / "out", resume=True)
    with pytest.warns(UserWarning, match="the contact sheet of masks is missing: "):
        assert np.array_equal(again.segment(segments.cloud).labels, segments.labels)


def test_there_must_be_something_to_resume(data, tmp_path):
    with pytest.warns(UserWarning, match="out holds no run to resume: a new one begins"):
        instgs.Pipeline(data, tmp_path / "out", resume=True)
    with pytest.raises(instgs.Error, match="accept_changed_data is for a run that goes on"):
        instgs.Pipeline(data, tmp_path / "out", accept_changed_data=True)


def test_numbers_of_numpy_are_settings(data, tmp_path):
    values = {"joint.steps": np.int32(7), "segment.alpha": np.float32(0.5), "antialias": np.bool_(True)}
    instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", set=values)
    with pytest.raises(instgs.Error, match="segment.alpha"):
        instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", set={"segment.alpha": np.float32(-1)})


def test_a_pipeline_that_its_callback_holds_is_collected(data, tmp_path):
    class Watcher:
        def __init__(self):
            self.pipeline = instgs.Pipeline(data, tmp_path / "out", config="instgs_quick", on_event=self.see)

        def see(self, event):
            pass

    watcher = weakref.ref(Watcher())
    gc.collect()
    assert watcher() is None
