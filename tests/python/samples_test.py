"""Runs the Python samples as their first lines say, in one process, and the notebook; the first is
run by module_test.py.

  samples_test.py SOURCE_FOLDER RESULT_FOLDER
"""

import contextlib
import io
import os
import pathlib
import runpy
import sys
import unittest

source = pathlib.Path()
result = pathlib.Path()
scratch = pathlib.Path(os.environ["CAMBER_TEST_FOLDER"])


class Samples(unittest.TestCase):
    def run_sample(self, name, *arguments):
        """What it prints."""
        out = io.StringIO()
        path = source / "samples/python" / name
        sys.argv = [str(path), *map(str, arguments)]
        with contextlib.redirect_stdout(out):
            try:
                runpy.run_path(str(path), run_name="__main__")
            except SystemExit as end:
                self.assertIn(end.code, (0, None), out.getvalue())
        return out.getvalue()

    def check_picture(self, path):
        self.assertEqual(path.read_bytes()[:4], b"\x89PNG")
        self.assertGreater(path.stat().st_size, 8000)
        path.unlink()

    def test_clouds(self):
        text = self.run_sample("02_clouds.py", source / "samples/steep_hill/truth/road.ply")
        self.assertRegex(text, r"19\d\d\d of 23000 points on a plane")
        self.assertIn("the same after a round trip: True", text)

    def test_road(self):
        picture = scratch / "03.png"
        text = self.run_sample("03_road.py", result, picture)
        self.assertRegex(text, r"41 of 41 stations, the road climbs 4\.\d m")
        self.check_picture(picture)

    def test_compare(self):
        picture = scratch / "04.png"
        text = self.run_sample("04_compare.py", result,
                               source / "samples/steep_hill/truth/road.ply", picture)
        self.assertRegex(text, r"grade 0-2 deg +\d+ +[+-]0\.00\d\d")
        self.check_picture(picture)

    def test_notebook(self):
        before = os.getcwd()
        try:
            text = self.run_sample("run_notebook.py", source / "samples/python/steep_hill.ipynb")
        finally:
            os.chdir(before)
        self.assertEqual(text, "6 cells ran, 0 of them differ from the notebook\n")


if __name__ == "__main__":
    source, result = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    unittest.main(argv=sys.argv[:1])
