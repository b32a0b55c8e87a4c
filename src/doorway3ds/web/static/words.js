// What went wrong, in words for people rather than for programs.
const LONGEST_NAME = 40;

export const shortened = (name) =>
  (name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 12)}…${name.slice(-10)}` : name);

// "the tap is dry" becomes a sentence; what begins with a name or an address keeps its first letter.
export function asSentence(text) {
  const words = (text || "").trim();
  if (!words) return "";
  const first = words.split(/[\s:]/, 1)[0];
  const start = /^[a-z]+$/.test(first) && !words.includes("://", first.length) ? words[0].toUpperCase() : words[0];
  return start + words.slice(1) + (/[.!?…]$/.test(words) ? "" : ".");
}

export function why(error, name = "The image") {
  const known = {
    unreachable: "The server does not answer.",
    unauthorized: "This page's token is no longer accepted. Open the link that the server printed again.",
    wrong_origin: "The server refuses this page. Open the link that the server printed.",
    wrong_host: "The server does not answer under this name. Open the link that the server printed.",
    no_image: `${shortened(name)} is empty.`,
    unreadable: `${shortened(name)} cannot be read. Is it a folder, or a file that has changed?`,
    too_large: `${shortened(name)} is larger than the server takes.`,
    busy: "The server is busy with other images.",
    too_slow: "The server took too long to decide.",
    too_slow_body: "The image took too long to reach the server.",
    no_frame: "The source has sent no image yet.",
    frame_gone: "That frame is gone. Press Pause first, then save.",
    bug: "The server failed on this image. Its log says more.",
  };
  return known[error.code] || asSentence(error.message);
}
