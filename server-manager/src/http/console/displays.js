// What displays show of the picture: modes, patterns, bounds, pace, and when they rest.

import { act, actAndDraw, log, onNumber, presentation } from "./requests.js";
import { byId, isFree, on, state } from "./state.js";

/** Shows how displays are. */
export function showDisplays() {
  const { presentation: shown, rest } = state.status;
  for (const button of byId("modes").children) {
    button.setAttribute("aria-pressed", String(button.dataset.mode === shown.output_mode));
  }
  if (isFree("pattern")) byId("pattern").value = shown.pattern ?? "";
  if (isFree("error")) byId("error").value = shown.bounds.error_px;
  byId("error-value").textContent = shown.bounds.error_px;
  if (isFree("rate")) byId("rate").value = shown.bounds.rate_fps ?? "";
  byId("rest-state").textContent = inWords(rest);
  showRules(rest.rules);
}

/** The rules that the form was filled with last, as JSON. */
let rulesShown = null;

/** Fills the form of rules if they have changed: what is being written there stays. */
function showRules(rules) {
  const now = JSON.stringify(rules);
  if (now === rulesShown || !isFree("rest-form")) return;
  rulesShown = now;
  byId("rest-idle").value = rules.idle_s === null ? "" : rules.idle_s / 60;
  byId("rest-from").value = rules.hours ? time(rules.hours.from_min) : "";
  byId("rest-until").value = rules.hours ? time(rules.hours.until_min) : "";
}

// 24:00 is 0:00 for a field of a time.
const time = (minute) => [minute / 60 % 24, minute % 60]
  .map((part) => String(Math.floor(part)).padStart(2, "0")).join(":");

function minute(text) {
  const [hours, minutes] = text.split(":").map(Number);
  return hours * 60 + minutes;
}

function inWords({ rules: { idle_s, hours }, is_resting }) {
  const rules = [];
  if (idle_s !== null) rules.push(`after ${Math.round(idle_s / 6) / 10} min without use`);
  if (hours) rules.push(`outside ${time(hours.from_min)}–${time(hours.until_min)}`);
  const words = rules.length ? `Dark ${rules.join(" and ")}` : "Never dark by themselves";
  return is_resting ? `${words}; dark now` : words;
}

function setRest(event) {
  event.preventDefault();
  const [idle, from, until] = ["rest-idle", "rest-from", "rest-until"].map((id) => byId(id).value);
  if (!from !== !until) {
    log("hours need both ends: write from and until, or neither", true);
    return;
  }
  act("PUT", "/api/v1/rest", {
    idle_s: idle ? Number(idle) * 60 : null,
    hours: from && until ? { from_min: minute(from), until_min: minute(until) } : null,
  });
}

/** Lets the controls of displays work. */
export function startDisplays() {
  for (const button of byId("modes").children) {
    button.addEventListener("click",
      () => act("PUT", "/api/v1/displays", { mode: button.dataset.mode }));
  }
  on("pattern", "change",
    () => act("PUT", "/api/v1/pattern", { pattern: byId("pattern").value || null }));
  // The other bound stays as it is: a slider may not be able to show it.
  const bound = async (change) => {
    const shown = await presentation();
    if (!shown) return;
    const { error_px, rate_fps } = shown.bounds;
    await actAndDraw("PUT", "/api/v1/bounds", { error_px, rate_fps, ...change });
  };
  on("error", "change", () => bound({ error_px: Number(byId("error").value) }));
  onNumber("rate", "lowest rate",
    (value) => bound({ rate_fps: value ? Number(value) : null }));
  on("set-pace", "click", () => {
    const pace = byId("pace").value;
    const rate = pace ? { rate: Number(pace) } : {};
    act("PUT", "/api/v1/pace", pace === "free" ? { is_free: true } : rate);
  });
  on("rest-form", "submit", setRest);
  on("rest-off", "click", () => act("PUT", "/api/v1/rest", {}));
}
