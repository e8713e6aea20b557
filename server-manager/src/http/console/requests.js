// Requests of the HTTP interface. Each shows the same as a line for curl.

import { byId, on } from "./state.js";

const LOG_LINES_MAX = 200;

/** Returns a request as a line for curl, with what lets it in at an origin: a token, or keys. */
export function curlLine(method, path, body, origin = location.origin) {
  const quoted = (text) => "'" + text.replaceAll("'", "'\\''") + "'";
  const data = body === undefined ? "" :
    ` -H 'Content-Type: application/json' -d ${quoted(JSON.stringify(body))}`;
  const line = (login) => `curl -X ${method} ${login}${data} ${quoted(origin + path)}`;
  if (origin.startsWith("https:")) {
    const file = (name) => `"$POLYPTYCH_KEYS/${name}.pem"`;
    return line(`--cacert ${file("authority")} --cert ${file("cert")} --key ${file("key")}`);
  }
  // printf is the shell's own: the token is in the arguments of no process, which all users see.
  return `printf 'Authorization: Bearer %s' "$(polyptych login --token)" | ${line("-H @-")}`;
}

/** Asks, and returns the answer; fails with what the manager says. */
export async function ask(method, path, body, isShown = true) {
  if (isShown) byId("curl").textContent = curlLine(method, path, body);
  const options = { method, headers: {} };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["Content-Type"] = "application/json";
  }
  const answer = await fetch(path, options).catch(() => {
    const reason = "the manager does not answer; whether this was done is unknown";
    log(`${method} ${path}: ${reason}`, true);
    throw new Error(reason);
  });
  if (answer.status === 401) byId("login").hidden = false;
  const value = await answer.json();
  if (!answer.ok) {
    log(value.error, true);
    throw new Error(value.error);
  }
  const warning = answer.headers.get("polyptych-warning");
  if (warning) warn(`${method} ${path}: ${inUtf8(warning)}`);
  return value;
}

/** Asks; a refusal stands in the list of events. Returns the answer, or undefined. */
export const act = (method, path, body) => ask(method, path, body).catch(() => undefined);

/** What the wall presents now, or undefined where it is not said. Changes of it start here: the
    last status may be half a second old, and others change the wall too. */
export const presentation = () =>
  ask("GET", "/api/v1/presentation", undefined, false).catch(() => undefined);

/** Asks without a line for curl: what the page reads by itself. */
export const read = (path) => fetch(path)
  .then((answer) => answer.ok ? answer.json() : null).catch(() => null);

/** Asks for what holds from the next frame on, and for that frame. */
export async function actAndDraw(method, path, body) {
  const done = await act(method, path, body);
  if (done === undefined) return done;
  await ask("POST", "/api/v1/frame", { keeps_time: true }, false).catch(() => undefined);
  return done;
}

const stamped = (text) => `${new Date().toLocaleTimeString()} ${text}`;

export function log(text, isBad = false) {
  const line = document.createElement("li");
  line.textContent = stamped(text);
  if (isBad) line.className = "bad";
  const list = byId("log");
  list.prepend(line);
  while (list.children.length > LOG_LINES_MAX) list.lastChild.remove();
}

/** The text of a header, of which a browser makes a character of each byte. */
const inUtf8 = (text) =>
  new TextDecoder().decode(Uint8Array.from(text, (byte) => byte.charCodeAt(0)));

/** The line of the last warning, and its words. */
let warned = { line: null, words: "" };

/**
 * Says a warning about what was asked for. While the newest line says it, if with other numbers,
 * that line is written anew: a hand that drags asks many times a second.
 */
function warn(text) {
  const words = text.replace(/[\d.]+/g, "");
  const newest = byId("log").firstChild;
  if (!newest || newest !== warned.line || words !== warned.words) {
    log(`warning: ${text}`);
    warned = { line: byId("log").firstChild, words };
    return;
  }
  const now = stamped(`warning: ${text}`);
  if (newest.textContent !== now) newest.textContent = now;
}

/**
 * Calls `work` with the text of a field of a number when it has changed. Text that is no number is
 * told by the field's name: of an empty field it is no change, since a browser takes it for empty.
 */
export function onNumber(id, name, work) {
  on(id, "change", () => {
    if (!byId(id).validity.badInput) work(byId(id).value);
  });
  on(id, "blur", () => {
    if (byId(id).validity.badInput) log(`${name}: write a number, or nothing for none`, true);
  });
}
