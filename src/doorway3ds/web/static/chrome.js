// What stands round the decision: colours, and the link for other devices.
import { byId } from "./svg.js";

const NAMES = { auto: "Auto", light: "Light", dark: "Dark" };

export function prepareTheme() {
  const order = Object.keys(NAMES);
  let theme = "auto";
  try {
    theme = localStorage.getItem("theme") || theme;
  } catch { /* a browser that keeps nothing follows the system */ }
  const apply = () => {
    if (!NAMES[theme]) theme = "auto";
    document.documentElement.dataset.theme = theme;
    byId("theme-name").textContent = NAMES[theme];
    byId("theme").setAttribute("aria-label", `Colours: ${NAMES[theme].toLowerCase()}`);
  };
  byId("theme").addEventListener("click", () => {
    theme = order[(order.indexOf(theme) + 1) % order.length];
    try {
      localStorage.setItem("theme", theme);
    } catch { /* see above */ }
    apply();
  });
  apply();
}

export function prepareShare(link) {
  if (!link) return;
  byId("share").hidden = false;
  byId("share").addEventListener("click", () => {
    byId("share-code").src = "/v1/link.svg";
    byId("share-link").textContent = link;
    byId("share-box").showModal();
  });
}
