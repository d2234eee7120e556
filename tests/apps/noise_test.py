"""The noise of a camera: palpate calibrate --noise, and --sensor SENSOR.toml.

Usage: noise_test.py PATH_OF_PALPATE"""

import json
import math
import re
import unittest

try:
    import numpy
except ImportError:
    numpy = None

from camera_case import HEIGHT, INTRINSICS, WIDTH, CameraCase, palpate


@unittest.skipIf(numpy is None, "needs numpy (scripts/setup.sh --test)")
class Noise(CameraCase):
    def noisy(self, name, num=40, noise=(0.0006, 0.002), length=2, unit=0.0005, moves=0.0, seed=1):
        """A file of frames of a slope from 0.3 to 0.5 m, each pixel with a share of its neighbor's
        noise: correlations fall by exp(-1 / length) a pixel."""
        random, path = numpy.random.default_rng(seed), self.folder / name
        share = math.exp(-1 / length)
        rest = math.sqrt(1 - share * share)
        slope = numpy.linspace(0.3, 0.5, HEIGHT)[:, None] + numpy.zeros((HEIGHT, WIDTH))
        frames = b""
        for k in range(num):
            field = random.standard_normal((HEIGHT, WIDTH))
            for u in range(1, WIDTH):
                field[:, u] = share * field[:, u - 1] + rest * field[:, u]
            for v in range(1, HEIGHT):
                field[v] = share * field[v - 1] + rest * field[v]
            z = slope + moves * math.sin(0.4 * k)
            z = z + (noise[0] + noise[1] * z * z) * field
            frames += numpy.rint(z / unit).astype("<u2").tobytes()
        path.write_bytes(frames)
        return f"pipe:{path}?size=160x120&intrinsics={INTRINSICS}&unit={unit}"

    def test_noise_is_measured_and_used(self):
        camera, sensor = self.noisy("rest.raw"), self.folder / "camera.toml"
        told = json.loads(self.check(palpate("calibrate", "--noise", camera, "--noise",
                                             self.noisy("again.raw", seed=2), "-o", sensor,
                                             "--json")).stdout)
        for at in told["by_depth"]:
            self.assertAlmostEqual(at["deviation_mm"], 0.6 + 2 * at["depth"] ** 2, delta=0.08)
        self.assertAlmostEqual(told["noise_length"], 2, delta=0.3)
        run = self.folder / "noise_run"
        self.check(palpate("touch", self.tool, "--camera", camera, "--path", self.path, "--sensor",
                           sensor, "-o", run))
        average = self.summary(run)["settings"]["time"]
        self.assertAlmostEqual(average["average_noise_patch"], 2 * math.pi * told["noise_length"] ** 2,
                               delta=0.01)
        self.assertAlmostEqual(1e3 * average["average_noise"], told["noise_mm"], delta=1e-6)
        self.check(palpate("replay", run))
        self.check(palpate("query", self.tool, "--camera", camera, "--sensor", sensor, "--pose",
                           "0 0 0.4 0 0 0 1"))

    def test_noise_refuses_bad_input(self):
        def refuses(words, *arguments, status=1):
            file = self.folder / "never.toml"
            self.refused(words, "calibrate", *arguments, "-o", file, status=status)
            self.assertFalse(file.exists())

        rest, sensor = self.noisy("still.raw"), self.folder / "still.toml"
        refuses("of the image moves; let camera and scene rest", "--noise",
                self.noisy("moves.raw", moves=0.05))
        refuses("has 19 frames; noise needs at least 20", "--noise", self.noisy("brief.raw", num=19))
        refuses("measure one camera in one mode", "--noise", rest, "--noise",
                rest.replace("0.0005", "0.001"))
        refuses("measure one camera in one mode", "--noise", rest, "--noise", rest + "&sensor=tof")
        refuses("measure one camera in one mode", "--noise", rest, "--noise",
                rest.replace("160x120", "120x160"))
        refuses("give one of --rig and --noise", status=2)
        self.check(palpate("calibrate", "--noise", rest, "-o", sensor))
        text = sensor.read_text()

        def unusable(words, text, camera=rest, status=2):
            file = self.folder / "unusable.toml"
            file.write_text(text)
            for verb in (["touch", self.tool, "--path", self.path, "-o", self.folder / "never"],
                         ["query", self.tool, "--pose", "0 0 0.4 0 0 0 1"]):
                self.refused(words, *verb, "--camera", camera, "--sensor", file, status=status)

        growth = re.search("noise_growth = .*", text).group()
        unusable("noise_growth must be a number from 0 to 1 m", text.replace(growth, "noise_growth = nan"))
        unusable("has no sensor.noise_growth; measure it again", text.replace(growth, ""))
        unusable("[sensor] has no key 'gain'", text + "gain = 1.0\n")
        unusable("was measured at 160 x 120 pixels of 0.0005 m, and the images are 120 x 160",
                 text, rest.replace("160x120", "120x160"), status=1)
        unusable("the images are 160 x 120 of 0.001 m", text, rest.replace("0.0005", "0.001"),
                 status=1)
        self.refused("was measured with a camera of kind none", "touch", self.tool, "--camera",
                     rest + "&sensor=tof", "--sensor", sensor, "-o", self.folder / "never", status=2)
        self.refused("--sensor must be none, structured_light", "touch", self.tool, "--camera", rest,
                     "--sensor", "laser", "-o", self.folder / "never", status=2)


if __name__ == "__main__":
    unittest.main()
