// The console: shows the wall as it is, and commands it. All that it does is in the HTTP
// interface.

import { listChannels, startAlignment } from "./alignment.js";
import { steer } from "./camera.js";
import { showDisplays, startDisplays } from "./displays.js";
import { showHealth } from "./health.js";
import { showLight, startLight } from "./light.js";
import { pictures, placeChannels } from "./picture.js";
import { plot, startPlots } from "./plots.js";
import { log, read } from "./requests.js";
import { listScenes, showScene, startScenes } from "./scenes.js";
import { byId, state } from "./state.js";
import { listScreens, listViews, showViews, startViews } from "./views.js";

function show() {
  showHealth();
  showScene();
  showDisplays();
  showLight();
  showViews();
}

/** Time after which a page asks again for what it was refused, in milliseconds. */
const LISTEN_PERIOD_MS = 2000;

/** Events have stopped: a manager that comes after it may have another wall. */
let isLost = false;

/** Shows the channels and screens of the wall. */
function showWall() {
  placeChannels();
  listScreens();
  listChannels();
}

async function readWallAgain() {
  const wall = await read("/api/v1/wall");
  if (!wall) return;
  isLost = false;
  const isSame = JSON.stringify(wall) === JSON.stringify(state.wall);
  state.wall = wall;
  if (!isSame) showWall();
  listViews();
  listScenes();
}

function listen() {
  const events = new EventSource("/api/v1/events");
  events.onopen = () => {
    if (isLost) readWallAgain();
  };
  events.addEventListener("status", (event) => {
    state.frameBefore = state.status?.frame ?? null;
    state.status = JSON.parse(event.data);
    state.statusAt = Date.now();
    state.toldAt = Number(event.lastEventId);
    byId("login").hidden = true;
    show();
    plot();
  });
  events.addEventListener("log", (event) => log(JSON.parse(event.data).text));
  events.addEventListener("lost", (event) => {
    log(`${JSON.parse(event.data).events} events were missed`, true);
  });
  events.onerror = async () => {
    isLost = true;
    showHealth();
    // A browser tries again by itself where nothing answers, but not after a refusal.
    if (events.readyState !== EventSource.CLOSED) return;
    const answer = await fetch("/api/v1/status").catch(() => null);
    if (answer?.status === 401) byId("login").hidden = false;
    setTimeout(listen, LISTEN_PERIOD_MS);
  };
}

/** Reads the wall, again and again while the manager is away or has no place; null where it does
    not let the page in. */
async function firstWall() {
  for (;;) {
    const answer = await fetch("/api/v1/wall").catch(() => null);
    const value = await answer?.json().catch(() => null);
    if (answer?.ok && value) return value;
    const isShutOut = [401, 403].includes(answer?.status);
    byId("login").hidden = answer?.status !== 401;
    byId("health").className = "bad";
    byId("health").textContent = isShutOut ? "the manager does not let this page in" :
      value?.error ?? "the manager does not answer";
    if (isShutOut) return null;
    await new Promise((done) => setTimeout(done, LISTEN_PERIOD_MS));
  }
}

async function start() {
  steer();
  startDisplays();
  startLight();
  startPlots();
  // A channel is red in time, also where no status comes any more.
  setInterval(showHealth, 250);
  state.wall = await firstWall();
  if (!state.wall) return;
  showWall();
  startViews();
  startScenes();
  startAlignment();
  listen();
  pictures();
}

start();
