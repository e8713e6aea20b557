"use strict";
// The console: shows the wall as it is, and commands it. All that it does is in the HTTP interface.

const byId = (id) => document.getElementById(id);
const PICTURE_PERIOD_MS = 450;
const STATUS_TIME_MAX_MS = 1800;
const LOG_LINES_MAX = 200;
let wall = null;
let status = null;
let statusAt = 0;
let camera = null;
let aim = null;
let frameBefore = null;

// ---- Requests. Each shows the same as a line for curl.

function curlLine(method, path, body) {
  const quoted = (text) => "'" + text.replaceAll("'", "'\\''") + "'";
  const data = body === undefined ? "" :
    ` -H 'Content-Type: application/json' -d ${quoted(JSON.stringify(body))}`;
  return `curl -X ${method} -H "Authorization: Bearer $(polyptych login --token)"${data} ` +
    quoted(location.origin + path);
}

async function ask(method, path, body, isShown = true) {
  if (isShown) byId("curl").textContent = curlLine(method, path, body);
  const options = { method, headers: {} };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["Content-Type"] = "application/json";
  }
  const answer = await fetch(path, options);
  if (answer.status === 401) byId("login").hidden = false;
  const value = await answer.json();
  if (!answer.ok) {
    log(value.error, true);
    throw new Error(value.error);
  }
  return value;
}

const act = (method, path, body) => ask(method, path, body).catch((error) => error);
const redraw = () => act("POST", "/api/v1/frame", {});

function log(text, isBad = false) {
  const line = document.createElement("li");
  line.textContent = `${new Date().toLocaleTimeString()} ${text}`;
  if (isBad) line.style.color = "var(--bad)";
  const list = byId("log");
  list.prepend(line);
  while (list.children.length > LOG_LINES_MAX) list.lastChild.remove();
}

// ---- The state of channels.

/** What is wrong with a channel, or "". */
function fault(channel) {
  if (Date.now() - statusAt > STATUS_TIME_MAX_MS) return "no status";
  if (["lost", "late"].includes(channel.state)) return channel.state;
  const mode = status.presentation.output_mode;
  if (mode === "blank") return "black";
  if (mode === "freeze") return "frozen";
  const isMoving = frameBefore !== null && status.frame > frameBefore + 2;
  if (isMoving && channel.frame < frameBefore) return "frozen";
  if (channel.state === "live" && channel.revision !== status.revision && !status.opening.length) {
    return `revision ${channel.revision}`;
  }
  return "";
}

function kind(channel) {
  if (fault(channel)) return "bad";
  return ["joining", "preparing"].includes(channel.state) ? "wait" : "good";
}

function show() {
  if (!status) return;
  const bad = status.channels.filter((channel) => fault(channel));
  const health = byId("health");
  health.className = bad.length ? "bad" : "good";
  health.textContent = bad.length
    ? `${bad.length} of ${status.channels.length} channels: ` +
      bad.slice(0, 4).map((channel) => `${channel.name} ${fault(channel)}`).join(", ")
    : `all ${status.channels.length} channels are well, frame ${status.frame}`;
  const rows = status.channels.map((channel) => {
    const row = document.createElement("tr");
    row.className = kind(channel);
    row.title = channel.reason ?? "";
    const cells = [
      channel.name, fault(channel) || channel.state,
      channel.draw_us === null ? "–" : (channel.draw_us / 1000).toFixed(1), channel.late,
      `${channel.skew.p50_us} / ${channel.skew.p99_us}`, channel.skew.clock_error_us ?? "–",
      channel.frame,
    ];
    for (const text of cells) {
      const cell = document.createElement("td");
      cell.textContent = text;
      row.append(cell);
    }
    return row;
  });
  byId("table").replaceChildren(...rows);
  for (const channel of status.channels) {
    const box = byId(`channel-${channel.name}`);
    if (!box) continue;
    box.className = `channel ${kind(channel)}`;
    const ms = channel.draw_us === null ? "" : ` ${(channel.draw_us / 1000).toFixed(1)} ms`;
    box.firstChild.textContent = `${channel.name} ${fault(channel) || channel.state}${ms}`;
  }
  byId("scene-name").textContent = status.scene ?? "none";
  byId("clients").textContent = `Connected: ${status.clients.join(", ")}`;
  const [opening] = status.opening;
  byId("progress").hidden = !opening;
  if (opening) byId("progress").value = opening.progress.percent;
  const shown = status.presentation;
  for (const button of byId("modes").children) {
    button.setAttribute("aria-pressed", String(button.dataset.mode === shown.output_mode));
  }
  const idle = (id) => document.activeElement !== byId(id);
  if (idle("pattern")) byId("pattern").value = shown.pattern ?? "";
  if (idle("exposure")) byId("exposure").value = Math.log2(shown.exposure);
  byId("exposure-value").textContent = Math.log2(shown.exposure).toFixed(2);
  byId("automatic").checked = shown.is_exposure_automatic;
  if (idle("error")) byId("error").value = shown.bounds.error_px;
  byId("error-value").textContent = shown.bounds.error_px;
  if (idle("rate")) byId("rate").value = shown.bounds.rate_fps ?? "";
  if (!aim) camera = shown.camera;
}

/** Boxes over the picture, as channels hang on their screens. */
function placeChannels() {
  const sizes = wall.screens.map((screen) => screen.canvas);
  const width = sizes.reduce((sum, [x]) => sum + x, 0);
  const height = Math.max(...sizes.map(([, y]) => y));
  const boxes = wall.channels.map((channel) => {
    const left = sizes.slice(0, channel.screen).reduce((sum, [x]) => sum + x, 0);
    const box = document.createElement("div");
    box.id = `channel-${channel.name}`;
    box.className = "channel";
    box.style.left = `${100 * (left + channel.origin[0]) / width}%`;
    box.style.top = `${100 * channel.origin[1] / height}%`;
    box.style.width = `${100 * channel.size[0] / width}%`;
    box.style.height = `${100 * channel.size[1] / height}%`;
    box.append(document.createElement("span"));
    return box;
  });
  byId("channels").replaceChildren(...boxes);
  byId("picture").style.aspectRatio = `${width} / ${height}`;
  byId("wall-name").textContent = wall.name;
}

// ---- The live picture: one request at a time; the manager takes one capture for all browsers.

async function pictures() {
  for (;;) {
    const began = performance.now();
    if (!document.hidden) {
      const width = Math.min(1280, Math.round(byId("stage").clientWidth / 320 + 0.5) * 320);
      try {
        const answer = await fetch(`/api/v1/wall.jpg?width=${width}&max_age_ms=${PICTURE_PERIOD_MS}`);
        if (answer.ok) {
          const url = URL.createObjectURL(await answer.blob());
          const old = byId("picture").src;
          byId("picture").src = url;
          if (old) URL.revokeObjectURL(old);
        }
      } catch { /* The manager is away; the health line says so. */ }
    }
    const rest = PICTURE_PERIOD_MS - (performance.now() - began);
    await new Promise((done) => setTimeout(done, Math.max(rest, 50)));
  }
}

// ---- The camera: quaternions are x, y, z, w.

const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];

function rotated([x, y, z, w], v) {
  const t = cross([x, y, z], v).map((part) => 2 * part);
  const u = cross([x, y, z], t);
  return v.map((part, i) => part + w * t[i] + u[i]);
}

function product([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
  ];
}

function around(axis, angle) {
  return [...axis.map((part) => part * Math.sin(angle / 2)), Math.cos(angle / 2)];
}

/** The middle of the first screen, in the wall's room: what orbits turn around. */
function pivotInRoom() {
  const surface = wall.screens[0].surface;
  const plane = surface.Plane ?? surface;
  if (plane?.lower_right && plane?.upper_left) {
    return plane.lower_right.map((part, i) => (part + plane.upper_left[i]) / 2);
  }
  return [wall.eye[0], wall.eye[1], wall.eye[2] - 1];
}

function move(change) {
  if (!camera || !wall) return;
  const pivot = pivotInRoom();
  const at = rotated(camera.rotation, pivot.map((part) => part * camera.scale))
    .map((part, i) => part + camera.position[i]);
  let { rotation, scale } = camera;
  let center = at;
  if (change.turn) {
    const right = rotated(rotation, [1, 0, 0]);
    rotation = product(around([0, 1, 0], change.turn[0]), product(around(right, change.turn[1]), rotation));
    const length = Math.hypot(...rotation);
    rotation = rotation.map((part) => part / length);
  }
  if (change.pan) {
    const shift = rotated(rotation, [change.pan[0] * scale, change.pan[1] * scale, 0]);
    center = at.map((part, i) => part + shift[i]);
  }
  if (change.zoom) scale *= change.zoom;
  const back = rotated(rotation, pivot.map((part) => part * scale));
  camera = { position: center.map((part, i) => part - back[i]), rotation, scale };
  aim = camera;
  sendCamera();
}

let isSending = false;
async function sendCamera() {
  if (isSending) return;
  isSending = true;
  while (aim) {
    const sent = aim;
    await act("POST", "/api/v1/frame", { camera: sent });
    if (aim === sent) aim = null;
  }
  isSending = false;
}

function steer() {
  const stage = byId("stage");
  const pointers = new Map();
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  stage.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    pointers.set(event.pointerId, now);
    const size = Math.max(stage.clientWidth, 1);
    if (others.length) {
      const apart = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
      move({ zoom: apart(before) / Math.max(apart(now), 1) });
    } else if (event.shiftKey || event.buttons !== 1) {
      move({ pan: [-2 * dx / size, 2 * dy / size] });
    } else {
      move({ turn: [-4 * dx / size, -4 * dy / size] });
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    stage.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    move({ zoom: Math.exp(Math.sign(event.deltaY) * 0.1) });
  }, { passive: false });
  stage.tabIndex = 0;
  stage.setAttribute("role", "application");
  stage.setAttribute("aria-label", "Live wall: arrow keys orbit, plus and minus zoom");
  stage.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    const zooms = { "+": 0.9, "-": 1.1 };
    const change = event.key in turns ? { turn: turns[event.key] }
      : event.key in zooms ? { zoom: zooms[event.key] } : null;
    if (!change) return;
    event.preventDefault();
    move(change);
  });
}

// ---- Controls.

async function list(id, path, names) {
  // A wall that keeps no state has no lists of these.
  const values = await fetch(path).then((answer) => answer.ok ? answer.json() : []).catch(() => []);
  const options = names(values).map((name) => new Option(name, name));
  byId(id).replaceChildren(...options);
}

const listViews = () => list("views", "/api/v1/views", (all) => all.map((view) => view.name));
const listSaved = () => list("saved", "/api/v1/scene/saved", (all) => all.map((of) => of.name));
const viewPath = (name) => `/api/v1/views/${encodeURIComponent(name)}`;

function controls() {
  const on = (id, name, work) => byId(id).addEventListener(name, work);
  on("open-form", "submit", async (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    const body = { path: form.get("path"), keep_camera: form.get("keep_camera") === "on" };
    await act("POST", "/api/v1/scene/open", body);
  });
  on("close", "click", () => act("POST", "/api/v1/scene/close"));
  on("open-saved", "click", () => {
    if (byId("saved").value) act("POST", "/api/v1/scene/open", { path: `saved:${byId("saved").value}`, keep_camera: true });
  });
  on("show-view", "click", () => byId("views").value && act("POST", `${viewPath(byId("views").value)}/show`));
  on("remove-view", "click", async () => {
    if (byId("views").value) await act("DELETE", viewPath(byId("views").value));
    listViews();
  });
  on("store-form", "submit", async (event) => {
    event.preventDefault();
    await act("PUT", viewPath(new FormData(event.target).get("name")), {});
    event.target.reset();
    listViews();
  });
  for (const button of byId("modes").children) {
    button.addEventListener("click", () => act("PUT", "/api/v1/displays", { mode: button.dataset.mode }));
  }
  on("pattern", "change", () => act("PUT", "/api/v1/pattern", { pattern: byId("pattern").value || null }));
  const then = async (path, body) => {
    await act("PUT", path, body);
    const line = byId("curl").textContent;
    await redraw();
    byId("curl").textContent = line;
  };
  on("exposure", "change", () => then("/api/v1/exposure", { stops: Number(byId("exposure").value) }));
  on("automatic", "change", () => then("/api/v1/exposure", byId("automatic").checked
    ? { is_automatic: true } : { stops: Number(byId("exposure").value) }));
  const bounds = () => then("/api/v1/bounds", {
    error_px: Number(byId("error").value),
    rate_fps: byId("rate").value ? Number(byId("rate").value) : null,
  });
  on("error", "change", bounds);
  on("rate", "change", bounds);
  on("set-pace", "click", () => {
    const pace = byId("pace").value;
    act("PUT", "/api/v1/pace", pace === "free" ? { is_free: true } : pace ? { rate: Number(pace) } : {});
  });
}

// ---- Events.

function listen() {
  const events = new EventSource("/api/v1/events");
  events.addEventListener("status", (event) => {
    frameBefore = status?.frame ?? null;
    status = JSON.parse(event.data);
    statusAt = Date.now();
    byId("login").hidden = true;
    show();
  });
  events.addEventListener("log", (event) => {
    log(JSON.parse(event.data).text);
  });
  events.onerror = () => show();
}

async function start() {
  steer();
  controls();
  setInterval(show, 500);
  try {
    wall = await ask("GET", "/api/v1/wall", undefined, false);
  } catch {
    byId("health").className = "bad";
    byId("health").textContent = "the manager does not let this page in";
    return;
  }
  placeChannels();
  listen();
  listViews();
  listSaved();
  pictures();
}

start();
