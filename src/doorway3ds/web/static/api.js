// The server's routes. A failed answer becomes an ApiError with the server's own words.
export class ApiError extends Error {
  // status 0: no answer came.
  constructor(status, code, message, retryAfterS = 0) {
    super(message);
    this.status = status;
    this.code = code;
    this.retryAfterS = retryAfterS;
  }
}

const FRAME_MS = 5000;
const DECIDE_MS = 20_000; // the server gives up before that

export async function ask(url, options) {
  let answer;
  try {
    answer = await fetch(url, { credentials: "same-origin", ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ApiError(0, "unreachable", "The server does not answer.", 2);
  }
  if (answer.ok) return answer;
  let told = { code: "", message: `the server answered ${answer.status}` };
  try {
    told = (await answer.json()).error;
  } catch { /* no JSON: the status must do */ }
  throw new ApiError(answer.status, told.code, told.message, Number(answer.headers.get("Retry-After") || 0));
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

export const decide = async (blob, fields, stopped) => {
  // To fetch, a body that cannot be read is a server that does not answer.
  await blob.slice(0, 1).arrayBuffer().catch(() => { throw new ApiError(0, "unreadable", "it cannot be read"); });
  const signal = AbortSignal.any([AbortSignal.timeout(DECIDE_MS), ...(stopped ? [stopped] : [])]);
  return (await ask(withFields("/v1/decide", { ...fields, view: "true" }), upload(blob, signal))).json();
};

export const annotate = async (blob, fields) =>
  (await ask(withFields("/v1/annotate", fields), upload(blob))).blob();

export const frame = async (style, number) => {
  const signal = AbortSignal.timeout(FRAME_MS);
  const fields = typeof number === "number" ? { style, frame: number } : { style };
  return (await ask(withFields("/v1/frame.jpg", fields), { signal })).blob();
};

const asJson = (method, fields) => ({
  method,
  body: JSON.stringify(fields),
  headers: { "Content-Type": "application/json" },
});

export const changeSource = async (fields) => (await ask("/v1/source", asJson("PUT", fields))).json();

const CALIBRATION = "/v1/calibration";

export const calibration = async () => (await ask(CALIBRATION)).json();
export const calibrate = async (fields) => (await ask(CALIBRATION, asJson("POST", fields))).json();
export const finishCalibration = async () => (await ask(`${CALIBRATION}/finish`, { method: "POST" })).json();
export const dropCalibration = async () => (await ask(CALIBRATION, { method: "DELETE" })).json();
export const boardPdf = (fields) => withFields(`${CALIBRATION}/board.pdf`, fields);
