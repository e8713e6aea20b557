"""The secrets that a client shows: the manager's token, a bearer token made of it, or keys."""

from __future__ import annotations

import os
import ssl
import stat
from pathlib import Path
from typing import Mapping, Optional

from .errors import Keys, Token

TOKEN_FILE_VARIABLE = "POLYPTYCH_TOKEN_FILE"
BEARER_VARIABLE = "POLYPTYCH_BEARER"
KEYS_VARIABLE = "POLYPTYCH_KEYS"

# The name that the manager's certificate has; it is looked up nowhere.
MANAGER_NAME = "manager.polyptych"

_TOKEN_BYTES_MAX = 256
_TOKEN_BYTES_MIN = 16


def default_token_path(environment: Mapping[str, str]) -> Path:
    """Returns the token's file: ``POLYPTYCH_TOKEN_FILE``, or the one in the user's state folder.

    :raises Token: the environment names no folder.
    """
    if environment.get(TOKEN_FILE_VARIABLE):
        return Path(environment[TOKEN_FILE_VARIABLE])
    if environment.get("XDG_STATE_HOME"):
        return Path(environment["XDG_STATE_HOME"]) / "polyptych" / "token"
    if environment.get("HOME"):
        return Path(environment["HOME"]) / ".local" / "state" / "polyptych" / "token"
    raise Token(f"neither {TOKEN_FILE_VARIABLE}, XDG_STATE_HOME nor HOME says where the token lies")


def read_token(path: Path) -> str:
    """Returns the token in this file, which only its owner may read.

    :raises Token: it is not there, can be read by others, or is no token.
    """
    try:
        facts = path.stat()
    except FileNotFoundError:
        raise Token(
            f"{path} is not there; the manager makes it when it starts as the same user, without "
            "--keys"
        ) from None
    except OSError as error:
        raise Token(f"{path}: {error.strerror}") from None
    malformed = f"{path} holds no token of 16 to 256 characters; remove it and start the manager"
    if not stat.S_ISREG(facts.st_mode) or facts.st_size > _TOKEN_BYTES_MAX:
        raise Token(malformed)
    _check_private(path, facts)
    try:
        with path.open("rb") as file:
            text = file.read(_TOKEN_BYTES_MAX).decode("utf-8", "replace").strip()
    except OSError as error:
        raise Token(f"{path}: {error.strerror}") from None
    if len(text) < _TOKEN_BYTES_MIN or not (text.isascii() and text.isalnum()):
        raise Token(malformed)
    return text


def checked_bearer(text: str) -> str:
    """Returns a bearer token without the blanks around it.

    :raises Token: it is no bearer token.
    """
    bare = text.strip()
    if len(bare) != 64 or any(digit not in "0123456789abcdef" for digit in bare):
        raise Token("a bearer token has 64 hexadecimal digits; polyptych login --token prints it")
    return bare


def _check_private(path: Path, facts: os.stat_result) -> None:
    if not hasattr(os, "geteuid"):
        return
    ours = os.geteuid()
    if facts.st_uid not in (ours, 0):
        raise Token(
            f"{path} belongs to another user (id {facts.st_uid}), who knows its secret; make it "
            f"anew, or run: chown {ours} {path}"
        )
    if facts.st_mode & 0o077:
        raise Token(f"{path} can be read or changed by other users; run: chmod 600 {path}")


def tls_context(folder: Path) -> ssl.SSLContext:
    """Returns the context of a connection with keys, as ``polyptych keys`` makes them.

    Only managers that the wall's own authority has signed are trusted.

    :raises Keys: a file is missing or is no key.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    names = {name: folder / name for name in ("cert.pem", "key.pem", "authority.pem")}
    for path in names.values():
        if not path.is_file():
            raise Keys(
                f"{path} is not there; polyptych keys WALL.toml --client NAME makes a folder of "
                "keys"
            )
    try:
        context.load_cert_chain(names["cert.pem"], names["key.pem"])
        context.load_verify_locations(names["authority.pem"])
    except (ssl.SSLError, OSError) as error:
        raise Keys(f"{folder}: {error}") from None
    return context


def keys_folder(environment: Mapping[str, str]) -> Optional[Path]:
    """Returns the folder of keys that ``POLYPTYCH_KEYS`` names, if it does."""
    return Path(environment[KEYS_VARIABLE]) if environment.get(KEYS_VARIABLE) else None
