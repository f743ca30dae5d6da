"""Runs the examples of docs/python.md in their order, in a copy of the folder that they name, and
compares what the module gives with what the program wrote of the same input.

  pages_test.py SOURCE_FOLDER PROGRAM
"""

import contextlib
import io
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import numpy

import camber

source = pathlib.Path()
program = ""
scratch = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "pages"


def run_program(*arguments):
    done = subprocess.run([program, *map(str, arguments), "--quiet"], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


class Examples(unittest.TestCase):
    """One run of the page for all tests."""

    @classmethod
    def setUpClass(cls):
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        (scratch / "samples").symlink_to(source / "samples")
        cls.before = os.getcwd()
        os.chdir(scratch)
        text = (source / "docs/python.md").read_text()
        cls.blocks = re.findall(r"```python\n(.*?)```", text, re.S)
        cls.names = {}
        cls.printed = io.StringIO()
        with contextlib.redirect_stdout(cls.printed):
            for block in cls.blocks:
                exec(compile(block, "docs/python.md", "exec"), cls.names)

    @classmethod
    def tearDownClass(cls):
        os.chdir(cls.before)

    def equal_result(self, found, folder):
        cloud = camber.read_cloud(folder / "road.ply")
        for name in ("points", "colors", "sigmas"):
            numpy.testing.assert_array_equal(getattr(found.cloud, name), getattr(cloud, name))
        for name, part in (("surface", found.surface), ("vehicles", found.vehicles)):
            expected = json.loads((folder / f"{name}.json").read_text())
            self.assertEqual(part.to_dict(), expected, name)
        expected = json.loads((folder / "run.json").read_text())
        for key in ("cameras", "scale", "constraints", "points", "options", "warnings", "networks"):
            self.assertEqual(found.run.to_dict().get(key), expected.get(key), key)

    def test_all_blocks_ran(self):
        self.assertGreater(len(self.blocks), 10)
        self.assertIn("nowhere.ply", self.printed.getvalue())

    def test_a_film_gives_the_numbers_of_the_program(self):
        run_program("import", "video", source / "samples/own_drive/drive.mp4", "--calib",
                    source / "samples/own_drive/camera.yaml", "--height", "1.4", "--out", "scene")
        run_program("reconstruct", "scene", "--out", "own", "--no-pictures")
        self.equal_result(self.names["result"], scratch / "own")
        self.assertIsNotNone(self.names["result"].run.to_dict()["networks"])

    def test_pictures_and_files_are_those_of_the_program(self):
        folder = scratch / "out/hill"
        run_program("render", folder, "--size", "800x450", "--out", "hill.png")
        # The same scene from memory: what is drawn is the same.
        picture = camber.render(folder, size=(800, 450))
        camber.render(folder, "again.png", size=(800, 450))
        self.assertEqual(picture.shape, (450, 800, 3))
        self.assertEqual(pathlib.Path("hill.png").read_bytes(),
                         pathlib.Path("again.png").read_bytes())
        for to, name, options in (("opencrg", "hill.crg", ["--encoding", "binary"]),
                                  ("opendrive", "hill.xodr", ["--vehicles"]),
                                  ("mesh", "hill.glb", []),
                                  ("geotiff", "hill.tif", ["--step", "0.5"])):
            run_program("export", folder, "--to", to, "--out", name, *options)
            self.assertEqual(pathlib.Path(name).read_bytes(),
                             (scratch / "out" / name).read_bytes(), name)
        self.assertIn("<html", (scratch / "out/hill.html").read_text()[:200])

    def test_profiles_are_those_of_the_program(self):
        stations = json.loads(run_program("profile", "out/hill", "--step", "5", "--json"))
        found = camber.profile(scratch / "out/hill", step=5.0)
        self.assertEqual([s.height for s in found if s.status != "failed"],
                         [s["height"] for s in stations["stations"] if s["status"] != "failed"])
        grade = self.names["sections"][20].grade
        self.assertAlmostEqual(grade, 0.04, delta=0.001)
        self.assertAlmostEqual(abs(self.names["sections"][20].cross_slope), 0.02, delta=0.001)

    def test_filters_are_those_of_the_program(self):
        points = self.names["points"]
        camber.write_cloud(camber.RoadCloud(points), "points.ply")
        given = camber.read_cloud("points.ply")
        run_program("filter", "points.ply", "--box=10,-5,-10,50,5,10", "--voxel", "0.5",
                    "--normals", "12", "--out", "filtered.ply")
        expected = camber.read_cloud("filtered.ply")
        found = camber.filter(given, box=[10, -5, -10, 50, 5, 10], voxel=0.5, normals=12)
        numpy.testing.assert_array_equal(found.points, expected.points)
        numpy.testing.assert_array_equal(found.normals, expected.normals)
        self.assertLess(len(found), len(points) // 10)
        self.assertEqual(len(camber.filter(given, classes=[])), len(given))
        with self.assertRaisesRegex(ValueError, "returns: found 'odd'"):
            camber.filter(given, returns="odd")

    def test_positions_are_those_of_the_program(self):
        run_program("import", "images", source / "samples/steep_hill/image", "--fov", "80",
                    "--height", "1.65", "--gnss", "out/fixes.csv", "--out", "mapped")
        found, expected = self.names["mapped"], camber.read_scene("mapped")
        self.assertEqual(found.map_crs, "EPSG:32632")
        for a, b in zip(found.frames, expected.frames, strict=True):
            numpy.testing.assert_array_equal(a.map_position.position, b.map_position.position)
            self.assertEqual(a.map_position.sigma, b.map_position.sigma)
        # PROJ's own programs give 500000 and 5427455.7812 for 49 N, 9 E.
        numpy.testing.assert_allclose(found.frames[0].map_position.position,
                                      [500000.0, 5427455.7812, 100.0], atol=1e-3)
        images = ["samples/steep_hill/image"]
        with self.assertRaisesRegex(ValueError, "gnss: expected it beside"):
            camber.import_images(images, "no", fov_deg=80, crs="EPSG:25832")
        for wrong, why in (("EPSG:4326", "expected a projected system"), ("EPSG:1", "EPSG:n")):
            with self.assertRaisesRegex(ValueError, f"crs: found '{wrong}'.*{why}"):
                camber.import_images(images, "no", fov_deg=80, gnss="out/fixes.csv", crs=wrong)
        with self.assertRaisesRegex(camber.UsageError, "crs: a metre of ground is 1.5"):
            camber.import_images(images, "no", fov_deg=80, gnss="out/fixes.csv", crs="EPSG:3857")
        self.assertFalse(pathlib.Path("no").exists())

    def test_tiles_are_those_of_the_program(self):
        run_program("tiles", "plan", "out/survey.laz", "--tile", "30", "--out", "plan")
        run_program("tiles", "run", "plan", "--job", "ground")
        run_program("tiles", "join", "plan", "--job", "ground")
        expected = json.loads(pathlib.Path("plan/ground/index.json").read_text())
        found = json.loads(self.names["joined"]["index"].read_text())
        self.assertEqual([t["hash"] for t in found["tiles"]], [t["hash"] for t in expected["tiles"]])
        # Patches, joined, and what hangs on them; the survey against itself.
        jobs = (("patches", ["--min-points", "30"], {"min_patch_points": 30}),
                ("labels", [], {}),
                ("compare", ["--truth", "plan", "--radius", "1"],
                 {"truth": "out/plan", "radius": 1.0}))
        for job, options, keywords in jobs:
            run_program("tiles", "run", "plan", "--job", job, *options)
            run_program("tiles", "join", "plan", "--job", job)
            self.assertGreater(camber.run_tiles("out/plan", job, **keywords)["points"], 0, job)
            joined = camber.join_tiles(pathlib.Path("out/plan"), job)
            file = "surface.json" if job == "patches" else "index.json"
            a, b = (json.loads(pathlib.Path(plan, job, file).read_text())
                    for plan in ("plan", "out/plan"))
            if job == "patches":
                self.assertEqual(a, b)
                surface = camber.read_surface(joined["surface"])
                self.assertEqual(joined["patches"], len(surface.patches))
                self.assertTrue(pathlib.Path("out/plan/patches/run.json").exists())
            else:
                self.assertEqual([t["hash"] for t in a["tiles"]], [t["hash"] for t in b["tiles"]])
        self.assertEqual(joined["counts"]["compared"], joined["points"])
        with self.assertRaisesRegex(ValueError, "truth: found none"):
            camber.run_tiles("out/plan", "compare", radius=1.0, out="elsewhere")
        with self.assertRaisesRegex(ValueError, "consistency: found 'odd'"):
            camber.join_tiles("out/plan", "patches", consistency="odd")
        again = camber.run_tiles("out/plan", "ground")
        self.assertEqual(again["done_before"], again["tiles"])
        for keywords, why in (({"job": "odd"}, "job: found 'odd'"),
                              ({"job": "voxels"}, "voxel = 0"),
                              ({"job": "ground", "tile": 99}, "tile: found 99"),
                              ({"job": "ground", "shard": (3, 2)}, "shard: found")):
            with self.assertRaisesRegex(ValueError, why):
                camber.run_tiles("out/plan", **keywords)
        with self.assertRaises(camber.NoAnswerError):
            camber.join_tiles("out/plan", "filter", out="nowhere")

    def test_profiles_and_rasters_of_tiles_are_those_of_the_program(self):
        pathlib.Path("line.csv").write_text("5,0,0\n55,0,0\n")
        jobs = (("ground", [], []),
                ("profile", ["--along", "line.csv"], ["--along", "line.csv", "--crown"]),
                ("export", ["--step", "0.5"], ["--cog", "survey.tif"]))
        run_program("tiles", "plan", "out/survey.laz", "--tile", "30", "--out", "measured")
        for job, of_run, of_join in jobs:
            run_program("tiles", "run", "measured", "--job", job, *of_run)
            run_program("tiles", "join", "measured", "--job", job, *of_join)
            a, b = (json.loads(pathlib.Path(plan, job, "index.json").read_text())
                    for plan in ("measured", "out/plan"))
            self.assertEqual([t["hash"] for t in a["tiles"]], [t["hash"] for t in b["tiles"]], job)
        for a, b in (("measured/profile/profile.csv", "out/plan/profile/profile.csv"),
                     ("measured/export/mosaic.vrt", "out/plan/export/mosaic.vrt"),
                     ("survey.tif", "out/survey.tif")):
            self.assertEqual(pathlib.Path(a).read_bytes(), pathlib.Path(b).read_bytes(), b)
        a, b = (json.loads(pathlib.Path(plan, "profile/profile.json").read_text())
                for plan in ("measured", "out/plan"))
        self.assertIsNone(b["along"])
        for document in (a, b):
            del document["file"], document["along"]
        self.assertEqual(a, b)
        measured = self.names["measured"]
        self.assertEqual([s.height for s in measured if s.status != "failed"],
                         [s["height"] for s in b["stations"] if s["status"] != "failed"])
        self.assertAlmostEqual(measured[20].grade, 0.04, delta=0.001)
        # The join of a line that the program ran, of numbers that are no floats.
        pathlib.Path("line.csv").write_text("5.1,0.3,0\n30.7,-0.2,0\n54.9,0.1,0\n")
        run_program("tiles", "run", "measured", "--job", "profile", "--along", "line.csv",
                    "--out", "bent")
        bent = camber.join_tiles("measured", "profile", out="bent",
                                 line=[[5.1, 0.3], [30.7, -0.2], [54.9, 0.1]])
        self.assertGreater(len(bent["stations"]), 40)
        # Heights of the line are of no account; another line, or none, is refused.
        again = camber.run_tiles("out/plan", "profile", line=[[5, 0, 3], [55, 0, 4]])
        self.assertEqual(again["done_before"], again["tiles"])
        for job, keywords, why in (
                ("profile", {}, "line: found none"),
                ("profile", {"line": [[5, 0], [numpy.nan, 0]]}, "line: found a place"),
                ("profile", {"line": [[5], [6]]}, "line: found"),
                ("profile", {"line": [[5, 0], [6, 0]]}, "another"),
                ("profile", {"line": [[5, 0], [55, 0]], "half_width": -1.0}, "half_width"),
                ("export", {"step": 0.5, "ground_from": "odd"}, "ground_from: found 'odd'"),
                ("export", {"step": 0.5, "crs": "odd"}, "crs: found 'odd'"),
                ("export", {"step": 1.0}, "another value of 'step'")):
            with self.assertRaisesRegex(ValueError, why):
                camber.run_tiles("out/plan", job, **keywords)
        with self.assertRaisesRegex(camber.NoAnswerError, "does not leave"):
            camber.run_tiles("out/plan", "profile", line=[[5, 0], [5, 0]])
        with self.assertRaisesRegex(camber.UsageError, "another line"):
            camber.join_tiles("out/plan", "profile", line=[[5, 0], [6, 0]])
        with self.assertRaisesRegex(ValueError, "cog: found job 'ground'"):
            camber.join_tiles("out/plan", "ground", cog="no.tif")
        with self.assertRaises(camber.OutputError):
            camber.join_tiles("out/plan", "export", cog="nowhere/no.tif")

    def test_a_drive_is_that_of_the_program(self):
        run_program("drive", source / "samples/steep_hill", "--no-pictures", "--out", "drive")
        for name in ("drive.json", "vehicles.json", "tracks.json", "poses.txt"):
            self.assertEqual((scratch / "drive" / name).read_bytes(),
                             (scratch / "out/drive" / name).read_bytes(), name)

    def test_a_scene_may_be_segmented_in_memory(self):
        with self.assertRaisesRegex(ValueError, "expected detector, segmenter or keypoints"):
            camber.detect(self.names["scene"])
        with self.assertRaisesRegex(ValueError, "images in memory"):
            camber.detect(self.names["held"], detector="shipped", out="nowhere")
        self.assertFalse(pathlib.Path("nowhere").exists())
        seen = camber.detect(self.names["held"], detector="shipped", cache="")
        self.assertEqual(len(seen), len(self.names["held"]))
        written = camber.detect(self.names["film"], out=scratch / "detected", keypoints="shipped")
        self.assertEqual(len(camber.read_scene(scratch / "detected")), len(written))


if __name__ == "__main__":
    source, program = pathlib.Path(sys.argv[1]).resolve(), str(pathlib.Path(sys.argv[2]).resolve())
    unittest.main(argv=sys.argv[:1])
