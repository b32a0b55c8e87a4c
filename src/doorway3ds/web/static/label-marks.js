// What is marked in an image, as the server has it; every function gives new marks.
export const NOTHING = Object.freeze({ openings: [], closed: false, confidence: 3 });

// Without an opening: a closed door, or none at all.
export const shut = (marks, closed) =>
  ({ openings: [], closed, confidence: marks.openings[0]?.confidence ?? marks.confidence });

// The edges of opening `index`, which may be a new one at the end.
export function place(marks, index, left, right, more = {}) {
  const fresh = { half_open: false, clear: null, confidence: 3 };
  const edges = { left_px: Math.min(left, right), right_px: Math.max(left, right) };
  const openings = [...marks.openings];
  openings[index] = { ...(openings[index] ?? fresh), ...edges, ...more };
  return { openings, closed: false, confidence: marks.confidence };
}

export function patch(marks, index, change) {
  const openings = marks.openings.map((opening, i) => (i === index ? { ...opening, ...change } : opening));
  return { ...marks, openings };
}

export function remove(marks, index) {
  const openings = marks.openings.filter((_, i) => i !== index);
  return openings.length ? { ...marks, openings } : shut(marks, false);
}

export const sure = (marks, index, confidence) =>
  (marks.openings.length ? patch(marks, index, { confidence }) : { ...marks, confidence });

export const stateOf = (opening) => (opening.half_open ? "half open" : "open");

export const wayOf = (opening) =>
  ({ true: "clear", false: "blocked", null: "cannot tell" })[String(opening.clear)];
