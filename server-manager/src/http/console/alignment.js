// Alignment of one channel: its corners, bend and blends are dragged on its own picture, or moved
// by arrow keys. The point that is being moved is lit on the display.

import { changesTo, handlesOf } from "./handles.js";
import { displayFromUpright, displaySize, uprightShift } from "./hanging.js";
import { act, log, read } from "./requests.js";
import { add, byId, fill, on, state } from "./state.js";

/** Pictures of the channel are taken this often while nothing moves, in milliseconds. */
const PICTURE_PERIOD_MS = 1500;
const PICTURE_WIDTH = 960;
const UNDO_MAX = 200;

/** The channel as it is being changed; null while none is. */
let channel = null;
/** Its adjustment at the beginning. */
let first = null;
/** Changes that lead back, the last one last. */
let undone = [];
/** Changes that wait to be sent, the last one of each key. */
let waiting = new Map();
/** The wall may have the channel otherwise than the page shows it. */
let isStale = false;
let isLoading = false;
/** The buttons on the picture, each with its handle. */
let shown = [];
/** The last picture was refused, which was said. */
let isRefused = false;
/** The end of all work that has been begun, and how much of it is not done. */
let turn = Promise.resolve();
let turns = 0;

const path = () => `/api/v1/channels/${encodeURIComponent(channel.name)}`;

/** Does work after all that came before it. The browser has several connections, so that an undo
 *  could otherwise be done before the move that it takes back. */
function inTurn(work) {
  turns += 1;
  turn = turn.then(work, work).finally(() => { turns -= 1; });
  return turn;
}

/** Takes the changes that wait; of a point that moves fast only its last place. */
function takeWaiting() {
  const changes = [...waiting.values()];
  waiting = new Map();
  return changes;
}

/** Sends changes, and reads the channel again where that is due. Returns whether they were made. */
async function send(changes) {
  if (!channel) return false;
  let isDone = true;
  if (changes.length) {
    isDone = await act("POST", `${path()}/calibration`, { changes }) !== undefined;
    // A picture that would be folded is refused: it stays as it was.
    if (!isDone) isStale = true;
    loadPicture();
  }
  if (isStale && turns === 1) await readAgain();
  return isDone;
}

/** Takes the channel as the wall has it, unless a point was moved meanwhile: that is newer, and its
 *  button may be in the hand. */
async function readAgain() {
  const wall = await read("/api/v1/wall");
  const found = wall?.channels.find(({ name }) => name === channel.name);
  if (!found || turns > 1) return;
  isStale = false;
  state.wall = wall;
  channel = structuredClone(found);
  placeHandles();
}

async function loadPicture() {
  if (isLoading || !channel) return;
  isLoading = true;
  try {
    const answer = await fetch(`${path()}.jpg?width=${PICTURE_WIDTH}`);
    if (!answer.ok) {
      const { error } = await answer.json();
      if (!isRefused) log(`no picture of the channel: ${error}`, true);
      isRefused = true;
    } else if (channel) {
      isRefused = false;
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
function move(handle, to) {
  handle.put(to);
  // Pins and bend move other points, too.
  shown.forEach((of) => place(...of));
  waiting.set(handle.label, handle.change(to));
  inTurn(() => send(takeWaiting()));
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
    // The page was not told of its release, as over a menu of the browser.
    if (!event.buttons) began = null;
    if (!began) return;
    const pixels = displaySize(channel)[0] / Math.max(byId("align-stage").clientWidth, 1);
    const shift = uprightShift(channel, [
      (event.clientX - began.at[0]) * pixels, (event.clientY - began.at[1]) * pixels,
    ]);
    const to = [began.offset[0] + shift[0], began.offset[1] + shift[1]];
    if ((!shift[0] && !shift[1]) || handle.staysAutomatic?.(to)) return;
    if (began.changes) remember(began.changes);
    began.changes = null;
    move(handle, to);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
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
    if (handle.isAutomatic?.()) {
      // From 0 on, most steps would end the picture hard where another one is.
      log(`${handle.label} is as wide as the overlap, by as many pixels as the page does not ` +
        "know; drag it to where the blend shall end, then press arrow keys");
      return;
    }
    const [dx, dy] = uprightShift(channel, arrow.map((part) => part * step));
    const offset = handle.offset();
    remember([before(handle)]);
    move(handle, [offset[0] + dx, offset[1] + dy]);
  });
}

/** Puts a button on each point that can be moved. */
function placeHandles() {
  const focused = document.activeElement?.dataset.handle;
  const area = byId("align-handles");
  area.replaceChildren();
  shown = [];
  for (const handle of handlesOf(channel)) {
    const button = add(area, "button", { type: "button", className: `handle ${handle.kind}` });
    button.dataset.handle = handle.label;
    shown.push([button, handle]);
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

/** Sends changes after the moves that wait, and shows what the wall made of them. Returns whether
 *  they were made. */
function apply(changes) {
  const all = [...takeWaiting(), ...changes];
  return inTurn(() => {
    isStale = true;
    return send(all);
  });
}

/** Takes back the steps from an index on, by these changes. If they fail, the steps stay. */
async function takeBack(from, changes) {
  const steps = undone.splice(from);
  byId("align-undo").disabled = !undone.length;
  if (await apply(changes)) return;
  undone.splice(from, 0, ...steps);
  byId("align-undo").disabled = !undone.length;
}

async function begin() {
  const name = byId("align-channel").value;
  const wall = await read("/api/v1/wall");
  if (!wall || channel) return;
  const found = wall.channels.find((of) => of.name === name);
  if (!found) {
    log(`the wall has no channel ${name} any more; choose another one`, true);
    return;
  }
  state.wall = wall;
  channel = structuredClone(found);
  first = structuredClone(channel.adjustment);
  [undone, waiting, isStale, isRefused] = [[], new Map(), false, false];
  byId("align").hidden = false;
  byId("align-begin").disabled = byId("align-channel").disabled = true;
  byId("align-undo").disabled = true;
  placeHandles();
  await act("PUT", "/api/v1/pattern", { pattern: "grid" });
  loadPicture();
}

async function end() {
  if (!channel) return;
  channel = null;
  byId("align").hidden = true;
  byId("align-begin").disabled = byId("align-channel").disabled = false;
  await act("PUT", "/api/v1/marker", { marker: null });
  await act("PUT", "/api/v1/pattern", { pattern: null });
}

/** Lists the wall's channels. */
export function listChannels() {
  fill("align-channel", state.wall.channels.map(({ name }) => name));
}

/** Lets the controls of the alignment work. */
export function startAlignment() {
  on("align-begin", "click", () => inTurn(begin));
  on("align-undo", "click", () => takeBack(undone.length - 1, undone.at(-1)));
  on("align-revert", "click", () => takeBack(0, changesTo(first)));
  on("align-keep", "click", () => inTurn(end));
  on("align-bend", "change", () => {
    const value = byId("align-bend").value;
    remember(changesTo(channel.adjustment));
    apply([{ Grid: value ? value.split("x").map(Number) : null }]);
  });
  setInterval(() => document.hidden || loadPicture(), PICTURE_PERIOD_MS);
}
