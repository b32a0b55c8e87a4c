// Elements by name and attributes; no text of an answer is ever parsed as markup.
const SVG = "http://www.w3.org/2000/svg";

export function shape(name, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

export function path(points, closed = true) {
  if (points.length < 2) return "";
  const steps = points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`);
  return steps.join("") + (closed ? "Z" : "");
}

export const byId = (id) => document.getElementById(id);
