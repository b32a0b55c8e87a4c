// The server's routes. A failed answer becomes an ApiError with the server's own words.
export class ApiError extends Error {
  constructor(status, message, retryAfterS = 0) {
    super(message);
    this.status = status;
    this.retryAfterS = retryAfterS;
  }
}

export async function ask(url, options) {
  let answer;
  try {
    answer = await fetch(url, { credentials: "same-origin", ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ApiError(0, "The server cannot be reached.", 2);
  }
  if (answer.ok) return answer;
  let words = `The server answered ${answer.status}.`;
  try {
    words = (await answer.json()).error.message;
  } catch { /* no JSON: the status must do */ }
  throw new ApiError(answer.status, words, Number(answer.headers.get("Retry-After") || 0));
}

function withFields(url, fields) {
  const query = new URLSearchParams(fields);
  return query.size ? `${url}?${query}` : url;
}

const upload = (blob, signal) => ({
  method: "POST",
  body: blob,
  headers: { "Content-Type": blob.type || "application/octet-stream" },
  signal,
});

export const info = async () => (await ask("/v1/info")).json();

export const decide = async (blob, fields, signal) =>
  (await ask(withFields("/v1/decide", { ...fields, view: "true" }), upload(blob, signal))).json();

export const annotate = async (blob, fields) =>
  (await ask(withFields("/v1/annotate", fields), upload(blob))).blob();

export const frame = async (style, number, signal) =>
  (await ask(withFields("/v1/frame.jpg", { style, frame: number }), { signal })).blob();

export const changeSource = async (fields) =>
  (await ask("/v1/source", {
    method: "PUT",
    body: JSON.stringify(fields),
    headers: { "Content-Type": "application/json" },
  })).json();
