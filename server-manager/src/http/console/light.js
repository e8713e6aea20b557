// How scenes are lit: exposure, tone mapper, fog, glow, ambient occlusion and
// depth of field.

import { actAndDraw, onNumber, presentation } from "./requests.js";
import { byId, isFree, on, state } from "./state.js";

/** What is set by a number, none if it is empty: its path, and its value with that number. */
const NUMBERS = {
  fog: ["fog", (visibility, shown) =>
    ({ height: 0, half_height: null, color: [1, 1, 1], ...shown, visibility })],
  glow: ["glow", (strength, shown) => ({ width_degrees: 4, ...shown, strength })],
  occlusion: ["ambient_occlusion", (radius) => ({ radius })],
  focus: ["depth_of_field", (focus, shown) => ({ aperture: focus / 50, ...shown, focus })],
};

/** Shows how scenes are lit. */
export function showLight() {
  const shown = state.status.presentation;
  const show = (id, value) => { if (isFree(id)) byId(id).value = value; };
  show("exposure", Math.log2(shown.exposure));
  byId("exposure-value").textContent = Math.log2(shown.exposure).toFixed(2);
  byId("automatic").checked = shown.is_exposure_automatic;
  show("tone", shown.tone);
  show("fog", shown.fog?.visibility ?? "");
  show("glow", shown.glow?.strength ?? "");
  show("occlusion", shown.ambient_occlusion?.radius ?? "");
  show("focus", shown.depth_of_field?.focus ?? "");
}

async function setNumber(id, value) {
  const [name, valueOf] = NUMBERS[id];
  const shown = await presentation();
  if (!shown) return;
  const wanted = value === "" ? null : valueOf(Number(value), shown[name]);
  await actAndDraw("PUT", `/api/v1/${name}`, { [name]: wanted });
}

/** Lets the controls of light work. */
export function startLight() {
  const stops = () => ({ stops: Number(byId("exposure").value) });
  on("exposure", "change", () => actAndDraw("PUT", "/api/v1/exposure", stops()));
  on("automatic", "change", () => actAndDraw("PUT", "/api/v1/exposure",
    byId("automatic").checked ? { is_automatic: true } : stops()));
  on("tone", "change", () => actAndDraw("PUT", "/api/v1/tone", { tone: byId("tone").value }));
  for (const [id, [name]] of Object.entries(NUMBERS)) {
    onNumber(id, name.replaceAll("_", " "), (value) => setNumber(id, value));
  }
}
