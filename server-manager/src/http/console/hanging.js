// How a channel's upright picture lies on its display: mirrored, turned, packed for two eyes.

/** Returns the size of one eye's picture as it is turned for the display, in pixels. */
function turnedSize({ size: [width, height], adjustment: { turn } }) {
  return ["left", "right"].includes(turn) ? [height, width] : [width, height];
}

/** Returns the size of the display's picture, in pixels. */
export function displaySize(channel) {
  const [width, height] = turnedSize(channel);
  const { packing } = channel.adjustment;
  return [
    packing === "side-by-side" ? 2 * width : width, packing === "top-bottom" ? 2 * height : height,
  ];
}

/** Returns the place on the display of a pixel of the upright picture; of two eyes the left's. */
export function displayFromUpright(channel, [x, y]) {
  const { size: [width], adjustment: { mirror, turn } } = channel;
  const [w, h] = turnedSize(channel);
  const flipped = mirror ? width - x : x;
  return { left: [w - y, flipped], right: [y, h - flipped], half: [w - flipped, h - y] }[turn] ??
    [flipped, y];
}

/** Returns the shift of the upright picture that a shift on the display is. */
export function uprightShift({ adjustment: { mirror, turn } }, [dx, dy]) {
  const [x, y] = { left: [dy, -dx], right: [-dy, dx], half: [-dx, -dy] }[turn] ?? [dx, dy];
  return [mirror ? -x : x, y];
}
