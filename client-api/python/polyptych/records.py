"""JSON to dataclasses and back: the wire's types are declared once, as the fields of classes.

Members that a class does not have are left out, so that a manager may say more than this package
knows. Classes that stand otherwise in JSON have ``from_json`` and ``to_json``.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from enum import Enum
from typing import (
    Any,
    Dict,
    List,
    Tuple,
    Type,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

#: The path of a file on the manager's machine.
FilePath = Union[str, "os.PathLike[str]"]

Vec2 = Tuple[float, float]
Vec3 = Tuple[float, float, float]
Quat = Tuple[float, float, float, float]

T = TypeVar("T")


class Mismatch(Exception):
    """A value is not of the type that was expected; the text names the place."""


def decode(kind: Type[T], value: Any, where: str = "answer") -> T:
    """Returns a JSON value as a value of a type.

    :raises Mismatch: it is of another type.
    """
    decoded: T = _decode(kind, value, where)
    return decoded


def encode(value: Any) -> Any:
    """Returns a value as JSON has it: dataclasses as objects, arrays and tuples as lists, paths as
    text.

    :raises ValueError: a number is NaN or infinite, which JSON does not have.
    """
    if hasattr(value, "to_json"):
        return encode(value.to_json())
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} is not finite; give finite numbers")
        return float(value)
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return {name: encode(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {str(name): encode(member) for name, member in value.items()}
    if hasattr(value, "tolist"):
        return encode(value.tolist())
    if isinstance(value, (list, tuple)):
        return [encode(member) for member in value]
    raise TypeError(f"{value!r} is no value of a request")


def _decode(kind: Any, value: Any, where: str) -> Any:
    if kind is Any:
        return value
    origin = get_origin(kind)
    if origin is Union:
        inner = [of for of in get_args(kind) if of is not type(None)]
        return None if value is None else _decode(inner[0], value, where)
    if origin is list:
        (inner_kind,) = get_args(kind)
        members = _list(value, where)
        return [_decode(inner_kind, of, f"{where}[{at}]") for at, of in enumerate(members)]
    if origin is tuple:
        kinds, members = get_args(kind), _list(value, where)
        if len(kinds) != len(members):
            raise Mismatch(f"{where} has {len(members)} members, not {len(kinds)}")
        return tuple(_decode(of, member, where) for of, member in zip(kinds, members))
    if origin is dict:
        inner_kind = get_args(kind)[1]
        given = _dict(value, where)
        return {name: _decode(inner_kind, of, f"{where}.{name}") for name, of in given.items()}
    if hasattr(kind, "from_json"):
        return kind.from_json(value, where)
    if dataclasses.is_dataclass(kind):
        return decode_fields(kind, value, where)
    return _decode_plain(kind, value, where)


def decode_fields(kind: Any, value: Any, where: str) -> Any:
    """Returns an object of JSON as a dataclass.

    :raises Mismatch: a member is missing, or of another type.
    """
    members, given = _dict(value, where), {}
    for name, (field_kind, is_required) in _fields(kind).items():
        if name in members:
            given[name] = _decode(field_kind, members[name], f"{where}.{name}")
        elif is_required:
            raise Mismatch(f"{where} has no {name}")
    return kind(**given)


def _decode_plain(kind: Any, value: Any, where: str) -> Any:
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            known = ", ".join(str(member.value) for member in kind)
            raise Mismatch(f"{where} is {value!r}, not one of {known}") from None
    if kind is float and value is None:
        # JSON has no NaN.
        return math.nan
    if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise Mismatch(f"{where} is {value!r}, no {kind.__name__}")
    return value


@functools.lru_cache(maxsize=None)
def _fields(kind: Any) -> Dict[str, Tuple[Any, bool]]:
    hints = get_type_hints(kind)
    found: Dict[str, Tuple[Any, bool]] = {}
    for field in dataclasses.fields(kind):
        has_default = (
            field.default is not dataclasses.MISSING
            or field.default_factory is not dataclasses.MISSING
        )
        found[field.name] = (hints[field.name], not has_default)
    return found


def _list(value: Any, where: str) -> List[Any]:
    if not isinstance(value, list):
        raise Mismatch(f"{where} is {value!r}, no list")
    return value


def _dict(value: Any, where: str) -> Dict[str, Any]:
    if not isinstance(value, dict):
        raise Mismatch(f"{where} is {value!r}, no object")
    return value
