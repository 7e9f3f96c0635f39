import json
import os
import signal
import threading
import time

import numpy as np
import pytest

import instgs

FEW = {"steps": 30, "max_gaussians": 2000, "checkpoint_every": 1000}


def test_a_plain_cloud_is_trained_and_its_events_are_those_of_the_log(data, tmp_path, program):
    events, threads = [], set()

    def on_event(event):
        threads.add(threading.get_ident())
        events.append(event)

    ticks = []
    done = threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.01)

    ticker = threading.Thread(target=tick)
    ticker.start()
    trained = instgs.train(data, tmp_path / "run", "3dgs", config="quick", set=FEW, on_event=on_event)
    done.set()
    ticker.join()
    # The interpreter was free: another thread went on, without a pause of a second.
    assert max(np.diff(ticks)) < 1
    assert threads == {threading.get_ident()}
    log = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    told_alone = ("photo_read", "test_view")
    ours = [{k: v for k, v in e.items() if k != "phase"} for e in events if "phase" in e and e["event"] not in told_alone]
    assert ours == log and [e["event"] for e in log][::len(log) - 1] == ["started", "finished"]
    photos = [(e["done"], e["total"]) for e in events if e["event"] == "photo_read"]
    assert photos == [(k, 10) for k in range(1, 11)]
    assert trained.report["steps"] == 30 and trained.report["eval"]["psnr"] > 5
    assert trained.report == json.loads((tmp_path / "run" / "report.json").read_text())
    assert (tmp_path / "run" / "report.html").is_file() and trained.folder == tmp_path / "run"
    assert len(trained.scene) == trained.report["gaussians"]["expanded"] > 0

    seen = []
    figures = instgs.eval(trained.scene, data, on_view=lambda name, figures: seen.append((name, figures["psnr"])))
    assert figures["mean"]["psnr"] == pytest.approx(trained.report["eval"]["psnr"], abs=1e-4)
    assert [(v["name"], v["psnr"]) for v in figures["views"]] == seen
    want = program("eval", "--scene", tmp_path / "run" / "scene.instgs", "--data", data)
    assert [v["name"] for v in want["views"]] == [v["name"] for v in figures["views"]]
    assert figures["mean"]["ssim"] == pytest.approx(want["mean"]["ssim"], abs=1e-5)
    assert figures["mean"]["psnr"] == pytest.approx(want["mean"]["psnr"], abs=1e-4)

    with pytest.raises(instgs.Error, match="holds a run already"):
        instgs.train(data, tmp_path / "run", "3dgs", config="quick", set=FEW)


def test_repeated_objects_become_instances(data, tmp_path):
    names = []
    trained = instgs.train(
        data,
        tmp_path / "run",
        "instgs",
        config="instgs_quick",
        set={"steps": 60, "joint.steps": 5, "max_gaussians": 4000, "groups": data / "groups.json"},
        on_event=lambda event: names.append((event["event"], event.get("phase") or event.get("stage"))),
    )
    assert len(trained.scene.instances) == 3 and {i.group for i in trained.scene.instances} == {"car"}
    wanted = [("phase_started", "plain_cloud"), ("stage_finished", "segment"), ("stage_finished", "merge"), ("prepared", None)]
    places = [names.index(name) for name in [*wanted, ("phase_started", "joint"), ("finished", "joint")]]
    assert places == sorted(places)
    assert trained.report["vanilla"]["steps"] == 60 and trained.report["steps"] == 5


def test_an_exception_of_the_callback_stops_the_run(data, tmp_path):
    class Enough(Exception):
        pass

    def on_event(event):
        if event["event"] == "step":
            raise Enough("this will do")

    with pytest.raises(Enough, match="this will do"):
        instgs.train(data, tmp_path / "run", "3dgs", config="quick", set={**FEW, "steps": 100_000}, on_event=on_event)
    checkpoints = list((tmp_path / "run" / "checkpoints").iterdir())
    assert checkpoints
    # It goes on from there, with its own configuration but for what is set.
    started = []
    go_on = instgs.train(
        data,
        tmp_path / "run",
        resume=True,
        set={"steps": np.int64(40)},
        on_event=lambda event: event["event"] == "started" and started.append(event),
    )
    assert started[0]["resumed"] and started[0]["step"] > 0 and go_on.report["steps"] == 40


def test_an_exception_while_photos_are_read_stops_the_run(data, tmp_path):
    class Enough(Exception):
        pass

    def on_event(event):
        if event["event"] == "photo_read":
            raise Enough

    with pytest.raises(Enough):
        instgs.train(data, tmp_path / "run", "3dgs", config="quick", set={**FEW, "steps": 1_000_000}, on_event=on_event)


def test_ctrl_c_stops_the_run(data, tmp_path):
    began = threading.Event()

    def press():
        began.wait(60)
        os.kill(os.getpid(), signal.SIGINT)

    presser = threading.Thread(target=press)
    presser.start()

    def on_event(event):
        if event["event"] == "step":
            began.set()

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        instgs.train(data, tmp_path / "run", "3dgs", config="quick", set={**FEW, "steps": 1_000_000}, on_event=on_event)
    presser.join()
    assert time.monotonic() - start < 60
    assert list((tmp_path / "run" / "checkpoints").iterdir())


@pytest.mark.parametrize(
    "values, words",
    [
        ({"set": {"stepz": 1}}, "stepz"),
        ({"set": {"steps": "many"}}, "steps"),
        ({"set": {"steps": [1]}}, "set: steps = [1] is no number, text or path"),
        ({"method": "nerf"}, "nerf"),
        ({"config": "no_such_preset"}, "no_such_preset"),
    ],
)
def test_a_faulty_configuration_writes_nothing(data, tmp_path, values, words):
    with pytest.raises(instgs.Error) as error:
        instgs.train(data, tmp_path / "run", **values)
    assert words in str(error.value) and not (tmp_path / "run").exists()


def test_there_must_be_a_run_to_resume(data, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.warns(UserWarning, match="run holds no run to resume: a new one begins"):
        with pytest.raises(instgs.Error, match="has no cameras"):
            instgs.train(tmp_path / "empty", tmp_path / "run", resume=True)
    with pytest.raises(instgs.Error, match="accept_changed_data is for a run that goes on"):
        instgs.train(data, tmp_path / "run", accept_changed_data=True)
    assert not (tmp_path / "run").exists()


def test_data_without_cameras_writes_nothing(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(instgs.Error, match="has no cameras"):
        instgs.train(tmp_path / "empty", tmp_path / "run")
    assert not (tmp_path / "run").exists()
