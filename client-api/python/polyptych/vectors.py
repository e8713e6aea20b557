"""Vectors and quaternions as tuples of floats, for programs without numpy."""

from __future__ import annotations

import math
from typing import Any, Optional, Sequence

from .records import Quat, Vec3

NO_ROTATION: Quat = (0.0, 0.0, 0.0, 1.0)


def vec3(value: Sequence[float]) -> Vec3:
    """Returns three numbers as a tuple; takes lists, tuples and numpy arrays.

    :raises ValueError: there are more or fewer.
    """
    x, y, z = value
    return float(x), float(y), float(z)


def add(a: Vec3, b: Vec3) -> Vec3:
    """Returns a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Returns a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Vec3, by: float) -> Vec3:
    """Returns a times a number."""
    return a[0] * by, a[1] * by, a[2] * by


def dot(a: Vec3, b: Vec3) -> float:
    """Returns the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Returns the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def length(a: Vec3) -> float:
    """Returns the length."""
    return math.sqrt(dot(a, a))


def normalized(a: Vec3) -> Optional[Vec3]:
    """Returns the vector of length 1 in the same direction; ``None`` where there is none."""
    long = length(a)
    if not (long > 0.0 and math.isfinite(long)):
        return None
    return scaled(a, 1.0 / long)


def rotated(rotation: Quat, v: Vec3) -> Vec3:
    """Returns a vector that is turned by a unit quaternion (x, y, z, w)."""
    axis: Vec3 = rotation[:3]
    twice = scaled(cross(axis, v), 2.0)
    return add(add(v, scaled(twice, rotation[3])), cross(axis, twice))


def product(a: Quat, b: Quat) -> Quat:
    """Returns the rotation that turns by b and then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def about(axis: Vec3, angle_rad: float) -> Quat:
    """Returns the rotation about an axis of length 1, counterclockwise as seen from its end."""
    sine = math.sin(angle_rad / 2.0)
    return axis[0] * sine, axis[1] * sine, axis[2] * sine, math.cos(angle_rad / 2.0)


def unit(rotation: Quat) -> Quat:
    """Returns a quaternion of length 1."""
    long = math.sqrt(sum(part * part for part in rotation))
    x, y, z, w = (part / long for part in rotation)
    return x, y, z, w


def from_axes(right: Vec3, up: Vec3, backward: Vec3) -> Quat:
    """Returns the rotation whose matrix has these columns, which are at right angles.

    K. Shoemake, *Quaternion calculus for animation*, 1991: divides by the largest part.
    """
    (m00, m10, m20), (m01, m11, m21), (m02, m12, m22) = right, up, backward
    parts = (
        (1.0 + m00 - m11 - m22, (0, m01 + m10, m02 + m20, m21 - m12)),
        (1.0 - m00 + m11 - m22, (m01 + m10, 0, m12 + m21, m02 - m20)),
        (1.0 - m00 - m11 + m22, (m02 + m20, m12 + m21, 0, m10 - m01)),
        (1.0 + m00 + m11 + m22, (m21 - m12, m02 - m20, m10 - m01, 0)),
    )
    at = max(range(4), key=lambda index: parts[index][0])
    square, others = parts[at]
    numbers = [float(other) for other in others]
    numbers[at] = square
    long = 2.0 * math.sqrt(square)
    x, y, z, w = (number / long for number in numbers)
    return unit((x, y, z, w))


def transform(value: Any) -> Sequence[float]:
    """Returns a transform as the wire has it: the columns of 3 x 3, then the translation.

    Takes a matrix of 3 x 4 or 4 x 4 in rows, a numpy array of that shape, or the 12 numbers.

    :raises ValueError: it has another shape.
    """
    rows = value.tolist() if hasattr(value, "tolist") else list(value)
    if len(rows) == 12:
        return [float(number) for number in rows]
    is_matrix = len(rows) in (3, 4) and all(
        hasattr(row, "__len__") and len(row) == 4 for row in rows
    )
    if not is_matrix:
        raise ValueError("a transform is a matrix of 3 x 4 or 4 x 4 in rows, or 12 numbers")
    return [float(rows[row][column]) for column in range(4) for row in range(3)]


def placed(
    translation: Sequence[float] = (0.0, 0.0, 0.0),
    rotation: Sequence[float] = NO_ROTATION,
    scale: float = 1.0,
) -> Sequence[float]:
    """Returns the transform of a translation, a unit quaternion (x, y, z, w) and a scale."""
    x, y, z, w = rotation
    turn = unit((float(x), float(y), float(z), float(w)))
    axes = [rotated(turn, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    columns = [scaled(axis, scale) for axis in axes]
    return [number for column in [*columns, vec3(translation)] for number in column]
