// Alignment of one channel: its corners, bend and blends are dragged on its own picture, or moved
// by arrow keys. The point that is being moved is lit on the display.

import { changesTo, handlesOf } from "./handles.js";
import { displayFromUpright, displaySize, uprightShift } from "./hanging.js";
import { act, read } from "./requests.js";
import { add, byId, on, state } from "./state.js";

/** Pictures of the channel are taken this often while nothing moves, in milliseconds. */
const PICTURE_PERIOD_MS = 1500;
const PICTURE_WIDTH = 960;
const UNDO_MAX = 200;
/** Time between two looks whether all changes were sent, in milliseconds. */
const SEND_LOOK_MS = 20;

/** The channel as it is being changed; null while none is. */
let channel = null;
/** Its adjustment at the beginning, and the pattern that there was. */
let first = null;
let patternBefore = null;
/** Changes that lead back, the last one last. */
let undone = [];
/** Changes that wait to be sent, the last one of each key. */
let waiting = new Map();
let isSending = false;
let isLoading = false;

const path = () => `/api/v1/channels/${encodeURIComponent(channel.name)}`;

/** Sends what waits; of a point that moves fast only its last place. */
async function send() {
  if (isSending) return;
  isSending = true;
  try {
    let isStale = false;
    while (channel && (waiting.size || isStale)) {
      if (!waiting.size) {
        isStale = !await readAgain();
        continue;
      }
      const changes = [...waiting.values()];
      waiting = new Map();
      const done = await act("POST", `${path()}/calibration`, { changes });
      // A picture that would be folded is refused: it stays as it was.
      isStale ||= done === undefined;
      loadPicture();
    }
  } finally {
    isSending = false;
  }
}

/** Takes the channel as the wall has it. Returns false if a point was moved meanwhile, which is
 *  newer: its button may be in the hand. */
async function readAgain() {
  const of = channel;
  const wall = await read("/api/v1/wall");
  if (waiting.size) return false;
  const found = wall?.channels.find(({ name }) => name === of?.name);
  if (!found || channel !== of) return true;
  state.wall = wall;
  channel = structuredClone(found);
  placeHandles();
  return true;
}

async function loadPicture() {
  if (isLoading || !channel) return;
  isLoading = true;
  try {
    const answer = await fetch(`${path()}.jpg?width=${PICTURE_WIDTH}`);
    if (answer.ok && channel) {
      const image = byId("align-picture");
      const old = image.src;
      image.src = URL.createObjectURL(await answer.blob());
      if (old) URL.revokeObjectURL(old);
    }
  } catch { /* The manager is away; the health line says so. */ }
  isLoading = false;
}

function place(button, handle) {
  const [x, y] = displayFromUpright(channel, handle.at());
  const [width, height] = displaySize(channel);
  button.style.left = `${100 * x / width}%`;
  button.style.top = `${100 * y / height}%`;
  const [dx, dy] = handle.offset();
  const where = handle.isAutomatic?.() ? "automatic" : `${dx.toFixed(2)}, ${dy.toFixed(2)} pixels`;
  button.setAttribute("aria-label", `${handle.label}: ${where}`);
}

function remember(changes) {
  undone.push(changes);
  if (undone.length > UNDO_MAX) undone.shift();
  byId("align-undo").disabled = false;
}

/** Moves a handle to an offset, here at once and on the wall as soon as it can be. */
function move(button, handle, to) {
  handle.put(to);
  place(button, handle);
  waiting.set(handle.label, handle.change(to));
  send();
}

const before = (handle) =>
  handle.change(handle.isAutomatic?.() ? null : handle.offset());

function dragHandle(button, handle) {
  let began = null;
  button.addEventListener("pointerdown", (event) => {
    button.setPointerCapture(event.pointerId);
    const at = [event.clientX, event.clientY];
    began = { at, offset: handle.offset(), changes: [before(handle)] };
  });
  button.addEventListener("pointermove", (event) => {
    if (!began) return;
    const pixels = displaySize(channel)[0] / Math.max(byId("align-stage").clientWidth, 1);
    const shift = uprightShift(channel, [
      (event.clientX - began.at[0]) * pixels, (event.clientY - began.at[1]) * pixels,
    ]);
    if (!shift[0] && !shift[1]) return;
    if (began.changes) remember(began.changes);
    began.changes = null;
    move(button, handle, [began.offset[0] + shift[0], began.offset[1] + shift[1]]);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    button.addEventListener(end, () => { began = null; });
  }
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function keyHandle(button, handle) {
  button.addEventListener("keydown", (event) => {
    const step = Number(byId("align-step").value);
    const arrow = ARROWS[event.key];
    if (!arrow) return;
    event.preventDefault();
    const [dx, dy] = uprightShift(channel, arrow.map((part) => part * step));
    const offset = handle.offset();
    remember([before(handle)]);
    move(button, handle, [offset[0] + dx, offset[1] + dy]);
  });
}

/** Puts a button on each point that can be moved. */
function placeHandles() {
  const focused = document.activeElement?.dataset.handle;
  const area = byId("align-handles");
  area.replaceChildren();
  for (const handle of handlesOf(channel)) {
    const button = add(area, "button", { type: "button", className: `handle ${handle.kind}` });
    button.dataset.handle = handle.label;
    place(button, handle);
    dragHandle(button, handle);
    keyHandle(button, handle);
    button.addEventListener("focus", () => {
      byId("align-active").textContent = handle.label;
      act("PUT", "/api/v1/marker", { marker: { channel: channel.name, point: handle.point } })
        .then(loadPicture);
    });
    if (handle.label === focused) button.focus();
  }
  const [width, height] = displaySize(channel);
  byId("align-picture").style.aspectRatio = `${width} / ${height}`;
  byId("align-bend").value = channel.adjustment.bend
    ? channel.adjustment.bend.points.join("x") : "";
}

async function apply(changes) {
  waiting = new Map();
  if (await act("POST", `${path()}/calibration`, { changes }) === undefined) return;
  await readAgain();
  loadPicture();
}

async function begin() {
  const name = byId("align-channel").value;
  const wall = await read("/api/v1/wall");
  if (!wall || channel) return;
  state.wall = wall;
  channel = structuredClone(wall.channels.find((of) => of.name === name));
  first = structuredClone(channel.adjustment);
  patternBefore = state.status?.presentation.pattern ?? null;
  [undone, waiting] = [[], new Map()];
  byId("align").hidden = false;
  byId("align-begin").disabled = byId("align-channel").disabled = true;
  byId("align-undo").disabled = true;
  placeHandles();
  await act("PUT", "/api/v1/pattern", { pattern: "grid" });
  loadPicture();
}

async function end() {
  // The last place of a point may still wait for the one before.
  while (isSending) await new Promise((done) => setTimeout(done, SEND_LOOK_MS));
  if (!channel) return;
  channel = null;
  byId("align").hidden = true;
  byId("align-begin").disabled = byId("align-channel").disabled = false;
  await act("PUT", "/api/v1/marker", { marker: null });
  await act("PUT", "/api/v1/pattern", { pattern: patternBefore });
}

/** Lets the controls of the alignment work. */
export function startAlignment() {
  state.wall.channels.forEach(({ name }) =>
    byId("align-channel").append(new Option(name, name)));
  on("align-begin", "click", begin);
  on("align-undo", "click", () => {
    const changes = undone.pop();
    byId("align-undo").disabled = !undone.length;
    if (changes) apply(changes);
  });
  on("align-revert", "click", () => {
    undone = [];
    byId("align-undo").disabled = true;
    apply(changesTo(first));
  });
  on("align-keep", "click", end);
  on("align-bend", "change", () => {
    const value = byId("align-bend").value;
    remember(changesTo(channel.adjustment));
    apply([{ Grid: value ? value.split("x").map(Number) : null }]);
  });
  setInterval(() => document.hidden || loadPicture(), PICTURE_PERIOD_MS);
}
