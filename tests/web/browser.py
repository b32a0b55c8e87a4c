"""A real Chromium with one page, for tests of pages."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.web.conftest import wait_for

_CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
_DRIVER = shutil.which("chromedriver")

needs_browser = [
    pytest.mark.browser,
    pytest.mark.skipif(_CHROMIUM is None, reason="Chromium is not installed"),
    pytest.mark.skipif(_DRIVER is None, reason="Chromium's driver is not installed"),
    pytest.mark.skipif(find_spec("selenium") is None, reason="selenium is not installed"),
]

_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
    "--host-resolver-rules=MAP doorbot.test 127.0.0.1",
)
_SECONDS = 60  # a machine at work may take its time


class Page:
    """A browser with one page; says what a person would read on it."""

    def __init__(self, folder: Path) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = _CHROMIUM or ""
        for flag in (*_FLAGS, f"--user-data-dir={folder}"):
            options.add_argument(flag)
        # The certificate made on the spot: a person would accept it once.
        options.accept_insecure_certs = True
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(_DRIVER))

    def open(self, url: str, width: int = 1280, height: int = 900) -> None:
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        self.driver.get(url)
        self.until(lambda: self.run("return document.body.dataset.mode"))

    def run(self, script: str, *arguments: object) -> object:
        return self.driver.execute_script(script, *arguments)

    def text(self, element: str) -> str:
        return str(self.run(f"return document.getElementById('{element}').textContent"))

    def click(self, element: str) -> None:
        self.run(f"document.getElementById('{element}').click()")

    def mode(self, name: str) -> None:
        self.run(f"document.querySelector('#modes [value={name}]').click()")

    def marks(self) -> int:
        found = self.run("return document.querySelectorAll('#marks .m-best').length")
        return int(str(found))

    def until(self, what: Callable[[], object]) -> object:
        return wait_for(what, _SECONDS)

    def give(self, data: bytes, event: str, *names: str) -> None:
        """Files of these names (room.jpg), all of the same bytes, dropped on or pasted into the
        page."""
        self.run(
            """
            const [bytes, kind, names] = arguments;
            const transfer = new DataTransfer();
            const kinds = { jpg: "image/jpeg", md: "text/markdown" };
            for (const name of names) {
              const type = kinds[name.split(".").at(-1)] || "";
              transfer.items.add(new File([new Uint8Array(bytes)], name, { type }));
            }
            const event = kind === "drop"
              ? new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true })
              : new ClipboardEvent("paste", { clipboardData: transfer, bubbles: true });
            document.getElementById("stage").dispatchEvent(event);
            """,
            list(data),
            event,
            names or ("room.jpg",),
        )

    def hide(self, hidden: bool) -> None:
        """As if another tab came before this one, or went."""
        self.run(
            """
            Object.defineProperty(document, "hidden", { value: arguments[0], configurable: true });
            document.dispatchEvent(new Event("visibilitychange"));
            """,
            hidden,
        )

    def orders(self) -> list[str]:
        """Whatever on the page could be taken for an order or for a fresh answer."""
        found = self.run(
            """
            const said = (id) => document.getElementById(id).textContent;
            const shown = (id) => !document.getElementById(id).hidden;
            return [
              said("headline").match(/^Turn|Facing/)?.[0],
              said("turn") !== "–" && said("turn"),
              said("chance-figure") !== "–" && said("chance-figure"),
              said("belief") !== "–" && said("belief"),
              document.querySelectorAll("#marks .m-best, #marks .m-way").length && "marks",
              document.querySelectorAll("#dial .d-needle").length && "needle",
              shown("pace") && said("pace"),
              !document.getElementById("save-json").disabled && "save",
              !("stale" in document.body.dataset) && "colours",
            ].filter(Boolean);
            """
        )
        return list(found)  # type: ignore[call-overload]

    def problems(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def weakest_contrast(self, theme: str) -> tuple[float, str]:
        """The lowest contrast of a text with its ground, and where it stands."""
        found = self.run(
            """
            document.documentElement.dataset.theme = arguments[0];
            const canvas = document.createElement("canvas");
            const probe = canvas.getContext("2d", { willReadFrequently: true });
            const rgb = (color) => {
              probe.clearRect(0, 0, 1, 1);
              probe.fillStyle = color;
              probe.fillRect(0, 0, 1, 1);
              return probe.getImageData(0, 0, 1, 1).data;
            };
            const light = (color) => [...rgb(color)].slice(0, 3).map((c) => c / 255)
              .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
              .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
            const ground = (e) => {
              for (; e; e = e.parentElement) {
                const color = getComputedStyle(e).backgroundColor;
                if (rgb(color)[3] > 250) return color;
              }
              return "white";
            };
            let found = [99, ""];
            const texts = "h1, h2, h3, p, span, output, dt, dd, button, a, label";
            for (const e of document.querySelectorAll(texts)) {
              if (!e.offsetParent || e.closest("#tags") || e.disabled) continue;
              if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
              const pair = [light(getComputedStyle(e).color), light(ground(e))];
              const ratio = (Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05);
              if (ratio < found[0]) found = [ratio, e.outerHTML.slice(0, 120)];
            }
            return found;
            """,
            theme,
        )
        return found[0], found[1]  # type: ignore[index]
