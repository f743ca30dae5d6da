"""The Python module: the main job from arrays against the program's result, clouds, errors.

  module_test.py SOURCE_FOLDER RESULT_FOLDER, where the latter is what the program made of
  samples/steep_hill; PYTHONPATH has the module.
"""

import contextlib
import gc
import importlib.util
import io
import json
import os
import pathlib
import signal
import sys
import threading
import time
import unittest
from unittest import mock

import numpy

import camber

source = pathlib.Path()
program_result = pathlib.Path()


def sample(name):
    """A sample script as a module."""
    spec = importlib.util.spec_from_file_location(name, source / "samples/python" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def small_scene(count=3, **keywords):
    """Images of noise: good for whatever ends before a result."""
    random = numpy.random.default_rng(3)
    camera = camber.PinholeCamera(160, 90, fx=120.0, fy=120.0, cx=80.0, cy=40.0)
    images = [random.integers(0, 255, (90, 160, 3), numpy.uint8) for _ in range(count)]
    return camber.Scene(camera, images, **keywords)


class MainJob(unittest.TestCase):
    """One run for all tests: that of the first sample, from arrays."""

    @classmethod
    def setUpClass(cls):
        cls.stages, cls.ticks = [], 0
        reconstruct = camber.reconstruct
        done = threading.Event()

        def tick():
            while not done.wait(0.005):
                cls.ticks += 1

        def watched(scene, progress):
            thread = threading.Thread(target=tick)
            thread.start()
            cls.scene = scene
            cls.result = reconstruct(
                scene, progress=lambda stage, share: cls.stages.append((stage, share)))
            done.set()
            thread.join()
            return cls.result

        cls.picture = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "01.png"
        program = sample("01_reconstruct")
        out = io.StringIO()
        arguments = [program.__file__, str(source / "samples/steep_hill"), str(cls.picture)]
        with (contextlib.redirect_stdout(out), mock.patch.object(camber, "reconstruct", watched),
              mock.patch.object(sys, "argv", arguments)):
            program.main()
        cls.printed = out.getvalue()

    def test_the_sample_prints_and_draws(self):
        self.assertRegex(self.printed, r"Reconstruction \d+ road points, \d+ patches, 13 vehicles")
        self.assertRegex(self.printed, r"20 m ahead the road is 0\.[89]\d \+- 0\.0\d m below")
        self.assertEqual(self.picture.read_bytes()[:4], b"\x89PNG")
        self.assertGreater(self.picture.stat().st_size, 100000)

    def test_numbers_are_those_of_the_program(self):
        cloud = camber.read_cloud(program_result / "road.ply")
        for name in ("points", "colors", "sigmas"):
            numpy.testing.assert_array_equal(getattr(self.result.cloud, name), getattr(cloud, name))
        numpy.testing.assert_array_equal(self.result.cloud.labels["patch"], cloud.labels["patch"])
        for name, found in (("surface", self.result.surface), ("vehicles", self.result.vehicles)):
            expected = json.loads((program_result / f"{name}.json").read_text())
            self.assertEqual(found.to_dict(), expected, name)
        expected = json.loads((program_result / "run.json").read_text())
        found = self.result.run.to_dict()
        for key in ("cameras", "scale", "constraints", "points", "options", "warnings"):
            self.assertEqual(found[key], expected[key], key)
        self.assertEqual(self.result.run.input_hashes[0][0], "frame 0: image")

    def test_fields_are_those_of_cpp(self):
        result = self.result
        self.assertEqual((result.frame_ids, result.reference_frame), ([0, 1, 2], 1))
        vehicle = result.vehicles.frames[0].vehicles[0]
        self.assertEqual((vehicle.status, vehicle.vehicle_class), ("ok", "car"))
        self.assertEqual(vehicle.keypoints.shape, (36, 3))
        self.assertEqual(vehicle.covariance.shape, (9, 9))
        pose = vehicle.pose.camera_from_vehicle
        numpy.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, numpy.eye(3), atol=1e-12)
        numpy.testing.assert_array_equal(pose[:3, 3], vehicle.pose.bottom_center)
        corners = vehicle.pose.corners()
        numpy.testing.assert_allclose(corners.mean(axis=0), vehicle.pose.center, atol=1e-9)
        numpy.testing.assert_array_equal(result.run.cameras[1], numpy.eye(4))
        query = result.surface.query([0, 0, 15])
        self.assertLess(query.sigma_height, 0.2)
        self.assertIsNone(result.surface.find(-7))
        self.assertEqual(result.surface.find(query.patch).id, query.patch)
        self.assertIsNone(result.road_mask)
        self.assertEqual(result.surface.query([0, 0, -500]).status, "failed")

    def test_progress_is_reported_and_other_threads_run(self):
        shares = [share for _, share in self.stages]
        self.assertEqual(shares, sorted(shares))
        self.assertEqual(shares[-1], 1.0)
        self.assertIn("motion", [stage for stage, _ in self.stages])
        self.assertGreater(self.ticks, 20)  # a run takes a second; held, the lock leaves none

    def test_images_and_clouds_are_views_that_keep_their_owner(self):
        image = self.result.images[0]
        self.assertEqual((image.shape, image.dtype), ((375, 1242, 3), numpy.uint8))
        self.assertIs(image.base, self.result)
        points = self.result.cloud.points
        numpy.testing.assert_array_equal(points, self.result.cloud.points)
        self.assertTrue(numpy.shares_memory(points, self.result.cloud.points))
        cloud = camber.RoadCloud(numpy.arange(12, dtype=numpy.float32).reshape(4, 3))
        kept = cloud.points
        del cloud
        gc.collect()
        self.assertEqual(kept[3, 2], 11)

    def test_a_folder_is_written(self):
        folder = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "written"
        self.result.write(folder, pictures=False)
        for name in ("road.ply", "surface.json", "vehicles.json"):
            self.assertEqual((folder / name).read_bytes(), (program_result / name).read_bytes())
        found = camber.read_surface(folder / "surface.json")
        self.assertEqual(len(found.patches), len(self.result.surface.patches))
        self.assertEqual(camber.read_run(folder / "run.json").scene, "")
        self.assertEqual(camber.read_vehicles(folder / "vehicles.json").method, "joint")

    def test_every_repr_says_something(self):
        result = self.result
        vehicle = result.vehicles.frames[0].vehicles[0]
        for value in (self.scene, self.scene.camera, self.scene.frames[0],
                      self.scene.frames[0].vehicles[0], result, result.cloud, result.surface,
                      result.surface.patches[0], result.surface.links[0], result.run,
                      result.run.constraints[0], result.vehicles, result.vehicles.frames[0],
                      vehicle, vehicle.pose, vehicle.plane, vehicle.box,
                      result.surface.patches[0].plane):
            self.assertRegex(repr(value), rf"^<camber\.{type(value).__name__} .*\d.*>$")


class Runs(unittest.TestCase):
    def test_an_exception_of_the_callback_ends_the_run(self):
        def stop(stage, share):
            raise LookupError(stage)

        with self.assertRaisesRegex(LookupError, "load"):
            camber.reconstruct(small_scene(), [0, 1], detector="none", progress=stop)

    def test_ctrl_c_is_a_keyboard_interrupt_and_the_next_run_is_whole(self):
        scene = camber.read_scene(source / "samples/steep_hill")
        before = signal.getsignal(signal.SIGINT)
        timer = threading.Timer(0.15, lambda: os.kill(os.getpid(), signal.SIGINT))
        started = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            timer.start()
            for _ in range(20):  # one run may be over before
                camber.reconstruct(scene, [0, 1, 2])
        self.assertLess(time.monotonic() - started, 10)
        timer.join()
        self.assertIs(signal.getsignal(signal.SIGINT), before)
        points = numpy.random.default_rng(1).normal(0, [5, 5, 0.01], (5000, 3))
        self.assertEqual(camber.fit_plane(points).status, "ok")

    def test_images_may_be_functions(self):
        asked = []
        scene = camber.Scene(camber.PinholeCamera(64, 48, 60, 60, 32, 24))
        for k in range(2):
            scene.add_frame(lambda k=k: asked.append(k) or numpy.full((48, 64), 9, numpy.uint8))
        with self.assertRaisesRegex(camber.NoAnswerError, "have the same image"):
            camber.reconstruct(scene, [0, 1])
        self.assertEqual(asked, [0, 1])

        def broken():
            raise OSError("the camera is unplugged")

        scene.add_frame(broken)
        with self.assertRaisesRegex(OSError, "unplugged"):
            camber.reconstruct(scene, [0, 2])


class Errors(unittest.TestCase):
    def test_have_pythons_classes_and_the_programs_exit_codes(self):
        with self.assertRaisesRegex(ValueError, "nowhere.ply") as caught:
            camber.read_cloud("nowhere.ply")
        self.assertIsInstance(caught.exception, camber.InputError)
        self.assertEqual(caught.exception.exit_code, 2)
        with self.assertRaises(RuntimeError) as caught:
            camber.reconstruct(small_scene(1), [0])
        self.assertIsInstance(caught.exception, camber.NoAnswerError)
        self.assertEqual(caught.exception.exit_code, 1)
        with self.assertRaises(OSError) as caught:
            camber.write_cloud(camber.RoadCloud(numpy.zeros((1, 3))), "/nowhere/at/all.ply")
        self.assertIsInstance(caught.exception, camber.OutputError)
        self.assertTrue(issubclass(camber.OutputError, camber.Error))

    def refused(self, pattern, function, *arguments, **keywords):
        with self.assertRaisesRegex(ValueError, pattern):
            function(*arguments, **keywords)

    def test_name_what_was_found_and_what_was_expected(self):
        camera = camber.PinholeCamera(64, 48, 60, 60, 32, 24)
        cloud = camber.RoadCloud(numpy.zeros((4, 3)))
        self.refused("width", camber.PinholeCamera, 0, 48, 60, 60, 32, 24)
        self.refused("float64 of 48 x 64 x 3, expected uint8", camber.reconstruct,
                     camber.Scene(camera, [numpy.zeros((48, 64, 3))] * 2), [0, 1])
        self.refused("image of frame 0: found 64 x 47 pixels", camber.reconstruct,
                     camber.Scene(camera, [numpy.zeros((47, 64, 3), numpy.uint8)] * 2), [0, 1])
        self.refused("image of frame 0: found str", camber.reconstruct,
                     camber.Scene(camera, ["image.png"] * 2), [0, 1])
        self.refused("method", camber.reconstruct, small_scene(), method="best")
        self.refused("no frame 9", camber.reconstruct, small_scene(), [0, 9])
        self.refused("cloud: found float64 of 4 x 2, expected numbers of N x 3", camber.fit_plane,
                     numpy.zeros((4, 2)))
        self.refused("max_tilt", camber.fit_plane, cloud, max_tilt=7)
        self.refused("sigmas: expected 4 numbers", camber.RoadCloud, numpy.zeros((4, 3)),
                     sigmas=[1, 2])
        self.refused("colors: expected uint8", camber.RoadCloud, numpy.zeros((4, 3)),
                     colors=numpy.zeros((4, 3)))
        self.refused("whole numbers", cloud.set_label, "patch", [0.5] * 4)
        self.assertEqual(cloud.labels, {})
        self.refused("frame: found 'up'", camber.RoadCloud, numpy.zeros((4, 3)), frame="up")
        self.refused("align: found 'icp'", camber.compare, cloud, cloud, align="icp")
        self.refused("found the point 4 in row 0, expected 0 to 3", camber.compare, cloud, cloud,
                     truth_triangles=[[0, 1, 4]])
        self.refused("keypoints: expected 36 x 3", camber.VehicleDetection, [0, 0, 9, 9],
                     keypoints=[[1, 2, 3]])
        self.refused("expected x1 < x2", camber.VehicleDetection, [9, 0, 0, 9])
        scene = small_scene()
        self.refused("id: found 1, expected more than 2", scene.add_frame, id=1)
        self.refused("world_from_camera", scene.add_frame, world_from_camera=numpy.zeros((4, 4)))

    def test_scenes_hold_what_a_manifest_may(self):
        camera = camber.PinholeCamera(160, 90, fx=120.0, fy=120.0, cx=80.0, cy=40.0)
        for pattern, keywords in [
            ("markings_m: found \"dash_lenght\", expected dash_length", {"markings_m": {"dash_lenght": 3.0}}),
            ("dash_length: found -3, expected a positive", {"markings_m": {"dash_length": -3.0}}),
            ("segmentation_classes: found 300", {"segmentation_classes": {"road": [300]}}),
            ("segmentation_classes: found 1 under", {"segmentation_classes": {"road": [1], "vehicle": [1]}}),
            ("lens: found 'none' beside distortion", {"distortion": [-0.3, 0.1, 0, 0]}),
            ("lens: found 'none' beside", {"raw_camera": camera}),
            ("height_above_road", {"height_above_road": -1.0}),
        ]:
            self.refused(pattern, camber.Scene, camera, **keywords)
        self.refused("reference_frame: found 7", camber.reconstruct, small_scene(reference_frame=7),
                     [0, 1])

        def box(**keywords):
            return camber.VehicleDetection([0, 0, 9, 9], **keywords)

        mirror = numpy.diag([1.0, 1.0, -1.0, 1.0])
        stretched = numpy.eye(4)
        stretched[3, 0] = 1.0
        for pattern, keywords in [
            ("up points down", {"up": [0, 1, 0]}),
            ("up points forward", {"up": [0, -0.1, 1]}),
            ("up_sigma: found -1", {"up": [0, -1, 0], "up_sigma": -1.0}),
            ("up_sigma: found nan", {"up": [0, -1, 0], "up_sigma": numpy.nan}),
            ("up_sigma: found without up", {"up_sigma": 0.1}),
            ("speed_sigma: found without speed", {"speed_sigma": 0.1}),
            ("speed: found inf", {"speed": numpy.inf}),
            ("time_s", {"time_s": numpy.nan}),
            ("world_from_camera", {"world_from_camera": mirror}),
            ("world_from_camera", {"world_from_camera": stretched}),
            ("ego_plane", {"ego_plane": camber.Plane([0, 1, 0], 1.5)}),
            ("id: found 4 a second time", {"vehicles": [box(id=4), box(id=4)]}),
            ("vehicle 0: score", {"vehicles": [box(score=numpy.nan)]}),
            ("vehicle 0: keypoints", {"vehicles": [box(keypoints=numpy.full((36, 3), numpy.inf))]}),
        ]:
            scene = small_scene()
            self.refused(pattern, scene.add_frame, **keywords)
            self.assertEqual(len(scene), 3)
        self.refused("id: found -3", box, id=-3)
        self.refused("id: found -5", camber.Scene(camera).add_frame, id=-5)
        self.refused("offset", camber.Plane, [0, -1, 0], numpy.nan)
        # Those without an id get one that is free.
        scene.add_frame(vehicles=[box(id=1), box(), box(id=0), box()])
        self.assertEqual([v.id for v in scene.frames[-1].vehicles], [1, 2, 0, 3])
        with self.assertWarnsRegex(UserWarning, "no 'road' is named"):
            scene.add_frame(segmentation=numpy.zeros((90, 160), numpy.uint8))


class Clouds(unittest.TestCase):
    def setUp(self):
        self.random = numpy.random.default_rng(1)
        self.road = self.random.uniform([0, -4, 0], [40, 4, 0], (20000, 3))
        self.road[:, 2] += 0.08 * numpy.maximum(0, self.road[:, 0] - 20)
        self.road += self.random.normal(0, [0, 0, 0.01], self.road.shape)

    def test_parts_of_a_file(self):
        path = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "parts.ply"
        camber.write_cloud(camber.RoadCloud(self.road.astype(numpy.float32)), path)
        inside = camber.read_cloud(path, bounds=[10, -2, 20, 2]).true_points()
        expected = [10 <= x < 20 and -2 <= y < 2 for x, y, _ in self.road.astype(numpy.float32)]
        self.assertEqual(len(inside), sum(expected))
        with self.assertRaises(ValueError):
            camber.read_cloud(path, bounds=[10, -2, 10, 2])
        with self.assertRaises(ValueError):
            camber.read_cloud(path, bounds=[10, -2, 20])

    def test_attributes_of_every_kind_go_there_and_back(self):
        given = {"colors": self.random.integers(0, 255, (50, 3), numpy.uint8),
                 "sigmas": self.random.uniform(0, 1, 50).astype(numpy.float32),
                 "covariances": self.random.uniform(0, 1, (50, 6)).astype(numpy.float32),
                 "normals": self.random.uniform(0, 1, (50, 3)).astype(numpy.float32)}
        points = self.random.normal(0, 1, (50, 3)).astype(numpy.float32)
        cloud = camber.RoadCloud(points, **given, labels={"patch": numpy.arange(50)},
                                 scalars={"intensity": numpy.ones(50)}, frame="camera",
                                 metric=False)
        path = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "all.ply"
        camber.write_cloud(cloud, path)
        for found in (cloud, camber.read_cloud(path), cloud.select(list(range(50)))):
            numpy.testing.assert_array_equal(found.points, points)
            for name, value in given.items():
                numpy.testing.assert_array_equal(getattr(found, name), value, name)
            numpy.testing.assert_array_equal(found.labels["patch"], numpy.arange(50))
            numpy.testing.assert_array_equal(found.scalars["intensity"], numpy.ones(50))
            self.assertEqual((found.frame, found.metric), ("camera", False))
        numpy.testing.assert_array_equal(cloud.default_up, [0, -1, 0])
        cloud.points[7] = [1, 2, 3]
        cloud.points *= 2
        numpy.testing.assert_array_equal(cloud.points[7], [2, 4, 6])

    def test_coordinate_systems_go_there_and_back(self):
        folder = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"])
        text = folder / "map.csv"
        text.write_text('# camber crs PROJCS["mine",UNIT["metre",1],AUTHORITY["EPSG","32632"]]\n'
                        "x,y,z\n456000.5,5428000,100\n456001,5428001,101\n")
        crs = camber.read_coordinate_system(text)
        self.assertEqual((crs.name, crs.epsg, crs.kind), ("mine", 32632, "projected"))
        self.assertEqual((crs.horizontal.name, crs.horizontal.metres), ("metre", 1.0))
        self.assertTrue(crs.metric)
        self.assertIn("32632", repr(crs))
        cloud = camber.read_cloud(text)
        for name in ("map.las", "map.ply", "map.pcd"):
            camber.write_cloud(cloud, folder / name, crs=crs)
            self.assertEqual(camber.read_coordinate_system(folder / name).epsg, 32632, name)
            numpy.testing.assert_array_equal(camber.read_cloud(folder / name).true_points(),
                                             cloud.true_points())
            camber.write_cloud(cloud, folder / name)
            self.assertIsNone(camber.read_coordinate_system(folder / name), name)

    def test_labels_that_do_not_fit_are_refused(self):
        cloud = camber.RoadCloud(numpy.zeros((2, 3)))
        for value in (2**40, -2**31 - 1):
            with self.assertRaisesRegex(ValueError, "patch: found numbers from"):
                cloud.set_label("patch", numpy.array([0, value]))
        with self.assertRaisesRegex(ValueError, "4294967295, expected -2147483648 to 2147483647"):
            camber.RoadCloud(numpy.zeros((2, 3)),
                             labels={"patch": numpy.array([0, 2**32 - 1], numpy.uint32)})
        cloud.set_label("patch", numpy.array([-2**31, 2**31 - 1]))
        self.assertEqual(cloud.labels["patch"].tolist(), [-2**31, 2**31 - 1])

    def test_points_are_selected_by_index_or_mask(self):
        cloud = camber.RoadCloud(self.road)
        mask = self.road[:, 0] < 3
        chosen = cloud.select(mask)
        self.assertEqual(len(chosen), mask.sum())
        numpy.testing.assert_array_equal(chosen.points, cloud.points[mask])
        numpy.testing.assert_array_equal(cloud.select(numpy.flatnonzero(mask)).points,
                                         chosen.points)
        numpy.testing.assert_array_equal(cloud.select([5, 3]).points, cloud.points[[5, 3]])
        self.assertEqual(len(cloud.select([])), 0)
        for wrong in (mask[1:], [0.5], [[0, 1]], "all", None):
            with self.assertRaisesRegex(ValueError, "indices: expected whole numbers, or a mask"):
                cloud.select(wrong)
        for outside in ([-1], [len(cloud)], [2**40]):
            with self.assertRaisesRegex(ValueError, "point index"):
                cloud.select(outside)

    def test_a_profile_knows_how_well_the_surface_is_levelled(self):
        fit = camber.fit_road_surface(self.road, driven_line=[[0, 0, 0], [40, 0, 0]])
        surface = fit.surface.to_dict()
        surface["level_sigma_deg"] = 1.0
        path = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"]) / "levelled.json"
        path.write_text(json.dumps(surface))
        levelled = camber.read_surface(path)
        self.assertAlmostEqual(levelled.level_sigma, numpy.radians(1.0))

        def sigmas(surface, **keywords):
            return [p.sigma_grade for p in camber.road_profile(surface, **keywords)]

        # Left out: what the surface states; else what is given.
        numpy.testing.assert_array_equal(
            sigmas(levelled), sigmas(fit.surface, levelling_sigma=levelled.level_sigma))
        numpy.testing.assert_array_equal(
            sigmas(levelled, levelling_sigma=1.7453292519943296e-4), sigmas(fit.surface))
        self.assertGreater(numpy.nanmin(sigmas(levelled)), numpy.radians(0.9))

    def test_map_coordinates_keep_their_digits(self):
        place = [691000.123, 5336000.456, 520.789]
        cloud = camber.RoadCloud(self.road + place)
        self.assertGreater(cloud.origin[1], 5e6)
        numpy.testing.assert_allclose(cloud.true_points(), self.road + place, atol=1e-5)
        strided = numpy.repeat(self.road, 2, axis=0)[::2]
        numpy.testing.assert_array_equal(camber.RoadCloud(strided).points,
                                         camber.RoadCloud(self.road).points)

    def test_planes_patches_ground_and_profile(self):
        fit = camber.fit_plane(self.road[self.road[:, 0] < 20], up=[0, 0, 1])
        self.assertLess(abs(fit.plane.plane.normal[2] - 1), 1e-6)
        self.assertAlmostEqual(fit.rmse, 0.01, delta=0.001)
        self.assertEqual(fit.inliers.dtype, numpy.int32)
        surface = camber.fit_road_surface(self.road)
        grades = sorted(patch.grade for patch in surface.surface.patches)
        self.assertAlmostEqual(grades[0], 0.0, delta=0.002)
        self.assertAlmostEqual(grades[-1], numpy.arctan(0.08), delta=0.002)
        self.assertEqual(len(surface.labels), 20000)
        profile = camber.road_profile(surface.surface, [[1, 0, 0], [39, 0, 0]])
        self.assertAlmostEqual(profile[-1].height - profile[0].height, 0.08 * 19, delta=0.02)
        box = self.random.uniform([5, -1, 0.3], [9, 1, 1.5], (2000, 3))
        ground = camber.segment_ground(numpy.vstack([self.road, box]), largest_object=6)
        self.assertGreater(ground.labels[:20000].mean(), 0.95)
        self.assertLess(ground.labels[20000:].mean(), 0.05)
        self.assertEqual(camber.fit_plane(numpy.zeros((2, 3))).status, "failed")

    def test_a_comparison_in_a_cameras_frame_looks_along_its_axis(self):
        # The estimate lies 0.05 m ahead of a ramp's truth: an error of height, not across the road.
        ahead = numpy.array([0.0, 0.0, 0.05])
        places = self.random.uniform([-4, 0, 5], [4, 0, 45], (20000, 3))
        places[:, 1] = 1.65 - 0.1 * places[:, 2]
        truth = camber.RoadCloud(places, frame="camera")
        estimate = camber.RoadCloud(places + ahead, frame="camera")
        plain = camber.compare(estimate, truth)
        stated = camber.compare(estimate, truth, along=[0, 0, 1], viewpoint=[0, 0, 0])
        self.assertEqual(plain.to_dict(), stated.to_dict())
        self.assertIn("distance", [errors.by for errors in plain.road])

    def test_a_comparison_up_to_scale_is_not_in_metres(self):
        metric, unscaled = camber.RoadCloud(self.road), camber.RoadCloud(self.road, metric=False)
        comparison = camber.compare(unscaled, metric)
        self.assertFalse(comparison.metric)
        self.assertIs(comparison.to_dict()["metric"], False)
        self.assertIn("up to scale", str(comparison))
        self.assertNotIn("metres", str(comparison))
        self.assertIn("up to scale", repr(comparison))
        self.assertTrue(camber.compare(unscaled, metric, align="scale").metric)

    def test_comparison(self):
        moved = self.road + [0, 0, 0.05]
        found = camber.compare(moved, self.road, thresholds=[0.2])
        self.assertAlmostEqual(found.road[0].height_mean, 0.05, delta=0.003)
        self.assertEqual(found.scores[0].f_score, 1.0)
        self.assertEqual(found.accuracy.distance.shape, (20000,))
        corners = [[0, -4, 0], [40, -4, 0], [40, 4, 0], [0, 4, 0]]
        flat = self.road * [1, 1, 0] + [0, 0, 0.05]
        mesh = camber.compare(flat, numpy.array(corners, float),
                              truth_triangles=[[0, 1, 2], [0, 2, 3]], mesh_density=25.0)
        self.assertAlmostEqual(mesh.accuracy.summary.median, 0.05, delta=1e-6)
        self.assertEqual(found.to_dict()["accuracy"]["count"], 20000)


if __name__ == "__main__":
    source, program_result = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    unittest.main(argv=sys.argv[:1])
