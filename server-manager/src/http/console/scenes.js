// Scenes: files of the manager, saved ones, and sessions of all that the wall shows.

import { act, log, read } from "./requests.js";
import { byId, fill, on, state } from "./state.js";
import { listViews } from "./views.js";

const encoded = encodeURIComponent;

/** The name of a file's scene. */
const nameOf = (path) => path.split("/").at(-1).replace(/\.[^.]*$/, "");

/** Shows the chosen file's scene, if the wall has shown it while somebody watched. */
async function preview() {
  const name = nameOf(byId("files").value);
  const names = await read("/api/v1/scene/previews") ?? [];
  const image = byId("files-preview");
  // Pictures have names of scenes: of two files with one name it may be either's.
  const files = [...byId("files").options].filter((option) => nameOf(option.value) === name);
  image.hidden = files.length !== 1 || !names.includes(name);
  if (!image.hidden) image.src = `/api/v1/scene/previews/${encoded(name)}.jpg`;
}

async function listFiles() {
  const list = await read("/api/v1/scene/files");
  if (!list) return;
  const files = list.files;
  const size = new Map(files.map((file) => [file.path, `${(file.bytes / 1e6).toFixed(1)} MB`]));
  fill("files", files.map((file) => file.path), (path) => `${path} (${size.get(path)})`);
  byId("files-cut").hidden = !list.is_cut;
  preview();
}

async function listNames(id, path) {
  const entries = await read(path);
  if (entries) fill(id, entries.map(({ name }) => name));
}

const listSaved = () => listNames("saved", "/api/v1/scene/saved");
const listSessions = () => listNames("sessions", "/api/v1/sessions");

/** Reads what can be opened anew. */
export function listScenes() {
  listFiles();
  listSaved();
  listSessions();
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
export function startScenes() {
  const { path, keep_camera } = byId("open-form").elements;
  on("open-form", "submit", (event) => {
    event.preventDefault();
    open(path.value, keep_camera.checked);
  });
  ofChosen("open-file", "files", (file) => open(file, keep_camera.checked));
  on("refresh-files", "click", listFiles);
  on("files", "change", preview);
  on("close", "click", () => act("POST", "/api/v1/scene/close"));
  ofForm("save-scene-form", listSaved, "/api/v1/scene/saved/");
  ofChosen("open-saved", "saved", (name) => open(`saved:${name}`, true));
  ofChosen("remove-saved", "saved",
    (name) => act("DELETE", `/api/v1/scene/saved/${encoded(name)}`), listSaved);
  ofForm("save-session-form", listSessions, "/api/v1/sessions/");
  ofChosen("open-session", "sessions", openSession, listViews);
  ofChosen("remove-session", "sessions",
    (name) => act("DELETE", `/api/v1/sessions/${encoded(name)}`), listSessions);
  // Others may have saved or removed some.
  on("saved", "focus", listSaved);
  on("sessions", "focus", listSessions);
  listScenes();
}
