"""A headless Chromium, spoken to over its DevTools socket: as much as the tests of pages need."""

import base64
import json
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.sync.connection import Connection

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # 3-D without a graphics card
    *("--disable-sync", "--disable-background-networking", "--disable-component-update"),
    "--remote-debugging-port=0",
)
_COMPLAINTS = {"Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"}
_PATIENCE_S = 120.0  # a machine may have much else to do


class Tab:
    """One page of the browser.

    ``complaints`` holds what the console was told, ``requests`` every address asked for.
    """

    def __init__(self, socket: Connection) -> None:
        self.socket, self.session, self.last_id = socket, "", 0
        self.complaints: list[dict[str, Any]] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Runtime", "Log", "Page", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: object) -> dict[str, Any]:
        """Ask the browser, and keep what it says meanwhile."""
        self.last_id += 1
        message: dict[str, object] = {"id": self.last_id, "method": method, "params": params}
        self.socket.send(
            json.dumps(message | ({"sessionId": self.session} if self.session else {}))
        )
        while True:
            said = json.loads(self.socket.recv(timeout=_PATIENCE_S))
            if said.get("id") == self.last_id:
                return dict(said["result"])
            self._overhear(said)

    def run(self, expression: str) -> Any:
        """Evaluate JavaScript in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return answer["result"].get("value")

    def wait_until(self, expression: str) -> None:
        """Wait for a JavaScript expression to hold."""
        until = time.monotonic() + _PATIENCE_S
        while not self.run(expression):
            if time.monotonic() > until:
                raise TimeoutError(f"the page never came to {expression}; {self.complaints}")
            time.sleep(0.02)

    def go(self, url: str) -> None:
        """Open an address, or the same one again."""
        self.call("Page.navigate", url=url)
        self.wait_until("document.readyState === 'complete'")

    def size(self, width: int, height: int, *, dark: bool = False) -> None:
        """Take the size of a window or of a phone, and a light or dark taste."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=width < 600,
        )  # fmt: skip
        taste = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[taste])

    def picture(self) -> bytes:
        """Give the window as a PNG."""
        shot = self.call("Page.captureScreenshot", format="png")
        return base64.b64decode(shot["data"])

    def click(self, x: float, y: float) -> None:
        """Press and release at a place of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str, text: str = "") -> None:
        """Press a key where the focus is."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def _overhear(self, said: dict[str, Any]) -> None:
        if said.get("method") in _COMPLAINTS:
            self.complaints.append(said["params"])
        if said.get("method") == "Network.requestWillBeSent":
            self.requests.append(said["params"]["request"]["url"])


@contextmanager
def open_page(page: Path | str, profile: Path, *flags: str) -> Iterator[Tab]:
    """Open a file as a double click would, or an address, in a browser that was never used."""
    command = [str(CHROMIUM), *_FLAGS, *flags, f"--user-data-dir={profile}", "about:blank"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as browser:
        try:
            assert browser.stderr
            address = next(m[0] for line in browser.stderr if (m := re.search(r"ws://\S+", line)))
            with connect(address, max_size=None) as socket:
                tab = Tab(socket)
                tab.go(page if isinstance(page, str) else page.as_uri())
                yield tab
        finally:
            browser.kill()
