"""Small files for the views of a data set, and what stops them."""

import os
import signal
import threading
import time

import pytest

import instgs


@pytest.fixture(scope="module")
def run(data, tmp_path_factory):
    """A short run."""
    out = tmp_path_factory.mktemp("small") / "run"
    settings = {"steps": 60, "max_gaussians": 1500, "checkpoint_every": 1000, "width": 64}
    return instgs.train(data, out, "3dgs", config="quick", set=settings)


def test_a_small_file_is_finished_as_by_export(run, data, tmp_path, program):
    scene, folder = run.scene, run.folder
    scene.save(tmp_path / "as_it_is.instgs", pack="small", data=data, picture_psnr=40)
    scene.save(tmp_path / "a.instgs", pack="small", data=data, picture_psnr=40, finish=12, run=folder)
    scene.save(tmp_path / "whole.instgs", pack="small", data=data, picture_psnr=40, finish=12)
    flags = ("--data", data, "--pack", "small", "--picture-psnr", "40", "--finish", "12")
    program("export", "--scene", folder / "scene.instgs", "--to", tmp_path / "b.instgs", *flags)
    files = [(tmp_path / f"{name}.instgs").read_bytes() for name in ("a", "b", "whole", "as_it_is")]
    assert files[0] == files[1]
    # The steps change it, and so does the width of the run's photos.
    assert len(set(files)) == 3
    figures = instgs.eval(instgs.Scene.load(tmp_path / "a.instgs"), data, width=64)
    assert figures["mean"]["psnr"] > run.report["eval"]["psnr"] - 1


def test_what_does_not_belong_together_is_refused(run, data, tmp_path):
    save = lambda **more: run.scene.save(tmp_path / "x.instgs", pack="small", **more)  # noqa: E731
    for more, words in [
        ({"finish": 5}, "finish and run are for the photos of a data set"),
        ({"picture_psnr": 40}, "give its folder as data"),
        ({"run": run.folder}, "finish and run are for the photos of a data set"),
        ({"run": run.folder, "data": data}, "give finish, too"),
        ({"run": tmp_path / "none", "data": data, "finish": 5}, "none"),
        ({"data": data, "finish": 100_001}, "must be from 0 to 100000 steps"),
    ]:
        with pytest.raises(instgs.Error) as error:
            save(**more)
        assert words in str(error.value), error.value
    assert not (tmp_path / "x.instgs").exists()


def stopped_by_ctrl_c(work):
    """Does the work, presses Ctrl-C after a second, and returns how many seconds later it ended."""
    pressed = []

    def press():
        pressed.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    # A shell's background jobs ignore Ctrl-C, and so would this process then.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(1, press)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
        return time.monotonic() - pressed[0]
    finally:
        timer.cancel()
        timer.join()


def test_ctrl_c_stops_long_work(run, data, tmp_path):
    out = tmp_path / "x.instgs"
    assert stopped_by_ctrl_c(lambda: run.scene.save(out, pack="small", data=data, finish=100_000)) < 20
    assert not out.exists()
    size = {"size": (96, 54), "instances": 3}
    assert stopped_by_ctrl_c(lambda: instgs.synth(tmp_path / "cars", "cars", views=5000, **size)) < 20
    # What it leaves is not in the way.
    instgs.synth(tmp_path / "cars", "cars", views=10, **size)
    assert len(instgs.Camera.of_data(tmp_path / "cars", split="all")) == 10
