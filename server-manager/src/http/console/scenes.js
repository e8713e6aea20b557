// Scenes: files of the manager, saved ones, and sessions of all that the wall shows.

import { act, log, read } from "./requests.js";
import { byId, on, state } from "./state.js";

const encoded = encodeURIComponent;

function fill(id, values, title = (value) => value) {
  const before = byId(id).value;
  byId(id).replaceChildren(...values.map((value) => new Option(title(value), value)));
  if (values.includes(before)) byId(id).value = before;
}

/** Shows the chosen file's scene, if the wall has shown it while somebody watched. */
async function preview() {
  const name = byId("files").value.split("/").at(-1).replace(/\.[^.]*$/, "");
  const names = await read("/api/v1/scene/previews") ?? [];
  const image = byId("files-preview");
  image.hidden = !names.includes(name);
  if (!image.hidden) image.src = `/api/v1/scene/previews/${encoded(name)}.jpg`;
}

async function listFiles() {
  const list = await read("/api/v1/scene/files");
  const files = list?.files ?? [];
  const size = new Map(files.map((file) => [file.path, `${(file.bytes / 1e6).toFixed(1)} MB`]));
  fill("files", files.map((file) => file.path), (path) => `${path} (${size.get(path)})`);
  byId("files-cut").hidden = !list?.is_cut;
  preview();
}

async function listSaved() {
  fill("saved", (await read("/api/v1/scene/saved") ?? []).map((scene) => scene.name));
}

async function listSessions() {
  fill("sessions", (await read("/api/v1/sessions") ?? []).map((session) => session.name));
}

/** Shows which scene is open, and how far the next one has come. */
export function showScene() {
  const { scene, opening: [opening] } = state.status;
  byId("scene-name").textContent = scene ?? "none";
  byId("progress").hidden = byId("progress-words").hidden = !opening;
  if (!opening) return;
  const { stage, percent } = opening.progress;
  byId("progress").value = percent;
  byId("progress-words").textContent = `${opening.scene}: ${stage.toLowerCase()} ${percent} %`;
}

const open = (path, keep_camera) =>
  act("POST", "/api/v1/scene/open", { path, keep_camera });

async function openSession(name) {
  const opened = await act("POST", `/api/v1/sessions/${encoded(name)}/open`);
  for (const part of opened?.left_out ?? []) log(`session ${name}, left out: ${part}`, true);
}

function ofForm(id, list, path) {
  on(id, "submit", async (event) => {
    event.preventDefault();
    const name = new FormData(event.target).get("name");
    event.target.reset();
    await act("PUT", path + encoded(name));
    list();
  });
}

function ofChosen(button, select, work, list = null) {
  on(button, "click", async () => {
    if (!byId(select).value) return;
    await work(byId(select).value);
    if (list) list();
  });
}

/** Lets the controls of scenes and sessions work. */
export function startScenes(refresh) {
  on("open-form", "submit", (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    open(form.get("path"), form.get("keep_camera") === "on");
  });
  ofChosen("open-file", "files", (path) => open(path, false));
  on("refresh-files", "click", listFiles);
  on("files", "change", preview);
  on("close", "click", () => act("POST", "/api/v1/scene/close"));
  ofForm("save-scene-form", listSaved, "/api/v1/scene/saved/");
  ofChosen("open-saved", "saved", (name) => open(`saved:${name}`, true));
  ofChosen("remove-saved", "saved",
    (name) => act("DELETE", `/api/v1/scene/saved/${encoded(name)}`), listSaved);
  ofForm("save-session-form", listSessions, "/api/v1/sessions/");
  ofChosen("open-session", "sessions", openSession, refresh);
  ofChosen("remove-session", "sessions",
    (name) => act("DELETE", `/api/v1/sessions/${encoded(name)}`), listSessions);
  listFiles();
  listSaved();
  listSessions();
}
