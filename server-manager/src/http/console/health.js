// The state of channels: what is wrong, in words, colours and a table.

import { add, byId, state } from "./state.js";

/** A status that is older than this says nothing of the wall as it is now. */
const STATUS_TIME_MAX_MS = 1500;

/** What is wrong with a channel, or "". */
export function fault(channel) {
  const { status, statusAt, frameBefore } = state;
  if (Date.now() - statusAt > STATUS_TIME_MAX_MS) return "no status";
  if (["lost", "late"].includes(channel.state)) return channel.state;
  const mode = status.presentation.output_mode;
  if (mode === "blank") return "black";
  if (mode === "freeze") return "frozen";
  // No frame waits for a channel that joins or gets ready.
  if (channel.state !== "live") return "";
  const isMoving = frameBefore !== null && status.frame > frameBefore + 2;
  if (isMoving && channel.frame < frameBefore) return "frozen";
  if (channel.revision !== status.revision && !status.opening.length) {
    return `revision ${channel.revision}`;
  }
  return "";
}

function kind(channel) {
  if (fault(channel)) return "bad";
  const isWaiting = ["joining", "preparing"].includes(channel.state);
  return isWaiting || state.status.rest.is_resting ? "wait" : "good";
}

function summary(bad) {
  const { channels, frame, rest, warnings } = state.status;
  if (bad.length) {
    return `${bad.length} of ${channels.length} channels: ` +
      bad.slice(0, 4).map((channel) => `${channel.name} ${fault(channel)}`).join(", ");
  }
  if (rest.is_resting) return "displays are dark by themselves until the wall is used";
  const told = ["", ", 1 warning"][warnings.length] ?? `, ${warnings.length} warnings`;
  return `all ${channels.length} channels are well${told}, frame ${frame}`;
}

function row(channel) {
  const line = document.createElement("tr");
  line.className = kind(channel);
  line.title = channel.reason ?? "";
  const cells = [
    channel.name, fault(channel) || channel.state,
    channel.draw_us === null ? "–" : (channel.draw_us / 1000).toFixed(1), channel.late,
    `${channel.skew.p50_us} / ${channel.skew.p99_us}`, channel.skew.clock_error_us ?? "–",
    channel.frame,
  ];
  for (const text of cells) {
    const cell = document.createElement("td");
    cell.textContent = text;
    line.append(cell);
  }
  return line;
}

/** Lists the status's warnings for as long as they last. */
function showWarnings() {
  const list = byId("warnings");
  const { warnings } = state.status;
  // A line that says the same stays: it may be selected, or being read out.
  while (list.children.length > warnings.length) list.lastChild.remove();
  warnings.forEach((text, place) => {
    const line = list.children[place] ?? add(list, "li");
    if (line.textContent !== text) line.textContent = text;
  });
  list.hidden = !warnings.length;
}

/** Shows how channels are, and of what the manager warns. */
export function showHealth() {
  const { status } = state;
  if (!status) return;
  const bad = status.channels.filter((channel) => fault(channel));
  const health = byId("health");
  const isWaiting = status.rest.is_resting || status.warnings.length > 0;
  health.className = bad.length ? "bad" : isWaiting ? "wait" : "good";
  health.textContent = summary(bad);
  showWarnings();
  byId("table").replaceChildren(...status.channels.map(row));
  for (const channel of status.channels) {
    const box = byId(`channel-${channel.name}`);
    if (!box) continue;
    box.className = `channel ${kind(channel)}`;
    const ms = channel.draw_us === null ? "" : ` ${(channel.draw_us / 1000).toFixed(1)} ms`;
    box.firstChild.textContent = `${channel.name} ${fault(channel) || channel.state}${ms}`;
  }
  byId("clients").textContent = `Connected: ${status.clients.join(", ")}`;
}
