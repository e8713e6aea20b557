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

/** A handle of a corner: its offset is where the corner was put, in pixels. */
function corner(channel, index) {
  const [name, place] = CORNERS[index];
  const { pin } = channel.adjustment;
  return {
    label: `Corner ${name}`, kind: "corner", point: { Corner: name },
    offset: () => pin[index],
    at: () => plus(times(place, channel.size), pin[index]),
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
    at: () => plus(times(place, channel.size), moves[index]),
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
    return Math.min(Math.max(x * inwards[0] + y * inwards[1], 0), across);
  };
  return {
    label: `Blend at the ${name} edge`, kind: "edge", point: { Edge: name },
    offset: () => inwards.map((part) => part * (edges[name] ?? 0)),
    at: () => plus(times(place, channel.size), inwards.map((part) => part * (edges[name] ?? 0))),
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
