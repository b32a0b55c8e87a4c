// The API in words, from the description that this server gives of it; nothing comes from elsewhere.
import { ask } from "./api.js";
import { byId } from "./svg.js";
import { why } from "./words.js";

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.filter((child) => child !== null && child !== ""));
  return made;
}

let schemas = {};

const resolved = (schema = {}) =>
  (schema.$ref ? schemas[schema.$ref.split("/").at(-1)] || {} : schema);

// What a value may be, in a few words: "number, 1 to 179", "opening | paper".
function kind(given) {
  const schema = resolved(given);
  const options = schema.anyOf?.filter((one) => one.type !== "null");
  if (options?.length) return options.map(kind).join(" or ");
  if (schema.enum) return schema.enum.join(" | ");
  if (schema.const !== undefined) return String(schema.const);
  if (schema.type === "array") return `list of ${kind(schema.items)}`;
  if (schema.format === "binary") return "file";
  const least = schema.minimum ?? schema.exclusiveMinimum;
  const bounds = least !== undefined && schema.maximum !== undefined ? `, ${least} to ${schema.maximum}` : "";
  return (schema.type || schema.title || "any") + bounds;
}

function table(rows) {
  if (!rows.length) return "";
  const lines = rows.map((cells) => element("tr", {}, ...cells.map((cell) => element("td", {}, ...prose(cell)))));
  return element("table", {}, element("tbody", {}, ...lines));
}

// Words between backticks are names.
const prose = (text) => (text || "").split("`").map((part, i) => (i % 2 ? element("code", {}, part) : part));

const section = (title, ...content) => [element("h3", {}, title), ...content];

function fields(given) {
  const schema = resolved(given);
  return Object.entries(schema.properties || {}).map(([name, field]) => {
    const needed = schema.required?.includes(name) ? "Required. " : "";
    return [name, kind(field), needed + (field.description || resolved(field).description || "")];
  });
}

function body(operation) {
  const content = operation.requestBody?.content || {};
  const found = Object.entries(content);
  if (!found.length) return [];
  const form = found.find(([, { schema }]) => resolved(schema).properties);
  const query = new Set((operation.parameters || []).map((one) => one.name));
  const own = form ? fields(form[1].schema).filter(([name]) => !query.has(name)) : [];
  const kinds = found.map(([type]) => type).join(", ");
  return section("Body", element("p", {}, kinds + (query.size ? "; its other parts are the fields of the query." : "")), table(own));
}

function answers(operation) {
  const found = Object.entries(operation.responses || {});
  const rows = found.map(([status, answer]) => [status, Object.keys(answer.content || {}).join(", "), answer.description]);
  const schema = resolved(operation.responses?.[200]?.content?.["application/json"]?.schema);
  const example = schema.examples?.[0];
  return [
    ...section("Answers", table(rows)),
    ...(schema.properties ? section("Keys", table(fields(schema))) : []),
    ...(example ? section("Example", element("pre", {}, JSON.stringify(example, null, 2))) : []),
  ];
}

function route(path, verb, operation) {
  const id = `${verb}-${path}`;
  const name = element("span", { class: `verb ${verb}` }, verb.toUpperCase());
  byId("contents").append(element("a", { href: `#${id}` }, name.cloneNode(true), path));
  const query = (operation.parameters || []).map((one) =>
    [one.name, kind(one.schema), one.description || resolved(one.schema).description]);
  byId("routes").append(element(
    "section", { class: "card route", id },
    element("h2", {}, name, path),
    operation.summary ? element("p", {}, element("b", {}, operation.summary)) : "",
    operation.description ? element("p", {}, ...prose(operation.description)) : "",
    ...(query.length ? section("Query and path", table(query)) : []),
    ...body(operation),
    ...answers(operation),
  ));
}

async function begin() {
  try {
    const described = await (await ask("/openapi.json")).json();
    schemas = described.components?.schemas || {};
    byId("title").textContent = described.info.title;
    byId("summary").textContent = `${described.info.summary} Version ${described.info.version}`;
    byId("status").remove();
    for (const [path, verbs] of Object.entries(described.paths)) {
      for (const [verb, operation] of Object.entries(verbs)) route(path, verb, operation);
    }
  } catch (error) {
    byId("status").textContent = why(error);
  }
}

begin();
