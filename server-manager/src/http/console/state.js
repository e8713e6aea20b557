// The state that the parts of the page share: the wall as it was described and last said to be.

export const state = {
  /** The wall's description, once it is there. */
  wall: null,
  /** The last status, and when it came, in milliseconds. */
  status: null,
  statusAt: 0,
  /** When the manager told it, in milliseconds of the manager's clock. */
  toldAt: 0,
  /** The frame of the status before. */
  frameBefore: null,
};

export const byId = (id) => document.getElementById(id);

/** Adds an element below another one. */
export function add(parent, tag, properties = {}) {
  const element = document.createElement(tag);
  Object.assign(element, properties);
  parent.append(element);
  return element;
}

/** Lists these values in a select; the chosen one stays chosen. */
export function fill(id, values, title = (value) => value) {
  const list = byId(id);
  const options = values.map((value) => new Option(title(value), value));
  // An open list closes in some browsers when its options are replaced.
  if (options.map((option) => option.outerHTML).join("") === list.innerHTML) return;
  const before = list.value;
  list.replaceChildren(...options);
  if (values.includes(before)) list.value = before;
}

export const on = (id, name, work) => byId(id).addEventListener(name, work);

/** Returns whether a control, or a form, may be written: the focus is not in it. */
export const isFree = (id) => !byId(id).contains(document.activeElement);
