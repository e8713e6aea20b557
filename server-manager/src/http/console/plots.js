// The last minutes as plots: time to draw, late channels and skew, drawn by hand as SVG.

import { byId, state } from "./state.js";

/** Five minutes of two samples a second. */
const SAMPLES_MAX = 600;
const [WIDTH, HEIGHT] = [600, 80];
const SVG = "http://www.w3.org/2000/svg";

const worst = (values) => Math.max(0, ...values.filter((value) => value !== null));

/** The plots: what each shows, its unit, and its value of a status and the one before. */
const PLOTS = [
  ["Slowest draw", "ms", ({ channels }) => worst(channels.map((of) => of.draw_us)) / 1000],
  ["Deadlines missed", "", ({ channels }, before) => {
    const sum = (all) => all.reduce((total, of) => total + of.late, 0);
    return before ? Math.max(0, sum(channels) - sum(before.channels)) : 0;
  }],
  ["Largest skew, p99", "µs", ({ channels }) => worst(channels.map((of) => of.skew.p99_us))],
  ["Frames a second", "", (status, before, seconds) =>
    before && seconds > 0 ? Math.max(0, status.frame - before.frame) / seconds : 0],
];

const series = PLOTS.map(() => []);
let before = null;
let at = 0;

function element(parent, tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  parent.append(made);
  return made;
}

/** Makes the plots, empty. */
export function startPlots() {
  for (const [title] of PLOTS) {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = title;
    const svg = element(figure, "svg", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img",
      "aria-label": title,
    });
    element(svg, "polyline", { points: "" });
    figure.prepend(caption);
    byId("plots").append(figure);
  }
}

/** Adds the last status to the plots. */
export function plot() {
  // Statuses that a network held up come all at once.
  const { status, toldAt: now } = state;
  if (before && before.epoch !== status.epoch) before = null;
  PLOTS.forEach(([title, unit, value], index) => {
    const values = series[index];
    values.push(value(status, before, (now - at) / 1000));
    if (values.length > SAMPLES_MAX) values.shift();
    const most = Math.max(...values);
    const x = (place) => WIDTH - (values.length - 1 - place) * WIDTH / (SAMPLES_MAX - 1);
    const y = (of) => HEIGHT - 2 - (most > 0 ? of / most : 0) * (HEIGHT - 4);
    const points = values.map((of, place) => `${x(place).toFixed(1)},${y(of).toFixed(1)}`);
    const figure = byId("plots").children[index];
    figure.querySelector("polyline").setAttribute("points", points.join(" "));
    const number = (of) => `${of.toFixed(1)} ${unit}`.trim();
    const words = `${title}: ${number(values.at(-1))}, at most ${number(most)}`;
    figure.firstChild.textContent = words;
    figure.querySelector("svg").setAttribute("aria-label", words);
  });
  [before, at] = [status, now];
}
