"""The installed package, beside the program `mvfusion` that `MVFUSION_PROGRAM` names."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import numpy as np

import mvfusion

PROGRAM = os.environ.get("MVFUSION_PROGRAM")
needs_program = unittest.skipUnless(PROGRAM, "MVFUSION_PROGRAM does not name the program mvfusion")

# A model so small that a step takes milliseconds, and that passes through all stages.
TINY = {
    "train": {"stages": {"geometry": 4, "deformation": 4, "refinement": 4}, "batch_size": 1},
    "train.log_interval": 1,
    "model": {"width": 8, "grid": {"features": 2, "resolution": [4, 4, 4, 4], "multipliers": [1]}},
    "init.dynamic_points": np.int64(60),
    "init.motion_points": 60,
    "init.box_reach": float("inf"),
    "motion.samples": 4,
    "eval.strips": 2,
}
LONG = {**TINY, "train.stages": {"geometry": 10_000, "deformation": 10_000, "refinement": 10_000}}


def run_program(*arguments):
    """What the program prints."""
    return subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def picture(path):
    """A PNG file as an array of bytes."""
    from PIL import Image

    return np.asarray(Image.open(path))


def eight_bits(image):
    """As the program rounds."""
    levels = np.floor(255 * np.clip(image, 0, 1) + 0.5).astype(np.uint8)
    return levels if levels.ndim == 3 else np.repeat(levels[:, :, None], 3, axis=2)


class PackageTest(unittest.TestCase):
    """One finished run, which the tests read."""

    @classmethod
    def setUpClass(cls):
        place = tempfile.TemporaryDirectory()
        cls.addClassCleanup(place.cleanup)
        cls.place = Path(place.name)
        cls.lines = []
        cls.run_ = mvfusion.train(TINY, out=cls.place / "run", callback=cls.lines.append, device="cpu", seed=3)

    def assert_refused(self, words, call, kind=mvfusion.UsageError, code=2):
        with self.assertRaises(kind) as caught:
            call()
        message = str(caught.exception)
        for word in words:
            self.assertIn(word, message)
        self.assertTrue(message.endswith((".", "`", "?")), message)
        self.assertEqual(caught.exception.exit_code, code)
        self.assertIsInstance(caught.exception, mvfusion.MvfusionError)

    def test_a_finished_run_has_its_facts_its_metrics_and_its_configuration(self):
        run = mvfusion.load(str(self.run_.path))
        self.assertTrue(run.is_finished)
        self.assertEqual((run.steps, run.total_steps, run.device), (12, 12, "flex"))
        self.assertEqual(run.metrics, json.loads((run.path / "results.json").read_text()))
        self.assertEqual((run.config["seed"], run.config["model"]["width"]), (3, 8))
        self.assertEqual(run.config["init"]["dynamic_points"], 60)
        self.assertEqual(run.config["init"]["box_reach"], float("inf"))
        self.assertEqual(run.times.tolist(), sorted({view.time for view in run.views if view.split == "train"}))
        self.assertIn("12 of 12", repr(run))

    def test_the_callback_hears_of_every_logged_step(self):
        self.assertEqual([line["step"] for line in self.lines], list(range(1, 13)))
        self.assertEqual({line["stage"] for line in self.lines}, {"geometry", "deformation", "refinement"})
        logged = [json.loads(line) for line in (self.run_.path / "metrics.jsonl").read_text().splitlines()]
        self.assertEqual(self.lines, logged)
        self.assertGreater(self.lines[0]["gaussians"]["dynamic"], 0)

    @needs_program
    def test_a_render_is_that_of_the_program_to_the_last_level(self):
        layers = ["composed", "static", "dynamic", "mask", "masked_static", "masked_dynamic", "alpha"]
        for options, without in ([], False), (["--no-mfta"], True):
            out = self.place / f"pictures-{without}"
            run_program("render", self.run_.path, "--views", "test", "--layers", ",".join(layers), "--format", "png",
                        "--device", "cpu", "--out", out, *options)
            test = [view for view in self.run_.views if view.split == "test"]
            self.assertEqual(len(list((out / "composed").iterdir())), len(test))
            for index in (0, len(test) // 2, len(test) - 1):
                view = test[index]
                rendered = self.run_.render(view.camera, view.time, layers, without_mfta=without)
                self.assertEqual(list(rendered), layers)
                for layer, image in rendered.items():
                    expected = picture(out / layer / f"{index:05}.png")
                    np.testing.assert_array_equal(eight_bits(image), expected, f"{layer} of {view}")
        self.assertEqual(image.dtype, np.float32)

    @needs_program
    def test_gaussians_are_those_of_the_npz_files(self):
        out = self.place / "arrays"
        run_program("export", self.run_.path, "--format", "npz", "--frames", 3, "--device", "cpu", "--out", out)
        self.assertEqual({path.name for path in out.iterdir()}, {"cameras.json", "dynamic.npz", "frames", "static.npz"})
        self.assert_same(self.run_.gaussians(), out / "dynamic.npz")
        self.assert_same(self.run_.gaussians(branch="static"), out / "static.npz")
        for number, at in enumerate(np.linspace(0, self.run_.times[-1], 3), 1):
            with np.load(out / "frames" / f"frame{number:04}.npz") as file:
                self.assertEqual((file["time"].shape, float(file["time"])), ((), at))
            self.assert_same(self.run_.gaussians(at), out / "frames" / f"frame{number:04}.npz")
        run_program("export", self.run_.path, "--format", "npz", "--time", 0.25, "--no-mfta", "--device", "cpu",
                    "--out", self.place / "moment")
        self.assert_same(self.run_.gaussians(0.25, without_mfta=True), self.place / "moment" / "dynamic.npz")

    def assert_same(self, gaussians, path):
        with np.load(path) as file:
            self.assertEqual(set(file) - {"time"}, set(gaussians), path)
            for name, values in gaussians.items():
                self.assertEqual((file[name].dtype, values.dtype), (np.float32, np.float32))
                np.testing.assert_array_equal(values, file[name], f"{name} of {path}")

    def test_gaussians_are_activated(self):
        for branch, at in ("dynamic", None), ("dynamic", 0.5), ("static", None), ("scene", 0.5):
            g = self.run_.gaussians(at, branch)
            count = len(g["means"])
            self.assertGreater(count, 0)
            self.assertEqual({len(values) for values in g.values()}, {count})
            np.testing.assert_allclose(np.linalg.norm(g["quaternions"], axis=1), 1, rtol=1e-6)
            self.assertTrue((g["scales"] > 0).all() and (g["opacities"] > 0).all() and (g["opacities"] < 1).all())
            np.testing.assert_allclose(g["colours"], 0.5 + 0.2820948 * g["sh"][:, 0], rtol=1e-6, atol=1e-6)
            self.assertEqual("masks" in g, branch == "dynamic")
        g["means"][0] = 7
        self.assertNotEqual(self.run_.gaussians(0.5, "scene")["means"][0, 0], 7, "arrays are the caller's own")

    def test_a_camera_of_ones_own_sees_what_the_view_sees(self):
        view = self.run_.views[0]
        own = mvfusion.Camera(view.camera.intrinsics, view.camera.world_to_camera, view.camera.size)
        self.assertEqual(own, view.camera)
        images = [self.run_.render(camera, view.time, "composed")["composed"] for camera in (view.camera, own)]
        np.testing.assert_array_equal(*images)
        self.assertEqual(images[0].shape, view.photo().shape)
        half = own.resized(own.size[0] // 2, own.size[1] // 2)
        depth = self.run_.render(half, view.time, ["depth", "motion"])
        self.assertEqual([image.shape for image in depth.values()], [half.size[::-1]] * 2)
        # A point on the optical axis falls on the principal point.
        ahead = own.centre + 2 * own.world_to_camera[2, :3]
        x, y, z = own.intrinsics @ (own.world_to_camera[:3] @ [*ahead, 1])
        np.testing.assert_allclose([x / z, y / z], own.intrinsics[:2, 2])

    def test_all_layers_and_the_static_branch_alone(self):
        camera = self.run_.views[0].camera
        self.assertEqual(list(self.run_.render(camera, 0.5, "all")), self.run_.layers)
        still = self.run_.render(camera, None, ["composed", "mask"])
        self.assertEqual(float(np.abs(still["mask"]).max()), 0)

    def test_twenty_steps_end_when_the_callback_says_so_and_go_on_later(self):
        out, seen = self.place / "stopped", []

        def stop(line):
            seen.append(line["step"])
            return line["step"] < 20

        run = mvfusion.train(LONG, out=out, callback=stop, device="cpu")
        self.assertEqual(seen, list(range(1, 21)))
        self.assertEqual((run.steps, run.is_finished, run.metrics), (20, False, None))
        run = mvfusion.train(resume=out, callback=lambda line: line["step"] < 22, device="cpu", threads=1)
        self.assertEqual(run.steps, 22)

    def test_a_configuration_repeats_the_run_and_the_number_of_threads_does_not_matter(self):
        again = mvfusion.train(self.run_.config, out=self.place / "again", device="cpu", threads=3)
        for name, values in self.run_.gaussians(0.5).items():
            np.testing.assert_array_equal(again.gaussians(0.5)[name], values, name)
        with self.assertRaisesRegex(mvfusion.MvfusionError, "again"):
            mvfusion.train(TINY, out=self.place / "again", device="cpu")

    def test_what_the_callback_raises_ends_the_training_and_is_raised(self):
        out = self.place / "raised"

        def fail(line):
            if line["step"] == 3:
                raise KeyError("of the callback")

        with self.assertRaises(KeyError) as caught:
            mvfusion.train(LONG, out=out, callback=fail, device="cpu")
        self.assertEqual(caught.exception.args, ("of the callback",))
        if sys.version_info >= (3, 11):
            self.assertIn("mvfusion train --resume", caught.exception.__notes__[0])
        self.assertEqual(mvfusion.load(out).steps, 3)

    def test_the_callback_may_render_another_run(self):
        images, view = [], self.run_.views[0]

        def look(line):
            images.append(self.run_.render(view.camera, view.time)["composed"])
            return line["step"] < 2

        mvfusion.train(LONG, out=self.place / "looked", callback=look, device="cpu")
        self.assertEqual(len(images), 2)

    @unittest.skipUnless(os.name == "posix", "signals of POSIX")
    def test_ctrl_c_saves_and_raises_and_other_threads_run_meanwhile(self):
        # A process that was started in the background ignores the signal, and Python then leaves it so.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        self.addCleanup(signal.signal, signal.SIGINT, before)
        out = self.place / "interrupted"

        def interrupt():
            # Without a callback, this thread runs only if the training does not hold the interpreter's lock.
            while not (out / "metrics.jsonl").exists():
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        with self.assertRaises(KeyboardInterrupt):
            mvfusion.train(LONG, out=out, device="cpu")
        thread.join()
        self.assertGreater(mvfusion.load(out).steps, 0)

    def test_renders_of_several_threads_are_those_of_one(self):
        view, found = self.run_.views[0], {}

        def render(number):
            found[number] = self.run_.render(view.camera, view.time, ["composed", "motion"])

        threads = [threading.Thread(target=render, args=(number,)) for number in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for images in found.values():
            np.testing.assert_array_equal(images["composed"], found[0]["composed"])
        self.assertEqual(len(found), 4)

    def test_a_missing_run_is_refused(self):
        nowhere = self.place / "nowhere"
        self.assert_refused([str(nowhere)], lambda: mvfusion.load(nowhere), mvfusion.MvfusionError, 1)
        self.assert_refused(["`tpu`"], lambda: mvfusion.load(self.run_.path, device="tpu"))
        self.assert_refused([str(nowhere)], lambda: mvfusion.load(self.run_.path, data=nowhere),
                            mvfusion.MvfusionError, 1)

    def test_a_configuration_that_cannot_be_is_refused_and_leaves_nothing_behind(self):
        out = self.place / "never"

        def train(config, **more):
            return lambda: mvfusion.train(config, out=out, device="cpu", **more)

        self.assert_refused(["`train.scal`", "`train.scale`"], train({"train": {"scal": 0.5}}))
        self.assert_refused(["`train.scale`", "number"], train({"train.scale": "small"}))
        self.assert_refused(["`train.scale`"], train({"train.scale": 0}))
        self.assert_refused(["`train.scale`", "inf"], train({"train.scale": float("inf")}))
        self.assert_refused([str(10**20)], train({"init.dynamic_points": 10**20}))
        self.assert_refused(["set"], train({"scene.test_cameras": {"cam00"}}))
        self.assert_refused(["`train.scale`", "None"], train({"train.scale": None}))
        self.assert_refused(["`quickstar`", "`quickstart`"], train("quickstar"))
        self.assert_refused(["nowhere.toml"], train(self.place / "nowhere.toml"))
        self.assert_refused(["int"], train({}, callback=3))
        self.assert_refused(["seed", "-1"], train({}, seed=-1))
        self.assert_refused(["threads", "0"], train({}, threads=0))
        self.assert_refused(["out"], train(None, resume=self.run_.path))
        self.assert_refused([str(self.place)], train({}, data=self.place), mvfusion.MvfusionError, 1)
        self.assertFalse(out.exists())

    def test_layers_times_and_branches_that_there_are_not_are_refused(self):
        camera = self.run_.views[0].camera
        self.assert_refused(["`shiny`", "composed"], lambda: self.run_.render(camera, 0.5, ["shiny"]))
        self.assert_refused(["no layer"], lambda: self.run_.render(camera, 0.5, []))
        self.assert_refused(["1.5"], lambda: self.run_.render(camera, 1.5))
        self.assert_refused(["NaN"], lambda: self.run_.gaussians(float("nan")))
        self.assert_refused(["`both`", "scene"], lambda: self.run_.gaussians(0.5, "both"))
        self.assert_refused(["time"], lambda: self.run_.gaussians(branch="scene"))
        self.assert_refused(["tuple"], lambda: self.run_.render((1, 2), 0.5))

    def test_cameras_that_cannot_be_are_refused(self):
        lens, pose, size = [100, 100, 80, 60], np.eye(4), (160, 120)
        skewed = [[100, 1, 80], [0, 100, 60], [0, 0, 1]]
        sheared = np.eye(4)
        sheared[0, 1] = 0.1
        for words, arguments in [
            (["(2, 2)", "(3, 3)"], (np.eye(2), pose, size)),
            (["skew"], (skewed, pose, size)),
            (["(3, 3)", "(4, 4)"], (lens, np.eye(3), size)),
            (["rotation"], (lens, sheared, size)),
            (["rotation"], (lens, np.diag([1, 1, -1, 1]), size)),
            (["rotation"], (lens, np.full((3, 4), np.nan), size)),
            (["last row"], (lens, np.ones((4, 4)), size)),
            (["(160,)"], (lens, pose, (160,))),
            (["160.5"], (lens, pose, (160.5, 120))),
            (["at least one pixel"], (lens, pose, (0, 120))),
            (["16384"], (lens, pose, (100_000, 120))),
            (["focal"], ([0, 100, 80, 60], pose, size)),
            (["no array of numbers"], ("lens", pose, size)),
        ]:
            with self.subTest(words=words):
                self.assert_refused(words, lambda arguments=arguments: mvfusion.Camera(*arguments))

    def test_the_notebook_runs(self):
        try:
            import matplotlib
        except ImportError:
            self.skipTest("matplotlib is not installed")
        matplotlib.use("Agg")
        notebook = json.loads((Path(__file__).parent.parent / "examples" / "one_run.ipynb").read_text())
        cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
        self.assertTrue(cells[0].rstrip().endswith('RUN = "runs/quickstart-0"'), cells[0])
        space = {}
        for number, cell in enumerate(cells):
            # The cell with the run's place is told another one.
            exec(compile(cell, f"cell {number}", "exec"), space)
            if number == 0:
                space["RUN"] = self.run_.path
        self.assertGreaterEqual(len(matplotlib.pyplot.get_fignums()), 3)
        matplotlib.pyplot.close("all")


if __name__ == "__main__":
    unittest.main()
