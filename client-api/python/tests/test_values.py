"""Numbers, pictures and JSON, without any manager."""

from __future__ import annotations

import math
import struct
import unittest
import zlib
from typing import Any

from manager_double import STATUS

import polyptych
from polyptych import bearer, vectors
from polyptych.feedback import WallStatus
from polyptych.records import Mismatch, decode, encode
from polyptych.requests import brings_files


class Proofs(unittest.TestCase):
    """BLAKE3, against values of its reference implementation."""

    def test_bearers_and_proofs(self) -> None:
        self.assertEqual(
            bearer.bearer("0123456789abcdef"),
            "693ec2dea9a16d02440e20eb8aad0ca9e04938e5da47e4e6d7e61e862baae5ee",
        )
        self.assertEqual(
            bearer.manager_proof("0123456789abcdef", "m" * 32, "c" * 32),
            "1ac4506ad57ed1e679362d3a4db7e46bd1371f6ff94fe190fdb5840bd778c400",
        )
        self.assertNotEqual(bearer.bearer("x" * 64), bearer.bearer("x" * 65))
        with self.assertRaises(ValueError):
            bearer.bearer("x" * 1025)


class Cameras(unittest.TestCase):
    """Cameras stand where they are put, and look where they are told to."""

    def near(self, one: Any, other: Any) -> None:
        for a, b in zip(one, other):
            self.assertAlmostEqual(a, b, places=12)

    def test_a_camera_looks_at_its_target_from_everywhere(self) -> None:
        for position in ((3.0, 1.0, 4.0), (-2.0, 0.0, 0.0), (0.0, 5.0, 0.1), (0.0, -1.0, 0.0)):
            camera = polyptych.Camera.look_at(position, (0.5, 0.25, 0.0))
            ahead = vectors.rotated(camera.rotation, (0.0, 0.0, -1.0))
            way = vectors.normalized(vectors.subtract((0.5, 0.25, 0.0), position))
            self.near(ahead, way)
            up = vectors.rotated(camera.rotation, (0.0, 1.0, 0.0))
            self.assertGreaterEqual(up[1], 0.0, "upright")
            self.assertAlmostEqual(vectors.length(up), 1.0)
        for target in ((0.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, -9.0, 0.0)):
            rotation = polyptych.Camera.look_at((0, 0, 0), target).rotation
            self.assertAlmostEqual(sum(part * part for part in rotation), 1.0)

    def test_moves_keep_what_they_must(self) -> None:
        eye = (0.3, 1.6, 0.8)
        camera = polyptych.Camera.look_at((10, 2, -5), (3, 1, 4)).with_scale(2.5)
        self.near(
            camera.panned(eye, (0, 1, 0), 0.6).world_from_display(eye),
            camera.world_from_display(eye),
        )
        round_trip = camera.turned_around((1, 2, 3), (0, 7, 0), math.tau)
        self.near(round_trip.position, camera.position)
        self.near(camera.with_eye_at(eye, (4, 5, 6)).world_from_display(eye), (4, 5, 6))
        self.near(camera.towards(eye, (7, 7, 7), 1.0).world_from_display(eye), (7, 7, 7))
        self.near(camera.moved_by((1, 2, 3)).moved_by((-1, -2, -3)).position, camera.position)
        self.assertEqual(camera.turned_around((1, 2, 3), (0, 0, 0), 1.0), camera)

    def test_transforms_are_columns(self) -> None:
        rows = [[1, 2, 3, 10], [4, 5, 6, 20], [7, 8, 9, 30]]
        self.assertEqual(polyptych.transform(rows), [1, 4, 7, 2, 5, 8, 3, 6, 9, 10, 20, 30])
        self.assertEqual(polyptych.transform([*rows, [0, 0, 0, 1]]), polyptych.transform(rows))
        self.near(
            polyptych.placed((1, 2, 3), (0, 0, 0, 1), 2.0), (2, 0, 0, 0, 2, 0, 0, 0, 2, 1, 2, 3)
        )
        for wrong in ([1, 2], [[1, 2, 3], [1, 2, 3], [1, 2, 3]]):
            with self.assertRaises(ValueError):
                polyptych.transform(wrong)


class Json(unittest.TestCase):
    """What the wire says comes back as it was, or the place of the fault is named."""

    def test_a_status_comes_back(self) -> None:
        status = decode(WallStatus, STATUS)
        self.assertIs(status.presentation.output_mode, polyptych.OutputMode.NORMAL)
        encoded = encode(status)
        for name, value in STATUS.items():
            if name != "presentation":
                self.assertEqual(encoded[name], value)
        self.assertEqual(encode(status.presentation.camera)["scale"], 1.0)

    def test_members_that_are_new_are_left_out(self) -> None:
        decode(WallStatus, {**STATUS, "weather": {"rain": True}})

    def test_faults_are_named_with_their_place(self) -> None:
        for change, text in (
            ({"frame": "7"}, "answer.frame is '7', no int"),
            ({"frame": True}, "answer.frame is True, no int"),
            ({"clients": [1]}, "answer.clients[0] is 1, no str"),
            ({"presentation": None}, "answer.presentation is None, no object"),
            ({"channels": {}}, "answer.channels is {}, no list"),
        ):
            with self.assertRaises(Mismatch) as caught:
                decode(WallStatus, {**STATUS, **change})
            self.assertEqual(str(caught.exception), text)
        lacking = {name: of for name, of in STATUS.items() if name != "wall"}
        with self.assertRaises(Mismatch) as caught:
            decode(WallStatus, lacking)
        self.assertEqual(str(caught.exception), "answer has no wall")

    def test_requests_that_bring_files_are_known(self) -> None:
        brought = {"assets": {"source": {"File": "a.glb"}}}
        edit = polyptych.Transaction()
        for request, expected in (
            ({"Edit": brought}, True),
            ({"Edit": polyptych.Transaction().with_assets(glb=b"glTF")}, True),
            ({"Edit": edit}, False),
            ({"Edit": edit.to_json()}, False),
            ({"SetEnvironment": {"File": {"path": "a.hdr"}}}, True),
            ({"SetEnvironment": "Sky"}, True),
            ({"SetEnvironment": "None"}, False),
            ({"SetTone": "None"}, False),
            ("Pause", False),
        ):
            self.assertEqual(brings_files(request), expected)

    def test_views_have_the_form_of_the_wire(self) -> None:
        view = polyptych.View(
            polyptych.Camera(),
            polyptych.Area(1, (2, 3, 4, 5)),
            polyptych.Projection(fov_y_rad=0.5),
        )
        encoded = encode(view)
        self.assertEqual(encoded["area"], {"Screen": {"screen": 1, "rect": [2, 3, 4, 5]}})
        self.assertEqual(encoded["projection"], {"Perspective": {"fov_y_rad": 0.5}})
        self.assertEqual(decode(polyptych.View, encoded), view)
        self.assertEqual(encode(polyptych.View(polyptych.Camera()))["area"], "Wall")


class Pictures(unittest.TestCase):
    """Pictures are cut, read and written."""

    image = polyptych.Image("front", 3, 2, bytes(range(24)), 7)

    def test_pixels_and_parts(self) -> None:
        self.assertEqual(self.image.pixel(2, 1), (20, 21, 22, 23))
        with self.assertRaises(IndexError):
            self.image.pixel(3, 0)
        part = self.image.part("left", 1, 0, 2, 2)
        self.assertEqual((part.width, part.height, part.frame), (2, 2, 7))
        self.assertEqual(part.pixel(0, 1), self.image.pixel(1, 1))

    def test_png_files_hold_the_same_bytes(self) -> None:
        png = self.image.to_png()
        self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")
        at, chunks = 8, {}
        while at < len(png):
            (length,) = struct.unpack(">I", png[at : at + 4])
            name, data = png[at + 4 : at + 8], png[at + 8 : at + 8 + length]
            self.assertEqual(
                struct.pack(">I", zlib.crc32(name + data)), png[at + 8 + length : at + 12 + length]
            )
            chunks[name] = data
            at += 12 + length
        self.assertEqual(chunks[b"IHDR"], struct.pack(">2I5B", 3, 2, 8, 6, 0, 0, 0))
        lines = zlib.decompress(chunks[b"IDAT"])
        self.assertEqual(lines, b"\0" + bytes(range(12)) + b"\0" + bytes(range(12, 24)))

    def test_notebooks_show_pictures_with_escaped_names(self) -> None:
        odd = polyptych.Image("<b>", 3, 2, bytes(24), 7)
        shown = polyptych.Capture(7, [odd], [], [("a&b", "it is <gone>")])._repr_html_()
        self.assertIn("&lt;b&gt;", shown)
        self.assertIn("a&amp;b is missing: it is &lt;gone&gt;", shown)
        self.assertNotIn("<b>", shown)
        self.assertIn("data:image/png;base64,", shown)

    def test_arrays_have_rows_from_the_top(self) -> None:
        try:
            import numpy
        except ImportError:
            self.skipTest("numpy is not installed")
        array = self.image.array
        self.assertEqual((array.shape, str(array.dtype)), ((2, 3, 4), "uint8"))
        self.assertEqual(list(array[1, 2]), [20, 21, 22, 23])
        self.assertEqual(numpy.asarray(self.image).sum(), sum(range(24)))


if __name__ == "__main__":
    unittest.main()
