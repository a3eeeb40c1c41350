"""Pages in Chromium, without a display: nothing is missing, blocked, faint, or wider than the window."""

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
REPORTS = {"diagnosis": "diagnosis", "comparison": "compared", "gait": "a"}
"""Report -> its folder."""
SITE_PAGES = (
    *("index", "install", "gallery", "diagnose", "devices", "effects", "effects/braid_hysteresis", "environment"),
    *("api/laws", "tutorials/first_gait_simulation"),
)
"""Pages of the site, one of each kind."""
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
MEASURE_SCRIPT = """<script>
const parse = (text) => text.match(/[\\d.]+/g).map(Number);
const blend = (top, opacity, below) => below.map((value, k) => value * (1 - opacity) + top[k] * opacity);
const luminance = (colour) => {
  const linear = colour.map((value) => value / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
};
const readBackground = (element) => {
  if (!element) return [255, 255, 255];
  const [red, green, blue, opacity = 1] = parse(getComputedStyle(element).backgroundColor);
  return opacity == 1 ? [red, green, blue] : blend([red, green, blue], opacity, readBackground(element.parentElement));
};
const findFaintText = () => {
  const faint = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement, style = getComputedStyle(element);
    const box = element.getBoundingClientRect(), text = walker.currentNode.textContent.trim();
    if (!text || style.visibility == "hidden" || box.width < 2 || box.height < 2) continue;
    const behind = readBackground(element), [red, green, blue, opacity = 1] = parse(style.color);
    const tones = [luminance(blend([red, green, blue], opacity, behind)), luminance(behind)];
    const contrast = (Math.max(...tones) + 0.05) / (Math.min(...tones) + 0.05);
    const sufficient = parseFloat(style.fontSize) >= 24 ? 3 : 4.5;
    if (contrast < sufficient) faint.push(`${text.slice(0, 30)}: ${contrast.toFixed(2)}`);
  }
  return faint;
};
addEventListener("load", () => {
  const images = [...document.images];
  const faint = ["light", "dark"].flatMap((theme) => {
    document.body.dataset.theme = theme;  // the site; reports have tests of their colours
    return findFaintText();
  });
  const ids = [...document.querySelectorAll("[id]")].map((element) => element.id);
  parent.postMessage(JSON.stringify({
    window: innerWidth,
    content: document.documentElement.scrollWidth,
    images: images.length,
    broken: images.filter((image) => image.loading != "lazy" && !image.naturalWidth).map((image) => image.alt),
    unnamed: images.filter((image) => !image.alt).length,
    faint: faint,
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
    site = {f"site/{name}": folder / "site" / f"{name}.html" for name in SITE_PAGES}
    return {name: folder / run_folder / "index.html" for name, run_folder in REPORTS.items()} | site


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


@pytest.mark.parametrize("name", [*REPORTS, *(f"site/{name}" for name in SITE_PAGES)])
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
        assert measured["faint"] == [], "contrast below that of WCAG 2.2, level AA"


def test_report_runs_no_script_and_loads_nothing_from_the_network(pages: dict[str, Path]) -> None:
    for name in REPORTS:
        text = pages[name].read_text("utf-8")
        assert "default-src 'none'" in text
        assert "<script" not in text
        assert not re.search(r'(?:src|href)="https?:', text)
