"""What the client does where a manager is silent, gone, in the way, or says no."""

from __future__ import annotations

import fcntl
import io
import json
import os
import resource
import socket
import tarfile
import tempfile
import threading
import unittest
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, List, Tuple

from manager_double import STATUS, TOKEN, Handler, ManagerDouble, answer

import polyptych
from polyptych import bearer, credentials
from polyptych.transport import Call, Transport, is_readable

QUICK = polyptych.Timeouts(open_scene=0.3, capture=0.3, other=0.3, connect=2.0)


def connect(double: ManagerDouble, **more: Any) -> polyptych.Client:
    options = polyptych.ConnectOptions(
        address=double.address,
        bearer="b" * 64,
        keys=None,
        timeouts=QUICK,
        reconnect=polyptych.ReconnectPolicy(wait=0.3),
    )
    return polyptych.Client(replace(options, **more))


def says(status: int, value: Any, headers: Tuple[Tuple[str, str], ...] = ()) -> Handler:
    def handler(connected: socket.socket, *_: Any) -> bool:
        connected.sendall(answer(status, value, headers))
        return True

    return handler


def captured(adjustments: List[Any], width: int) -> Handler:
    """A wall of one screen, whose picture of so many pixels may be that of both eyes."""
    screen = {"name": "front", "surface": {"Mesh": "front.obj"}, "canvas": [1, 1]}
    channel = {"name": "a", "screen": 0, "origin": [0, 0], "size": [1, 1], "server": "a"}
    channels = [{**channel, "adjustment": of} for of in adjustments]
    wall = {"name": "double", "screens": [screen], "channels": channels, "eye": [0, 0, 0]}
    size = {"width": 1, "height": 1}
    pictures = [
        {"name": name, "file": name, **size, "is_screen": name != "a"}
        for name in ("front", "front-right", "a")
    ]
    about = json.dumps({"frame": 7, "pictures": pictures, "missing": []}).encode()
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        for name in ("capture.json", "front", "front-right", "a"):
            held = about if name == "capture.json" else b"abcd"
            member = tarfile.TarInfo(name)
            member.size = len(held)
            tar.addfile(member, io.BytesIO(held))
    headers = (("width", str(width)), ("height", "1"), ("frame", "7"))

    def handler(connected: socket.socket, _: str, path: str, body: bytes) -> bool:
        if path == "/api/v1/requests":
            connected.sendall(answer(200, {"response": {"Wall": wall}, "warnings": []}))
        elif path == "/api/v1/wall.rgba":
            named = tuple((f"polyptych-{name}", text) for name, text in headers)
            connected.sendall(answer(200, b"abcd" * width, named))
        else:
            connected.sendall(answer(200, archive.getvalue()))
        return True

    return handler


def hangs_up(connected: socket.socket, *_: Any) -> bool:
    return False


class Outcomes(unittest.TestCase):
    """Each way in which a request ends has its error, and no request is sent twice."""

    def fails(self, handler: Handler, kind: Any, text: str, is_unknown: bool = False) -> None:
        with ManagerDouble(handler) as double:
            with connect(double) as wall, self.assertRaises(kind) as caught:
                wall.set_exposure(2.0)
            self.assertIn(text, str(caught.exception))
            self.assertEqual(caught.exception.is_outcome_unknown, is_unknown)
            self.assertEqual(double.requests, [("POST", "/api/v1/requests")], "sent once")

    def test_the_manager_refuses_with_its_own_text(self) -> None:
        said = {"error": "an exposure is above 0, not -1"}
        self.fails(says(422, said), polyptych.Failed, "cannot set the exposure: an exposure is")
        self.fails(says(400, said), polyptych.Failed, "an exposure is above 0, not -1")
        self.fails(says(413, said), polyptych.RequestTooLarge, "an exposure is above 0, not -1")
        for status in (401, 403, 421):
            self.fails(says(status, said), polyptych.Refused, "an exposure is above 0, not -1")

    def test_a_manager_that_ends_leaves_the_outcome_unknown(self) -> None:
        said = {"error": "the manager ended this client: it stops"}
        self.fails(says(503, said), polyptych.ManagerEnded, "is unknown", is_unknown=True)
        busy = {"error": "4 captures are on their way; ask again later"}
        self.fails(says(503, busy), polyptych.Failed, "4 captures are on their way")

    def test_a_connection_that_ends_is_not_asked_again(self) -> None:
        self.fails(hangs_up, polyptych.ConnectionLost, "whether it did", is_unknown=True)

        def breaks_off(connected: socket.socket, *_: Any) -> bool:
            connected.sendall(answer(200, b'{"response"', length=500))
            return False

        self.fails(breaks_off, polyptych.ConnectionLost, "broke off", is_unknown=True)

    def test_silence_times_out(self) -> None:
        held = threading.Event()

        def is_silent(connected: socket.socket, *_: Any) -> bool:
            held.wait(20.0)
            return False

        self.fails(is_silent, polyptych.TimedOut, "within 0.3 s", is_unknown=True)
        held.set()

    def test_what_is_being_opened_is_awaited_beyond_the_time_limit(self) -> None:
        progress = {"stage": "baking", "percent": 7}
        status = dict(STATUS, opening=[{"scene": "town", "progress": progress}])

        def opens(connected: socket.socket, *_: Any) -> bool:
            # Of these at most 5 are asked for within the limit.
            for _ in range(9):
                self.assertTrue(double.statuses.acquire(timeout=20.0))
            connected.sendall(answer(422, {"error": "the scene is gone"}))
            return True

        arm = polyptych.Transaction().with_assets(file=Path("arm.glb"))
        calls: Tuple[Tuple[Any, Callable[[polyptych.Client], object]], ...] = (
            (status, lambda wall: wall.open_session("evening")),
            (status, lambda wall: wall.open_scene(Path("town.glb"))),
            # Of files that are read for these no status tells.
            (STATUS, lambda wall: wall.commit(arm)),
            (STATUS, lambda wall: wall.set_environment(Path("studio.hdr"))),
        )
        for said, call in calls:
            with ManagerDouble(opens, said) as double, connect(double) as wall:
                with self.assertRaisesRegex(polyptych.Failed, "the scene is gone"):
                    call(wall)
                self.assertTrue(double.ended.acquire(timeout=20.0), "the one that asked")
                self.assertTrue(wall.is_connected)

    def test_the_first_call_after_a_restart_is_awaited_as_any_other(self) -> None:
        opening = [{"scene": "town", "progress": {"stage": "baking", "percent": 7}}]
        restarted = dict(STATUS, epoch="00000000000000cc", opening=opening)

        def ends_or_opens(connected: socket.socket, _: str, path: str, body: bytes) -> bool:
            if "OpenScene" not in json.loads(body):
                return False
            # Of these at most 8 are asked for within the limit.
            for _ in range(10):
                self.assertTrue(double.statuses.acquire(timeout=20.0))
            connected.sendall(answer(422, {"error": "the scene is gone"}))
            return True

        with ManagerDouble(ends_or_opens) as double, connect(double) as wall:
            with self.assertRaises(polyptych.ConnectionLost):
                wall.set_exposure(1.0)
            double.status = restarted
            with self.assertRaisesRegex(polyptych.Failed, "the scene is gone"):
                wall.open_scene("town.glb")
            self.assertEqual(wall.epoch, "00000000000000cc")

    def test_progress_can_call_the_wall_that_opens_the_scene(self) -> None:
        progress = {"stage": "baking", "percent": 7}
        status = dict(STATUS, opening=[{"scene": "town", "progress": progress}], frame=9)
        called = threading.Semaphore(0)

        def opens(connected: socket.socket, _: str, path: str, body: bytes) -> bool:
            if json.loads(body) == "Status":
                told = {"response": {"Status": status}, "warnings": []}
                connected.sendall(answer(200, told))
            else:
                self.assertTrue(called.acquire(timeout=20.0))
                connected.sendall(answer(422, {"error": "the scene is gone"}))
            return True

        def open_scene(call: Callable[[], object]) -> None:
            def on_progress(_: Any) -> None:
                call()
                called.release()

            wall.open_scene("town.glb", on_progress=on_progress)

        with ManagerDouble(opens, status) as double, connect(double) as wall:
            for _ in range(2):
                with self.assertRaisesRegex(polyptych.Failed, "the scene is gone"):
                    open_scene(lambda: self.assertEqual(wall.status().frame, 9))
            with self.assertRaisesRegex(polyptych.ConnectionLost, "this program closed it"):
                open_scene(wall.close)
            with self.assertRaises(polyptych.Closed):
                wall.status()

    def test_scenes_and_variants_are_chosen_by_number_too(self) -> None:
        bodies = []

        def refuses(connected: socket.socket, _: str, path: str, body: bytes) -> bool:
            bodies.append(json.loads(body))
            connected.sendall(answer(422, {"error": "there is none"}))
            return True

        with ManagerDouble(refuses) as double, connect(double) as wall:
            calls: Tuple[Callable[[], object], ...] = (
                lambda: wall.open_scene("town.glb", scene=1),
                lambda: wall.show_scene("town.glb", scene=1),
                lambda: wall.set_variant(0),
            )
            for call in calls:
                self.assertRaises(polyptych.Failed, call)
        asked = {"path": "town.glb", "scene": "1"}
        self.assertEqual(bodies[:2], [{"OpenScene": asked}, {**asked, "heading_deg": 30.0}])
        self.assertEqual(bodies[2]["Edit"]["edits"], [{"SetVariant": "0"}])

    def test_other_answers_are_no_answers(self) -> None:
        other = {"response": {"Frame": {}}, "warnings": []}
        self.fails(says(200, other), polyptych.WrongAnswer, "something else: Frame")
        self.fails(says(200, b"hello"), polyptych.WrongAnswer, "no JSON")
        self.fails(says(500, b"<html>"), polyptych.Handshake, "status 500: <html>")

    def test_every_warning_is_logged(self) -> None:
        warnings = ["the state is not kept", "größer als der Platz"]
        headers = tuple(("polyptych-warning", warning) for warning in warnings)
        done = {"response": "Done", "warnings": []}
        with ManagerDouble(says(200, done, headers)) as double, connect(double) as wall:
            with self.assertLogs("polyptych", "WARNING") as logs:
                wall.set_exposure(1.0)
        self.assertEqual([record.getMessage() for record in logs.records], warnings)

    def test_numbers_that_json_has_not_are_refused_here(self) -> None:
        with ManagerDouble(hangs_up) as double:
            wall = connect(double)
            self.addCleanup(wall.close)
            for number in (float("nan"), float("inf")):
                with self.assertRaises(polyptych.Failed) as caught:
                    wall.set_exposure(number)
                self.assertIn("not finite", str(caught.exception))
            with self.assertRaises(polyptych.RequestTooLarge):
                wall.request({"Edit": {"assets": "x" * (5 << 20)}})
            self.assertEqual(double.requests, [], "nothing was sent")

    def test_a_capture_is_one_frame_whatever_the_eyes_see(self) -> None:
        one, all_eyes = "/api/v1/wall.rgba", "/api/v1/capture?format=rgba"
        plain, right = {"eye": "center", "packing": "none"}, {"eye": "right", "packing": "none"}
        packed = {"eye": "center", "packing": "anaglyph"}
        for adjustments, width, asked in (
            ([plain, {}], 1, [one]),
            ([plain, right], 2, [all_eyes]),
            ([packed], 2, [all_eyes]),
            # The wall is not as it was described.
            ([plain], 2, [one, all_eyes]),
        ):
            handler = captured(adjustments, width)
            with ManagerDouble(handler) as double, connect(double) as wall:
                capture = wall.capture()
                self.assertEqual([of for _, of in double.requests[1:]], asked)
            self.assertEqual([of.name for of in capture.screens], ["front"])
            self.assertEqual((capture.frame, capture.channels), (7, []))

    def test_pictures_that_do_not_fit_are_refused(self) -> None:
        size = (("polyptych-width", "2"), ("polyptych-height", "1"))
        for body, headers, kind, text in (
            (bytes(7), size, polyptych.MalformedPicture, "7 bytes; 2 x 1 pixels have 8"),
            (bytes(8), (), polyptych.MalformedPicture, "without its size"),
            (bytes(101), size, polyptych.CaptureTooLarge, "more than 100 bytes"),
        ):
            with ManagerDouble(says(200, body, headers)) as double:
                wall = connect(double, capture_bytes_max=100)
                self.addCleanup(wall.close)
                with self.assertRaises(kind) as caught:
                    wall.preview()
                self.assertIn(text, str(caught.exception))


class Connecting(unittest.TestCase):
    """A client finds its manager, or says why not."""

    def fails(self, kind: Any, text: str, address: str = "127.0.0.1:1", **more: Any) -> None:
        options = polyptych.ConnectOptions(
            address=address, bearer="b" * 64, keys=None, timeouts=QUICK
        )
        with self.assertRaises(kind) as caught:
            polyptych.Client(replace(options, **more))
        self.assertIn(text, str(caught.exception))

    def test_addresses_that_lead_nowhere(self) -> None:
        self.fails(polyptych.NoManager, "polyptych manager --http 127.0.0.1:1")
        self.fails(polyptych.Unresolved, "write HOST:PORT", "127.0.0.1:99999")
        self.fails(polyptych.NotSecured, "192.0.2.7 is reached over a network", "192.0.2.7:7880")
        self.fails(polyptych.Keys, "polyptych keys WALL.toml", keys=Path("/nowhere/at/all"))

    def test_a_program_that_says_nothing_is_no_manager(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            address = "127.0.0.1:%d" % listener.getsockname()[1]
            quick = replace(QUICK, connect=0.2)
            self.fails(polyptych.NoIntroduction, "within 0.2 s", address, timeouts=quick)

    def test_a_machine_that_takes_no_connection_is_no_manager(self) -> None:
        with socket.create_server(("127.0.0.1", 0), backlog=0) as listener:
            fillers = [socket.socket() for _ in range(4)]
            for filler in fillers:
                self.addCleanup(filler.close)
                filler.setblocking(False)
                filler.connect_ex(listener.getsockname())
            address = "127.0.0.1:%d" % listener.getsockname()[1]
            quick = replace(QUICK, connect=0.2)
            self.fails(
                polyptych.NoIntroduction, "a firewall stand between", address, timeouts=quick
            )

    def test_a_program_that_speaks_something_else_is_no_manager(self) -> None:
        def speaks(listener: socket.socket) -> None:
            connected, _ = listener.accept()
            connected.recv(1 << 16)
            connected.sendall(b"220 mail.example ESMTP\r\n")
            connected.close()

        with socket.create_server(("127.0.0.1", 0)) as listener:
            threading.Thread(target=speaks, args=(listener,), daemon=True).start()
            address = "127.0.0.1:%d" % listener.getsockname()[1]
            self.fails(polyptych.Handshake, "no manager that this client understands", address)

    def test_a_manager_that_is_full_refuses(self) -> None:
        full = {"error": "384 connections are open, and no more may be; end one of them"}
        with ManagerDouble(says(503, full)) as double:
            with self.assertRaises(polyptych.Refused) as caught:
                connect(double, bearer=None, token=TOKEN)
            self.assertIn("refused this client: 384 connections", str(caught.exception))

    def test_the_bearer_is_shown_only_to_who_knows_the_token(self) -> None:
        shown = []

        def challenge(connected: socket.socket, method: str, path: str, body: bytes) -> bool:
            shown.append(path)
            nonce = json.loads(body)["nonce"]
            proof = bearer.manager_proof(token, "m" * 32, nonce)
            connected.sendall(answer(200, {"nonce": "m" * 32, "proof": proof}))
            return True

        token = TOKEN
        with ManagerDouble(challenge) as double:
            wall = connect(double, bearer=None, token=TOKEN)
            self.addCleanup(wall.close)
            self.assertEqual((wall.wall_name, wall.epoch), ("double", "00000000000000aa"))
            token = "fedcba9876543210"
            with self.assertRaises(polyptych.Handshake) as caught:
                connect(double, bearer=None, token=TOKEN)
            self.assertIn("does not know the token", str(caught.exception))
        self.assertEqual(shown, ["/api/v1/login/challenge"] * 2)

    def test_a_connection_that_was_idle_is_made_again(self) -> None:
        done = {"response": "Done", "warnings": []}

        def once(connected: socket.socket, *_: Any) -> bool:
            connected.sendall(answer(200, done))
            return False

        with ManagerDouble(once) as double:
            wall = connect(double)
            self.addCleanup(wall.close)
            for _ in range(3):
                wall.set_exposure(1.0)
                while wall.is_connected:
                    pass
            self.assertEqual(len(double.requests), 3)
            self.assertEqual(double.connections, 3)

    def test_a_connection_is_made_again_before_the_manager_closes_it(self) -> None:
        call = Call("pause", "POST", "/requests", 2.0, b'"Pause"')
        with ManagerDouble(says(200, {})) as double:
            options = polyptych.ConnectOptions(double.address, bearer="b" * 64, keys=None)
            transport, now = Transport(options), 0.0
            self.addCleanup(transport.close, "the test ends")
            transport.clock = lambda: now
            for now, connections in ((1.0, 1), (25.9, 1), (50.8, 1), (76.0, 2)):
                transport.exchange(call)
                self.assertEqual(double.connections, connections)

    def test_answers_are_awaited_where_a_program_has_1024_files_open(self) -> None:
        limits = resource.getrlimit(resource.RLIMIT_NOFILE)
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, limits)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (2048, limits[1]))
        except ValueError:
            self.skipTest("a process has too few files")
        here, there = socket.socketpair()
        far = socket.socket(fileno=fcntl.fcntl(here, fcntl.F_DUPFD, 1024))
        for of in (here, there, far):
            self.addCleanup(of.close)
        self.assertFalse(is_readable(far, 0.0))
        there.send(b"H")
        self.assertTrue(is_readable(far, 0.0))

    def test_a_manager_that_does_not_come_back_is_said_with_nothing_sent(self) -> None:
        with ManagerDouble(hangs_up) as double:
            wall = connect(double)
            self.addCleanup(wall.close)
            with self.assertRaises(polyptych.ConnectionLost):
                wall.pause()
        with self.assertRaises(polyptych.NotConnected) as caught:
            wall.pause()
        self.assertIn("nothing was sent", str(caught.exception))
        self.assertFalse(caught.exception.is_outcome_unknown)

    def test_another_wall_is_not_taken_for_the_first(self) -> None:
        with ManagerDouble(hangs_up) as double:
            wall = connect(double)
            self.addCleanup(wall.close)
            with self.assertRaises(polyptych.ConnectionLost):
                wall.pause()
            double.status = {**STATUS, "wall": "other"}
            with self.assertRaises(polyptych.NotConnected) as caught:
                wall.pause()
            self.assertIn("it drives wall other now, not double", str(caught.exception))

    def test_a_client_that_was_closed_stays_closed(self) -> None:
        with ManagerDouble(hangs_up) as double:
            with connect(double) as wall:
                pass
            with self.assertRaises(polyptych.Closed):
                wall.status()
            self.assertEqual(double.requests, [])

    def test_a_client_is_closed_while_another_thread_awaits_an_answer(self) -> None:
        asked, held = threading.Event(), threading.Event()
        self.addCleanup(held.set)

        def is_silent(connected: socket.socket, *_: Any) -> bool:
            asked.set()
            held.wait(20.0)
            return False

        patient = replace(QUICK, other=20.0)
        with ManagerDouble(is_silent) as double, ThreadPoolExecutor() as pool:
            wall = connect(double, timeouts=patient)
            pausing = pool.submit(wall.pause)
            self.assertTrue(asked.wait(20.0))
            wall.close()
            # A close that waits for the call finds that it has timed out.
            error = pausing.exception(timeout=20.0)
            self.assertIsInstance(error, polyptych.ConnectionLost)
            self.assertIn("this program closed it", str(error))

    def test_addresses_have_a_usual_port(self) -> None:
        for text, expected in (
            ("wall-3", ("wall-3", 7880)),
            ("wall-3:80", ("wall-3", 80)),
            ("::1", ("::1", 7880)),
            ("[::1]:9", ("::1", 9)),
            ("http://127.0.0.1:1/", ("127.0.0.1", 1)),
        ):
            options = polyptych.ConnectOptions(address=text, keys=None)
            self.assertEqual(options.host_and_port(), expected)


class Events(unittest.TestCase):
    """Events come in order, and a stream that breaks off is begun again."""

    def test_a_stream_goes_on_after_its_connection(self) -> None:
        text = (
            f"event: status\ndata: {json.dumps(STATUS)}\n\n"
            'event: log\ndata: {"text": "channel a is lost"}\n\n'
            "event: other\ndata: 1\n\n"
            'event: lost\ndata: {"events": 7}\n\n'
        )

        def streams(connected: socket.socket, *_: Any) -> bool:
            head = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\n\r\n"
            connected.sendall(head + text.encode())
            return False

        with ManagerDouble(streams) as double:
            with connect(double) as wall, wall.events() as events:
                seen = [next(events) for _ in range(6)]
                self.assertEqual(events.reconnects, 1)
                with wall.feedback() as frames:
                    self.assertEqual(frames.reconnects, 1)
            with self.assertRaises(polyptych.Closed):
                next(events)
        kinds = [type(event).__name__ for event in seen]
        self.assertEqual(kinds, ["StatusEvent", "LogEvent", "LostEvent"] * 2)
        self.assertEqual(seen[1], polyptych.LogEvent("channel a is lost"))
        self.assertEqual(seen[2], polyptych.LostEvent(7))

    def test_a_stream_that_breaks_off_again_is_begun_until_there_is_no_time_left(self) -> None:
        left = [True, False, True]

        def streams(connected: socket.socket, *_: Any) -> bool:
            if left and left.pop(0):
                head = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\n\r\n"
                connected.sendall(head + b'event: lost\ndata: {"events": 7}\n\n')
            return False

        with ManagerDouble(streams) as double:
            with connect(double) as wall, wall.events() as events:
                self.assertEqual([next(events), next(events)], [polyptych.LostEvent(7)] * 2)
                self.assertEqual(len(double.requests), 3)
                with self.assertRaisesRegex(polyptych.NotConnected, "the manager closed it"):
                    next(events)

    def test_a_thread_that_reads_a_stream_is_woken_when_it_is_closed(self) -> None:
        head, text = b"HTTP/1.1 200 OK\r\n", b'event: lost\ndata: {"events": 7}\n\n'
        chunk = b"%x\r\n%s\r\n" % (len(text), text)
        self.is_woken(head + b"transfer-encoding: chunked\r\n\r\n" + chunk)
        # An answer of no length has the connection to itself.
        self.is_woken(head + b"\r\n" + text)

    def is_woken(self, begun: bytes) -> None:
        held, seen = threading.Event(), threading.Semaphore(0)
        self.addCleanup(held.set)

        def streams(connected: socket.socket, *_: Any) -> bool:
            connected.sendall(begun)
            held.wait(20.0)
            return False

        with ManagerDouble(streams) as double, connect(double) as wall:
            events = wall.events()

            def reads() -> None:
                for _ in events:
                    seen.release()

            with ThreadPoolExecutor() as pool:
                reading = pool.submit(reads)
                self.assertTrue(seen.acquire(timeout=20.0))
                # Meanwhile the thread comes to wait for the next event.
                connect(double).close()
                events.close()
                self.assertIsInstance(reading.exception(timeout=5.0), polyptych.Closed)


class Secrets(unittest.TestCase):
    """Secrets are read where commands read them, and printed nowhere."""

    def test_tokens_are_private_files(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "token"
            for text, mode, said in (
                ("0123456789abcdef\n", 0o600, None),
                ("0123456789abcdef", 0o644, "run: chmod 600"),
                ("short", 0o600, "16 to 256 characters"),
                ("0123456789abcde%", 0o600, "16 to 256 characters"),
            ):
                path.write_text(text)
                os.chmod(path, mode)
                if said is None:
                    self.assertEqual(credentials.read_token(path), "0123456789abcdef")
                    continue
                with self.assertRaises(polyptych.Token) as caught:
                    credentials.read_token(path)
                self.assertIn(said, str(caught.exception))
            with self.assertRaises(polyptych.Token):
                credentials.read_token(Path(folder))

    def test_bearer_tokens_are_checked_before_they_are_sent(self) -> None:
        self.assertEqual(credentials.checked_bearer(" " + "0f" * 32 + "\n"), "0f" * 32)
        for wrong in ("", "0123456789abcdef", "g" * 64, "ü" * 64, "0" * 32 + "\n" + "0" * 31):
            with self.assertRaises(polyptych.Token):
                credentials.checked_bearer(wrong)

    def test_names_of_programs_are_words_of_http(self) -> None:
        for name in ("", "a b/c", "größe\r\nX: y"):
            with ManagerDouble(hangs_up) as double:
                with connect(double, name=name) as wall:
                    self.assertEqual(wall.wall_name, "double")

    def test_the_place_of_the_token(self) -> None:
        for environment, expected in (
            ({"POLYPTYCH_TOKEN_FILE": "/a", "HOME": "/b"}, "/a"),
            ({"XDG_STATE_HOME": "/s", "HOME": "/b"}, "/s/polyptych/token"),
            ({"HOME": "/b"}, "/b/.local/state/polyptych/token"),
        ):
            self.assertEqual(str(credentials.default_token_path(environment)), expected)
        with self.assertRaises(polyptych.Token):
            credentials.default_token_path({})

    def test_secrets_are_not_printed(self) -> None:
        options = polyptych.ConnectOptions(token=TOKEN, bearer="b" * 64, keys=None)
        self.assertNotIn(TOKEN, repr(options))
        self.assertNotIn("b" * 64, repr(options))


if __name__ == "__main__":
    unittest.main()
