"""Where and as whom to connect, and how long to wait."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Optional, Tuple

from .credentials import keys_folder

#: The port at which a manager serves HTTP unless it is told otherwise.
PORT_DEFAULT = 7880

#: The maximum size of a picture by default: a screen of 16,384 x 16,384 pixels, twice.
CAPTURE_BYTES_MAX = 2 << 30


@dataclass(frozen=True)
class Timeouts:
    """How long this client waits for the answers to requests, in seconds.

    For surroundings, and for a transaction that brings files, the limit begins anew with each
    status that the manager sends meanwhile: it bakes the files first, and ends what hangs.
    """

    #: For opening a scene or a session, from when the manager no longer says that it opens it, and
    #: for surroundings and effects of light.
    open_scene: float = 120.0
    #: For each picture.
    capture: float = 60.0
    #: For everything else.
    other: float = 30.0
    #: For a connection to be made.
    connect: float = 5.0


@dataclass(frozen=True)
class ReconnectPolicy:
    """What a client does when it has no connection any more."""

    #: Seconds for which a request waits for a connection before it fails with ``NotConnected``.
    wait: float = 10.0


@dataclass(frozen=True)
class ConnectOptions:
    """Where and as whom to connect. Only the address is needed."""

    #: HOST:PORT, or HOST with port 7880, as in ``manager --http``.
    address: str = f"127.0.0.1:{PORT_DEFAULT}"
    #: The manager's secret itself; goes before ``token_file``.
    token: Optional[str] = field(default=None, repr=False)
    #: The file that holds the secret; ``POLYPTYCH_TOKEN_FILE`` or the user's own if not given.
    token_file: Optional[Path] = None
    #: What ``polyptych login --token`` prints, instead of the secret; ``POLYPTYCH_BEARER`` if not
    #: given. With it alone the client cannot check that the manager knows the secret, too.
    bearer: Optional[str] = field(default=None, repr=False)
    #: This client's folder of keys, as ``polyptych keys`` makes it: all is encrypted, and no token
    #: is needed. ``POLYPTYCH_KEYS`` if not given.
    keys: Optional[Path] = field(default_factory=lambda: keys_folder(os.environ))
    #: Goes over a network without keys, where everybody who listens can read the token.
    insecure: bool = False
    #: For logs and status, without spaces; with keys it is the certificate's.
    name: str = "python"
    timeouts: Timeouts = Timeouts()
    #: The maximum size of a picture, in bytes.
    capture_bytes_max: int = CAPTURE_BYTES_MAX
    reconnect: ReconnectPolicy = ReconnectPolicy()

    def host_and_port(self) -> Tuple[str, int]:
        """Returns the two parts of the address.

        :raises ValueError: the port is no number from 1 to 65535.
        """
        text = self.address
        for scheme in ("http://", "https://"):
            if text.startswith(scheme):
                text = text[len(scheme) :]
        text = text.rstrip("/")
        if text.startswith("["):
            host, _, port = text[1:].partition("]")
            port = port.lstrip(":")
        elif text.count(":") == 1:
            host, _, port = text.partition(":")
        else:
            host, port = text, ""
        if not port:
            return host, PORT_DEFAULT
        if not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise ValueError(f"the port is a number from 1 to 65535, not {port!r}")
        return host, int(port)
