"""The page of raylift serve in Chromium: a photograph is localized and lies under the mesh from its pose."""

import base64
import http.server
import os
import re
import shutil
import subprocess
import threading
import urllib.request
from pathlib import Path
from typing import Iterator

import pytest

import raylift
from scenes import DEMO
from served import CRS, QUERIES, Server, cached, photograph

CHROMIUM = shutil.which("chromium") or ""
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="chromium is not installed")

# Chooses the photograph as a visitor would; what it then shows is told in the title.
CHOOSE = """
<script>
(async () => {
  const bytes = Uint8Array.from(atob("%s"), (c) => c.charCodeAt(0));
  const scenes = setInterval(() => {
    if (!$("scene").options.length) return;
    clearInterval(scenes);
    $("camera").value = "%s";
    const chosen = new DataTransfer();
    chosen.items.add(new File([bytes], "photo.jpg", {type: "image/jpeg"}));
    $("file").files = chosen.files;
    $("file").dispatchEvent(new Event("change"));
  }, 20);
  $("mesh").addEventListener("load", () => {
    document.title = ["mesh", $("mesh").naturalWidth, $("mesh").naturalHeight,
                      document.documentElement.scrollWidth <= innerWidth ? "fits" : "is too wide"].join(" ");
  });
})();
</script>
"""


class Proxy(http.server.BaseHTTPRequestHandler):
    """Hands requests on, and adds a script to the page."""
    url = script = ""

    def do_GET(self) -> None:
        with urllib.request.urlopen(self.url + self.path) as answer:
            body = answer.read()
            if self.path == "/":
                body = body.replace(b"</body>", self.script.encode() + b"</body>")
            self.answer(answer.status, answer.headers["Content-Type"], body)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        request = urllib.request.Request(self.url + self.path, data=body,
                                         headers={"Content-Type": self.headers["Content-Type"]})
        with urllib.request.urlopen(request) as answer:
            self.answer(answer.status, answer.headers["Content-Type"], answer.read())

    def answer(self, status: int, content_type: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *_: object) -> None:
        pass


def look(url: str, width: int, *options: str) -> str:
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", f"--window-size={width},1000",
               "--virtual-time-budget=60000", *options, url]
    # A browser hangs where the address sanitizer's library is loaded into it.
    env = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
    return str(subprocess.run(command, capture_output=True, text=True, timeout=600, check=True, env=env).stdout)


@pytest.fixture(scope="module")
def page(run: Path) -> Iterator[str]:
    name = sorted(QUERIES)[0]
    Proxy.script = CHOOSE % (base64.b64encode(photograph(name)).decode(), QUERIES[name])
    with Server(*cached(run), "--crs", CRS) as server, \
            http.server.ThreadingHTTPServer(("127.0.0.1", 0), Proxy) as proxy:
        Proxy.url = server.url
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{proxy.server_port}/"
        proxy.shutdown()


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_photograph_is_seen_with_the_mesh_from_its_pose(page: str, tmp_path: Path, width: int,
                                                          scheme: str) -> None:
    dark = ["--blink-settings=preferredColorScheme=0"] if scheme == "dark" else []
    dom = look(page, width, *dark, "--dump-dom")
    assert "photo.jpg: localized" in dom
    assert re.search("<title>mesh 640 480 fits</title>", dom), re.search("<title>.*</title>", dom)
    assert "On the earth" in dom
    picture = tmp_path / f"{scheme}_{width}.png"
    look(page, width, *dark, f"--screenshot={picture}")
    assert picture.stat().st_size > 20000


def test_a_notebook_shows_a_report(tmp_path: Path) -> None:
    """As a notebook does: what _repr_html_ returns stands in its page."""
    raylift.doctor(DEMO / "model", f"mesh:{DEMO / 'scene.obj'}", images=DEMO / "images", max_features=200,
                   report=tmp_path / "report")
    report = raylift.Report(tmp_path / "report")
    assert repr(report) == f"<raylift.Report {tmp_path / 'report/index.html'}>"
    tell = """<script>
document.querySelector("iframe").addEventListener("load", (event) => {
  const shown = event.target.contentDocument;
  document.title = [shown.documentElement.dataset.ready, shown.querySelectorAll("section").length].join(" ");
});
</script>"""
    (tmp_path / "notebook.html").write_text(report._repr_html_() + tell, encoding="utf-8")
    assert report._repr_html_().isascii() and not report.path.read_text(encoding="utf-8").isascii()
    dom = look((tmp_path / "notebook.html").as_uri(), 1280, "--dump-dom")
    assert re.search(r"<title>\w+ [1-9]\d*</title>", dom), re.search("<title>.*</title>", dom)
