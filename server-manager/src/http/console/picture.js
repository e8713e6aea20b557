// The live picture: one request at a time; the manager takes one capture for all browsers.

import { byId, state } from "./state.js";

const PICTURE_PERIOD_MS = 450;

/** Boxes over the picture, as channels hang on their screens. */
export function placeChannels() {
  const { wall } = state;
  const sizes = wall.screens.map((screen) => screen.canvas);
  // A screen with channels for the right eye has a second picture beside the first.
  const isForRight = ({ adjustment }) => adjustment.eye === "right";
  const isStereo = (of) => isForRight(of) || (of.adjustment.packing ?? "none") !== "none";
  const widths = sizes.map(([x], index) =>
    wall.channels.some((of) => of.screen === index && isStereo(of)) ? 2 * x : x);
  const width = widths.reduce((sum, x) => sum + x, 0);
  const height = Math.max(...sizes.map(([, y]) => y));
  const boxes = wall.channels.map((channel) => {
    const before = widths.slice(0, channel.screen).reduce((sum, x) => sum + x, 0);
    const left = before + (isForRight(channel) ? sizes[channel.screen][0] : 0);
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

/** Shows pictures of the wall for as long as the page is there. */
export async function pictures() {
  for (;;) {
    const began = performance.now();
    if (!document.hidden) {
      const width = Math.min(1280, Math.round(byId("stage").clientWidth / 320 + 0.5) * 320);
      try {
        const query = `width=${width}&max_age_ms=${PICTURE_PERIOD_MS}`;
        const answer = await fetch(`/api/v1/wall.jpg?${query}`);
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
