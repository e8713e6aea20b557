// The camera: orbits around what is in the middle of the wall, or flies with the viewer.

import { act, presentation } from "./requests.js";
import { around, normalized, product, rotated } from "./quaternion.js";
import { byId, on, state } from "./state.js";

/** Metres of the wall's room that one press of a key flies. */
const FLY_STEP_M = 0.25;

const isFlying = () => byId("fly").getAttribute("aria-pressed") === "true";

/** The middle of the first screen, in the wall's room: what orbits turn around. */
function pivotInRoom() {
  const { wall } = state;
  const surface = wall.screens[0].surface;
  const plane = surface.Plane ?? surface;
  if (plane?.lower_right && plane?.upper_left) {
    return plane.lower_right.map((part, i) => (part + plane.upper_left[i]) / 2);
  }
  return [wall.eye[0], wall.eye[1], wall.eye[2] - 1];
}

/** A camera turned, shifted (in metres of the room: right, up, back) or scaled around a point. */
function moved(camera, { turn, shift, zoom, pivot }) {
  const at = rotated(camera.rotation, pivot.map((part) => part * camera.scale))
    .map((part, i) => part + camera.position[i]);
  let { rotation, scale } = camera;
  let center = at;
  if (turn) {
    const right = rotated(rotation, [1, 0, 0]);
    rotation = product(around([0, 1, 0], turn[0]), product(around(right, turn[1]), rotation));
    rotation = normalized(rotation);
  }
  if (shift) {
    const by = rotated(rotation, shift.map((part) => part * scale));
    center = at.map((part, i) => part + by[i]);
  }
  if (zoom) scale *= zoom;
  const back = rotated(rotation, pivot.map((part) => part * scale));
  return { position: center.map((part, i) => part - back[i]), rotation, scale };
}

/** The moves that no frame has shown yet. */
const moves = [];
let isSending = false;

/** Moves the wall's camera. Moves that come while a frame is drawn make one camera. */
async function move(change) {
  if (!state.wall) return;
  moves.push({ ...change, isFlight: isFlying() });
  if (isSending) return;
  isSending = true;
  while (moves.length) {
    const shown = await presentation();
    const asked = moves.splice(0);
    if (!shown) continue;
    // A flight turns about the viewer, wherever they stand: a tracked one need not be at the eye.
    const pivotOf = ({ isFlight }) => isFlight ? shown.head.position : pivotInRoom();
    const put = (camera, change) => moved(camera, { ...change, pivot: pivotOf(change) });
    const frame = { camera: asked.reduce(put, shown.camera), keeps_time: true };
    await act("POST", "/api/v1/frame", frame);
  }
  isSending = false;
}

/** One finger or the mouse turns; two fingers shift and zoom. */
function drag(stage) {
  const pointers = new Map();
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  stage.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    // The page was not told of its release, as over a menu of the browser.
    if (!event.buttons) {
      pointers.delete(event.pointerId);
      return;
    }
    const now = [event.clientX, event.clientY];
    const size = Math.max(stage.clientWidth, 1);
    const [dx, dy] = [(now[0] - before[0]) / size, (now[1] - before[1]) / size];
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    pointers.set(event.pointerId, now);
    if (others.length) {
      const apart = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
      const zoom = apart(before) / Math.max(apart(now), 1);
      move(isFlying()
        ? { shift: [-dx, dy, 4 * (zoom - 1)] } : { shift: [-dx, dy, 0], zoom });
    } else if (event.shiftKey || event.buttons !== 1) {
      move({ shift: [-2 * dx, 2 * dy, 0] });
    } else {
      const sense = isFlying() ? 2 : -4;
      move({ turn: [sense * dx, sense * dy] });
    }
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    stage.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
}

const ORBIT_KEYS = {
  ArrowLeft: { turn: [-0.1, 0] }, ArrowRight: { turn: [0.1, 0] },
  ArrowUp: { turn: [0, -0.1] }, ArrowDown: { turn: [0, 0.1] },
  "+": { zoom: 0.9 }, "-": { zoom: 1.1 },
};
const FLY_KEYS = {
  ArrowLeft: { turn: [0.1, 0] }, ArrowRight: { turn: [-0.1, 0] },
  ArrowUp: { shift: [0, 0, -FLY_STEP_M] }, ArrowDown: { shift: [0, 0, FLY_STEP_M] },
  w: { shift: [0, 0, -FLY_STEP_M] }, s: { shift: [0, 0, FLY_STEP_M] },
  a: { shift: [-FLY_STEP_M, 0, 0] }, d: { shift: [FLY_STEP_M, 0, 0] },
  e: { shift: [0, FLY_STEP_M, 0] }, q: { shift: [0, -FLY_STEP_M, 0] },
  "+": { zoom: 1.1 }, "-": { zoom: 0.9 },
};

/** Lets pointers, the wheel and keys over the picture move the camera. */
export function steer() {
  const stage = byId("stage");
  drag(stage);
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    const sense = Math.sign(event.deltaY);
    move(isFlying() ? { shift: [0, 0, FLY_STEP_M * sense] } : { zoom: Math.exp(sense * 0.1) });
  }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    const change = (isFlying() ? FLY_KEYS : ORBIT_KEYS)[event.key];
    if (!change || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    move(change);
  });
  for (const [id, other] of [["orbit", "fly"], ["fly", "orbit"]]) {
    on(id, "click", () => {
      byId(id).setAttribute("aria-pressed", "true");
      byId(other).setAttribute("aria-pressed", "false");
    });
  }
}
