// Quaternions as x, y, z, w.

export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];

export function rotated([x, y, z, w], v) {
  const t = cross([x, y, z], v).map((part) => 2 * part);
  const u = cross([x, y, z], t);
  return v.map((part, i) => part + w * t[i] + u[i]);
}

export function product([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
  ];
}

export function around(axis, angle) {
  return [...axis.map((part) => part * Math.sin(angle / 2)), Math.cos(angle / 2)];
}

/** The same turn with a length of 1. */
export function normalized(q) {
  const length = Math.hypot(...q);
  return q.map((part) => part / length);
}
