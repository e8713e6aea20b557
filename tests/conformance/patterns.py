"""Patterns of answers and facts of pictures, as README.md describes them."""

from __future__ import annotations

import math
import re
from typing import Any, List, Sequence

_SHARE = 1e-9


def differences(pattern: Any, value: Any, where: str = "answer") -> List[str]:
    """Returns where a value is not as its pattern says, a sentence each."""
    if isinstance(pattern, str) and pattern == "*":
        return [] if value is not None else [f"{where} is nothing"]
    if isinstance(pattern, str) and pattern.startswith("~"):
        if isinstance(value, str) and any(part in value for part in pattern[1:].split("|")):
            return []
        return [f"{where} is {value!r}, not like {pattern[1:]!r}"]
    if pattern == "#16":
        is_hex = isinstance(value, str) and re.fullmatch("[0-9a-f]{16}", value)
        return [] if is_hex else [f"{where} is {value!r}, no 16 hexadecimal digits"]
    if isinstance(pattern, dict):
        if not isinstance(value, dict):
            return [f"{where} is {value!r}, no object"]
        found: List[str] = []
        for name, inner in pattern.items():
            if name not in value:
                found.append(f"{where} has no {name}")
            else:
                found.extend(differences(inner, value[name], f"{where}.{name}"))
        return found
    if isinstance(pattern, list):
        if not isinstance(value, list) or len(value) != len(pattern):
            return [f"{where} is {value!r}, no list of {len(pattern)}"]
        pairs = enumerate(zip(pattern, value))
        return [text for at, (a, b) in pairs for text in differences(a, b, f"{where}[{at}]")]
    return [] if _is_same(pattern, value) else [f"{where} is {value!r}, not {pattern!r}"]


def _is_same(pattern: Any, value: Any) -> bool:
    if isinstance(pattern, bool) or isinstance(value, bool) or not _are_numbers(pattern, value):
        return type(pattern) is type(value) and bool(pattern == value)
    return math.isclose(pattern, value, rel_tol=_SHARE, abs_tol=_SHARE)


def _are_numbers(*values: Any) -> bool:
    return all(isinstance(value, (int, float)) for value in values)


def picture_differences(facts: Any, width: int, height: int, rgba: bytes) -> List[str]:
    """Returns which facts do not hold of a picture, a sentence each."""
    if facts["size"] != [width, height] or len(rgba) != 4 * width * height:
        return [f"the picture has {width} x {height} pixels in {len(rgba)} bytes"]
    found = []
    for x, y, color, tolerance in facts["pixels"]:
        at = 4 * (y * width + x)
        seen = list(rgba[at : at + 3])
        if not _is_near(seen, color, tolerance):
            found.append(f"pixel {x}, {y} is {seen}, not {color} within {tolerance}")
    return found


def _is_near(seen: Sequence[int], wanted: Sequence[int], tolerance: int) -> bool:
    return all(abs(a - b) <= tolerance for a, b in zip(seen, wanted))
