"""Pictures of the wall, as bytes, as numpy arrays, as PNG, and in notebooks."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, List, Optional, Sequence, Tuple, Union

if TYPE_CHECKING:
    import numpy
    import numpy.typing

    Array = numpy.typing.NDArray[numpy.uint8]


@dataclass(frozen=True)
class Image:
    """A picture of a screen or channel: sRGB, 8 bits for red, green, blue and alpha."""

    #: Of the screen or channel.
    name: str
    #: Pixels across.
    width: int
    #: Pixels down.
    height: int
    #: Rows from the top, without padding: ``width * height * 4`` bytes.
    rgba: bytes = field(repr=False)
    #: The frame that it shows; ``None`` for a preview.
    frame: Optional[int] = None

    @property
    def array(self) -> Array:
        """The picture as a numpy array of shape (height, width, 4) and type uint8, read-only.

        :raises ImportError: numpy is not installed.
        """
        import numpy

        flat = numpy.frombuffer(self.rgba, dtype=numpy.uint8)
        return flat.reshape(self.height, self.width, 4)

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> Any:
        """The picture, for ``numpy.asarray(image)``."""
        array = self.array if dtype is None else self.array.astype(dtype)
        return array.copy() if copy else array

    def pixel(self, x: int, y: int) -> Tuple[int, int, int, int]:
        """Returns red, green, blue and alpha of a pixel, counted from the upper left.

        :raises IndexError: there is no such pixel.
        """
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise IndexError(f"({x}, {y}) is not on {self.width} x {self.height} pixels")
        at = 4 * (y * self.width + x)
        red, green, blue, alpha = self.rgba[at : at + 4]
        return red, green, blue, alpha

    def part(self, name: str, left: int, top: int, width: int, height: int) -> Image:
        """Returns a rectangle of the picture, as a picture of this name."""
        if (left, top, width, height) == (0, 0, self.width, self.height):
            return replace(self, name=name)
        rows = []
        for y in range(top, top + height):
            at = 4 * (y * self.width + left)
            rows.append(self.rgba[at : at + 4 * width])
        return Image(name, width, height, b"".join(rows), self.frame)

    def to_png(self) -> bytes:
        """Returns the picture as a PNG file."""
        row = 4 * self.width
        lines = [b"\0" + self.rgba[at : at + row] for at in range(0, len(self.rgba), row)]
        header = struct.pack(">2I5B", self.width, self.height, 8, 6, 0, 0, 0)
        return b"".join(
            (
                b"\x89PNG\r\n\x1a\n",
                _chunk(b"IHDR", header),
                _chunk(b"sRGB", b"\0"),
                _chunk(b"IDAT", zlib.compress(b"".join(lines), 6)),
                _chunk(b"IEND", b""),
            )
        )

    def save(self, path: Union[str, Path]) -> None:
        """Writes the picture as a PNG file.

        :raises OSError: the file cannot be written.
        """
        Path(path).write_bytes(self.to_png())

    def _repr_png_(self) -> bytes:
        return self.to_png()


@dataclass(frozen=True)
class Capture:
    """One frame, as all channels showed it."""

    #: The frame of the screens.
    frame: int
    #: One for each screen, in the wall's order; dark behind bezels and where a channel is missing.
    screens: List[Image]
    #: One for each channel that sent a picture, if they were asked for.
    channels: List[Image]
    #: The channels that sent none, by name, each with the reason.
    missing: List[Tuple[str, str]]

    def screen(self, name: str) -> Image:
        """Returns the picture of a screen.

        :raises KeyError: there is none of this name.
        """
        return _named(self.screens, name, "screen")

    def channel(self, name: str) -> Image:
        """Returns the picture of a channel.

        :raises KeyError: there is none of this name.
        """
        return _named(self.channels, name, "channel")

    def _repr_html_(self) -> str:
        parts = [f"<p>frame {self.frame}</p>"]
        for image in [*self.screens, *self.channels]:
            parts.append(figure(image.name, "image/png", image.to_png()))
        parts.extend(
            f"<p>{html.escape(name)} is missing: {html.escape(reason)}</p>"
            for name, reason in self.missing
        )
        return "".join(parts)

    def _repr_png_(self) -> Optional[bytes]:
        return self.screens[0].to_png() if len(self.screens) == 1 else None


def figure(caption: str, content_type: str, picture: bytes) -> str:
    """Returns a picture with its caption, as HTML that needs nothing else."""
    data = base64.b64encode(picture).decode("ascii")
    name = html.escape(caption)
    style = "display:inline-block;margin:4px"
    return (
        f'<figure style="{style}"><img alt="{name}" src="data:{content_type};base64,{data}">'
        f"<figcaption>{name}</figcaption></figure>"
    )


def _named(images: Sequence[Image], name: str, kind: str) -> Image:
    for image in images:
        if image.name == name:
            return image
    known = ", ".join(image.name for image in images) or "none"
    raise KeyError(f"no picture of {kind} {name!r}; there are: {known}")


def _chunk(name: bytes, data: bytes) -> bytes:
    check = zlib.crc32(name + data)
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", check)
