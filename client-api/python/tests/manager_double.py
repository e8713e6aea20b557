"""A program that answers HTTP as a test tells it, for what no real manager does on request."""

from __future__ import annotations

import json
import socket
import threading
from typing import Any, Callable, List, Optional, Tuple

TOKEN = "0123456789abcdef"
STATUS = {
    "wall": "double",
    "epoch": "00000000000000aa",
    "revision": 1,
    "digest": "00000000000000bb",
    "frame": 0,
    "scene": None,
    "deadline_ms": 50.0,
    "error_in_force_px": 0.0,
    "presentation": {
        "camera": {"position": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": 1},
        "head": {"position": [0, 0, 0], "rotation": [0, 0, 0, 1], "eye_separation_m": 0.063},
        "views": [],
        "exposure": 1.0,
        "output_mode": "normal",
        "pattern": None,
        "bounds": {"error_px": 0.0, "rate_fps": None},
    },
    "channels": [],
    "clients": [],
    "warnings": [],
}

Handler = Callable[[socket.socket, str, str, bytes], bool]


def answer(
    status: int, value: Any, headers: Tuple[Tuple[str, str], ...] = (), length: Optional[int] = None
) -> bytes:
    """Returns the bytes of an answer; ``value`` is JSON, or bytes as they are."""
    body = value if isinstance(value, bytes) else json.dumps(value).encode()
    lines = [f"HTTP/1.1 {status} X", f"content-length: {len(body) if length is None else length}"]
    lines.extend(f"{name}: {text}" for name, text in headers)
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body


class ManagerDouble:
    """Listens on a port of its own. Statuses are answered; all else is given to the handler.

    A handler gets the socket, the method, the path and the body, and returns whether the connection
    goes on.
    """

    def __init__(self, handler: Handler, status: Any = None) -> None:
        self.handler, self.status = handler, STATUS if status is None else status
        #: Method and path of every request that came, but for statuses.
        self.requests: List[Tuple[str, str]] = []
        self.connections = 0
        #: Released for each status that was asked for.
        self.statuses = threading.Semaphore(0)
        #: Released for each connection that has ended.
        self.ended = threading.Semaphore(0)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def __enter__(self) -> ManagerDouble:
        return self

    def __exit__(self, *_: object) -> None:
        # Alone, closing does not wake the thread that accepts.
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                connected, _ = self._listener.accept()
            except OSError:
                return
            self.connections += 1
            threading.Thread(target=self._serve, args=(connected,), daemon=True).start()

    def _serve(self, connected: socket.socket) -> None:
        with connected:
            reader = connected.makefile("rb")
            try:
                while self._answer_one(connected, reader):
                    pass
            except OSError:
                return
            finally:
                self.ended.release()

    def _answer_one(self, connected: socket.socket, reader: Any) -> bool:
        line = reader.readline().decode().split(" ")
        if len(line) < 3:
            return False
        length = 0
        while True:
            header = reader.readline().strip()
            if not header:
                break
            if header.lower().startswith(b"content-length:"):
                length = int(header.split(b":")[1])
        body = reader.read(length)
        method, path = line[0], line[1]
        if path == "/api/v1/status":
            connected.sendall(answer(200, self.status))
            self.statuses.release()
            return True
        self.requests.append((method, path))
        return self.handler(connected, method, path, body)
