// The points of a channel that calibration moves: corners, points of the bend, and edges.

const CORNERS = [
  ["upper-left", [0, 0]], ["upper-right", [1, 0]], ["lower-left", [0, 1]], ["lower-right", [1, 1]],
];
const EDGES = [
  ["left", [0, 0.5], [1, 0]], ["right", [1, 0.5], [-1, 0]],
  ["top", [0.5, 0], [0, 1]], ["bottom", [0.5, 1], [0, -1]],
];

const plus = (a, b) => [a[0] + b[0], a[1] + b[1]];
const times = (a, b) => [a[0] * b[0], a[1] * b[1]];

const clamp = (value, most) => Math.min(Math.max(value, 0), most);

/** Returns the pixel to which the pins move a place of the picture, (0, 0) to (1, 1). */
function pinned({ size, adjustment: { pin } }, [u, v]) {
  const [a, b, c, d] = CORNERS.map(([, place], index) => plus(times(place, size), pin[index]));
  const minus = (p, q) => [p[0] - q[0], p[1] - q[1]];
  const cross = (p, q) => p[0] * q[1] - p[1] * q[0];
  const [sum, right, lower] = [minus(plus(a, d), plus(b, c)), minus(b, d), minus(c, d)];
  const area = cross(right, lower);
  const [g, h] = [cross(sum, lower) / area, cross(right, sum) / area];
  return a.map((at, axis) => {
    const [along, down] = [b[axis] * (1 + g) - at, c[axis] * (1 + h) - at];
    return (at + u * along + v * down) / (1 + g * u + h * v);
  });
}

/** Returns weights of the four points around a place between the middle two: Catmull-Rom. */
const weights = (t) => [
  t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (-2.5 + 1.5 * t),
  t * (0.5 + t * (2 - 1.5 * t)), t * t * (-0.5 + 0.5 * t),
];

/** Returns the move of a point of the bend; beyond its edge it goes on as a line. */
function moveOf({ points: [columns, rows], moves }, column, row) {
  const line = (p, q) => [2 * p[0] - q[0], 2 * p[1] - q[1]];
  const along = (at, last, of) => {
    if (at < 0) return line(of(0), of(1));
    return at > last ? line(of(last), of(last - 1)) : of(at);
  };
  return along(row, rows - 1, (r) => along(column, columns - 1, (c) => moves[r * columns + c]));
}

/** Returns the pixel to which the bend moves one. */
function bent({ size, adjustment: { bend } }, pixel) {
  if (!bend) return pixel;
  const last = bend.points.map((count) => count - 1);
  const place = pixel.map((at, axis) => clamp(at / size[axis], 1) * last[axis]);
  const cell = place.map((at, axis) => Math.min(Math.floor(at), last[axis] - 1));
  const [across, down] = place.map((at, axis) => weights(at - cell[axis]));
  let found = pixel;
  down.forEach((y, row) => across.forEach((x, column) => {
    const by = moveOf(bend, cell[0] + column - 1, cell[1] + row - 1);
    found = plus(found, times(by, [x * y, x * y]));
  }));
  return found;
}

/** Returns the pixel nearest to one in the picture: there the display lights a mark beside it. */
const within = ({ size }, pixel) => pixel.map((at, axis) => clamp(at, size[axis]));

/** Returns the pixel at which the display lights a place of the picture, (0, 0) to (1, 1). */
const litAt = (channel, place) => within(channel, bent(channel, pinned(channel, place)));

/** A handle of a corner: its offset is where the corner was put, in pixels. */
function corner(channel, index) {
  const [name, place] = CORNERS[index];
  const { pin } = channel.adjustment;
  return {
    label: `Corner ${name}`, kind: "corner", point: { Corner: name },
    offset: () => pin[index],
    at: () => litAt(channel, place),
    put: (to) => { pin[index] = to; },
    change: (to) => ({ Pin: { corner: name, to: { To: to } } }),
  };
}

/** A handle of a point of the bend. */
function bendPoint(channel, column, row) {
  const { points: [columns, rows], moves } = channel.adjustment.bend;
  const index = row * columns + column;
  const place = [column / (columns - 1), row / (rows - 1)];
  return {
    label: `Bend point column ${column}, row ${row}`, kind: "bend",
    point: { Bend: { column, row } },
    offset: () => moves[index],
    at: () => within(channel, plus(times(place, channel.size), moves[index])),
    put: (to) => { moves[index] = to; },
    change: (to) => ({ Bend: { column, row, to: { To: to } } }),
  };
}

/** A handle of an edge: its offset is the width of the blend, along the way into the picture. */
function edge(channel, index) {
  const [name, place, inwards] = EDGES[index];
  const { edges } = channel.adjustment;
  const width = ([x, y]) => {
    const across = Math.abs(inwards[0] * channel.size[0] + inwards[1] * channel.size[1]);
    return clamp(x * inwards[0] + y * inwards[1], across);
  };
  return {
    label: `Blend at the ${name} edge`, kind: "edge", point: { Edge: name },
    offset: () => inwards.map((part) => part * (edges[name] ?? 0)),
    at: () => plus(litAt(channel, place), inwards.map((part) => part * (edges[name] ?? 0))),
    put: (to) => { edges[name] = to && width(to); },
    change: (to) => ({ Edge: { side: name, width: to && width(to) } }),
    isAutomatic: () => edges[name] === null,
    // Along the edge or out of the picture there is no width.
    staysAutomatic: (to) => edges[name] === null && width(to) === 0,
  };
}

/** Returns the handles of a channel's adjustment, which they change in place. */
export function handlesOf(channel) {
  const { bend } = channel.adjustment;
  const handles = [...CORNERS.keys()].map((index) => corner(channel, index));
  handles.push(...[...EDGES.keys()].map((index) => edge(channel, index)));
  for (let row = 0; row < (bend?.points[1] ?? 0); row += 1) {
    for (let column = 0; column < bend.points[0]; column += 1) {
      handles.push(bendPoint(channel, column, row));
    }
  }
  return handles;
}

/** Returns the changes that lead to an adjustment, whatever there is now. */
export function changesTo({ pin, bend, edges }) {
  const changes = CORNERS.map(([corner], index) => ({ Pin: { corner, to: { To: pin[index] } } }));
  changes.push({ Grid: bend ? bend.points : null });
  if (bend) {
    bend.moves.forEach((to, at) => {
      const [column, row] = [at % bend.points[0], Math.floor(at / bend.points[0])];
      changes.push({ Bend: { column, row, to: { To: to } } });
    });
  }
  return [...changes, ...EDGES.map(([side]) => ({ Edge: { side, width: edges[side] } }))];
}
