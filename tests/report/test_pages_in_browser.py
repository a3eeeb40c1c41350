"""Pages in Chromium, without a display: nothing is missing, blocked, or wider than the window."""

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import figures, page
from tests.command_line import run

pytestmark = pytest.mark.extras

ROOT = Path(__file__).parents[2]
WIDTHS = (390, 1000, 1400)
"""Widths of a phone, a tablet and a laptop [pixels]."""
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
MEASURE_SCRIPT = """<script>
addEventListener("load", () => {
  const images = [...document.images];
  const ids = [...document.querySelectorAll("[id]")].map((element) => element.id);
  parent.postMessage(JSON.stringify({
    window: innerWidth,
    content: document.documentElement.scrollWidth,
    images: images.length,
    broken: images.filter((image) => image.loading != "lazy" && !image.naturalWidth).map((image) => image.alt),
    unnamed: images.filter((image) => !image.alt).length,
    repeated: ids.filter((id, index) => ids.indexOf(id) != index),
  }), "*");
});
</script>"""
FRAME_PAGE = """<!DOCTYPE html><title>frame</title><body>
<iframe src="{file}" width="{width}" height="900" style="border: 0"></iframe>
<script>
addEventListener("message", (event) => {{ document.body.textContent = "measured:" + event.data + ":end"; }});
</script>
"""
"""A window of Chromium is at least 500 pixels wide, a frame in it may be narrower."""


@pytest.fixture(scope="session")
def chromium() -> str:
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium on the PATH (Debian: apt install chromium)")
    return program


@pytest.fixture(scope="module")
def pages(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    figures.save_figures(diagnosis, folder / "diagnosis")
    page.write_page(diagnosis, folder / "diagnosis")
    for name, controller in (("a", "profile"), ("b", "off")):
        run("gait", "--controller", controller, "--strides", "2", "--step", "1", "--out", name, cwd=folder)
    completed = run("compare", "a", "b", "--out", "compared", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(ROOT / "docs"), str(folder / "site")]
    assert subprocess.run(command, check=False).returncode == 0
    site = {f"site/{name}": folder / "site" / f"{name}.html" for name in ("index", "diagnose", "effects", "api/laws")}
    reports = {"diagnosis": "diagnosis", "comparison": "compared", "gait": "a"}
    return {name: folder / run_folder / "index.html" for name, run_folder in reports.items()} | site


def browse(chromium: str, file: Path, width: int, profile: Path) -> tuple[str, str]:
    """Return the document and the messages of the console."""
    command = [chromium, "--headless", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]
    command += ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium refuses its sandbox to root
    command += [f"--user-data-dir={profile}", f"--window-size={width},900", "--virtual-time-budget=5000", "--dump-dom"]
    completed = subprocess.run(
        [*command, file.as_uri()], capture_output=True, text=True, check=False, timeout=120, errors="replace"
    )
    assert completed.returncode == 0, completed.stderr[-2000:]
    return completed.stdout, "\n".join(line for line in completed.stderr.splitlines() if "CONSOLE" in line)


@pytest.mark.parametrize(
    "name", ["diagnosis", "comparison", "gait", "site/index", "site/diagnose", "site/effects", "site/api/laws"]
)
def test_page_is_complete_and_fits_the_window(name: str, chromium: str, pages: dict[str, Path], tmp_path: Path) -> None:
    document, messages = browse(chromium, pages[name], WIDTHS[-1], tmp_path / "profile")
    assert "<h1" in document
    assert messages == ""
    text = pages[name].read_text("utf-8")
    copy = pages[name].with_name(f"measured-{pages[name].name}")
    copy.write_text(
        POLICY.sub("", text).replace("</head>", MEASURE_SCRIPT + "</head>", 1), "utf-8"
    )  # the policy forbids scripts
    frame = copy.with_name(f"framed-{pages[name].name}")
    for width in WIDTHS:
        frame.write_text(FRAME_PAGE.format(file=copy.name, width=width), "utf-8")
        document, _ = browse(chromium, frame, WIDTHS[-1], tmp_path / "profile")
        found = re.search(r"measured:(.*?):end", document, re.DOTALL)
        assert found is not None
        measured = json.loads(html.unescape(found[1]))
        assert measured["window"] == width
        assert measured["content"] <= width, f"{name} is {measured['content']} pixels wide in a window of {width}"
        assert measured["broken"] == []
        assert measured["unnamed"] == 0
        assert measured["repeated"] == []


def test_report_runs_no_script_and_loads_nothing_from_the_network(pages: dict[str, Path]) -> None:
    for name in ("diagnosis", "comparison", "gait"):
        text = pages[name].read_text("utf-8")
        assert "default-src 'none'" in text
        assert "<script" not in text
        assert not re.search(r'(?:src|href)="https?:', text)
