// What is looked at: stored views, tours of them, views over parts of the wall, and the head.

import { act, actAndDraw, log, presentation, read } from "./requests.js";
import { add, byId, fill, isFree, on, state } from "./state.js";

const TOUR_RATE = 30;
const viewPath = (name) => `/api/v1/views/${encodeURIComponent(name)}`;
let stored = [];

/** Reads the stored views anew: others store and remove them too. */
export async function listViews() {
  stored = await read("/api/v1/views") ?? stored;
  const names = stored.map(({ name }) => name);
  fill("views", names);
  fill("part-view", ["", ...names], (name) => name || "the present camera");
}

/** Lists the wall's screens. */
export function listScreens() {
  const { screens } = state.wall;
  fill("part-screen", screens.map((_, at) => String(at)), (at) => screens[at].name);
}

/** Plays all stored views, each after the one before. A wall that is paused draws for it. */
async function playTour() {
  await listViews();
  const travel_s = Number(byId("tour-travel").value);
  const stops = stored.map(({ camera }) =>
    ({ camera, travel_s, stay_s: Number(byId("tour-stay").value), easing: "Smooth" }));
  const tour = { stops, is_loop: byId("tour-loop").checked };
  if (await act("PUT", "/api/v1/tour", tour) === undefined) return;
  const line = byId("curl").textContent;
  const played = await read("/api/v1/tour");
  if (played && played.pace === null) await act("PUT", "/api/v1/pace", { rate: TOUR_RATE });
  byId("curl").textContent = line;
  showTour();
}

async function showTour() {
  const played = await read("/api/v1/tour");
  byId("tour-state").textContent = played?.tour ? `playing ${played.tour.stops.length} stops`
    : played?.following !== null && played ? `following node ${played.following}` : "no tour";
}

/** The part of a screen that the form names, in pixels of its canvas. */
function part() {
  const screen = Number(byId("part-screen").value);
  const canvas = state.wall.screens[screen].canvas;
  const of = (id, size) => Math.round(Number(byId(id).value) / 100 * size);
  const [x, y] = [of("part-left", canvas[0]), of("part-top", canvas[1])];
  const width = Math.min(of("part-width", canvas[0]), canvas[0] - x);
  const height = Math.min(of("part-height", canvas[1]), canvas[1] - y);
  return { Screen: { screen, rect: [x, y, width, height] } };
}

async function layOver() {
  const name = byId("part-view").value;
  const area = part();
  if (name) await listViews();
  const chosen = stored.find((view) => view.name === name);
  if (name && !chosen) {
    log(`view ${name} is not stored any more; choose another one`, true);
    return;
  }
  const shown = await presentation();
  if (!shown) return;
  const camera = chosen?.camera ?? shown.camera;
  const view = { camera, area, projection: "Wall", root: null, layers: null };
  await setViews([...shown.views, view]);
}

/** The part of the wall that a view lies over, in words. */
function placeOf({ area: { Screen: part } }) {
  return part ? `${state.wall.screens[part.screen].name}: ${part.rect.join(", ")}` : "the wall";
}

/** Takes the view of a number away, which lies over a place; others may have done so already, or
    have changed the numbers. */
async function takeAway(number, place) {
  const views = (await presentation())?.views ?? [];
  const isIt = (view) => placeOf(view) === place;
  const at = views.slice(number, number + 1).some(isIt) ? number : views.findIndex(isIt);
  if (at >= 0) await setViews(views.toSpliced(at, 1));
}

const setViews = (views) => actAndDraw("PUT", "/api/v1/overlays", { views });

let shownViews = "";

/** Shows the views over parts of the wall, and where the head is. */
export function showViews() {
  const { views, head } = state.status.presentation;
  const places = views.map(placeOf);
  const text = places.join("\n");
  if (text !== shownViews) {
    shownViews = text;
    const list = byId("parts");
    list.replaceChildren();
    places.forEach((place, at) => {
      const item = add(list, "li");
      add(item, "span", { textContent: `${place} ` });
      const remove = add(item, "button", { type: "button", textContent: "Take away" });
      remove.setAttribute("aria-label", `Take away view ${at + 1} on ${place}`);
      remove.addEventListener("click", () => takeAway(at, place));
    });
  }
  // All of the form: who has typed an axis goes on to the next one.
  if (!isFree("head-form")) return;
  ["x", "y", "z"].forEach((axis, i) => {
    byId(`head-${axis}`).value = Number(head.position[i].toFixed(3));
  });
}

/** Lets the controls of views, tours and the head work. */
export function startViews() {
  const chosen = () => byId("views").value;
  on("show-view", "click", () => chosen() && act("POST", `${viewPath(chosen())}/show`));
  on("remove-view", "click", async () => {
    if (chosen()) await act("DELETE", viewPath(chosen()));
    listViews();
  });
  on("store-form", "submit", async (event) => {
    event.preventDefault();
    const name = new FormData(event.target).get("name");
    event.target.reset();
    await act("PUT", viewPath(name), {});
    listViews();
  });
  on("play-tour", "click", playTour);
  on("stop-tour", "click", async () => {
    await act("DELETE", "/api/v1/tour");
    showTour();
  });
  on("part-form", "submit", (event) => {
    event.preventDefault();
    layOver();
  });
  on("remove-parts", "click", () => setViews([]));
  on("head-form", "submit", (event) => {
    event.preventDefault();
    const position = ["x", "y", "z"].map((axis) => Number(byId(`head-${axis}`).value));
    actAndDraw("PUT", "/api/v1/head", { position });
  });
  for (const id of ["views", "part-view"]) on(id, "focus", listViews);
  listViews();
  showTour();
  setInterval(() => document.hidden || showTour(), 2000);
}
