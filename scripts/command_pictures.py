"""Draw the pictures of the commands in the documentation: their figures, and their output in the viewer.

    python scripts/command_pictures.py docs/pictures
    python scripts/command_pictures.py docs/pictures --only gait --only view-gait

Requires the extras 'rerun', 'rendering' and 'tune', and takes some minutes. A test compares the digest in each picture
with that of its commands and of the code that draws it.
"""

import argparse
import base64
import contextlib
import hashlib
import io
import re
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from PIL.PngImagePlugin import PngInfo

import klute_sim
from klute_sim.cli import main as run_klute_sim

MAX_COLOURS = 64
"""Number of colours of a picture; sufficient for lines and maps at a quarter of the file size."""
MAX_WIDTH_PIXELS = 1200
"""Largest width of a picture [pixels]."""
DIGEST_KEY = "drawing"
"""Metadata key of the digest."""
SOURCE = Path(klute_sim.__file__).parent
EMBEDDED_PNG = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")
"""A picture in a page."""
GAIT = "gait --strides 3 --out gait"
WALK = "walk --seconds 8 --out walk"
DIAGNOSE = "diagnose data --example --only braid_hysteresis --only seal_friction --out diagnose"
"""Commands whose output several pictures show; two effects limit the duration of the diagnosis."""


class CommandPicture(NamedTuple):
    """Commands, executed in an empty folder, and the picture that they write."""

    commands: tuple[str, ...]
    output: str
    """PNG file, or page whose first picture is taken."""
    sources: tuple[str, ...]
    """Files and folders of the package that draw it, besides the common style."""


PICTURES = {
    "gait": CommandPicture((GAIT,), "gait/figure.png", ("report/gait/figure.py",)),
    "walk": CommandPicture((WALK,), "walk/figure.png", ("report/walk/figure.py",)),
    "bench": CommandPicture(("bench isometric --out bench",), "bench/figure.png", ("report/bench/figure.py",)),
    "joint": CommandPicture(("bench joint --out joint",), "joint/figure.png", ("report/joint/figure.py",)),
    "compare": CommandPicture(
        (GAIT, "gait --strides 3 --controller machine --out machine", "compare gait machine --reference --out compare"),
        "compare/comparison.png",
        ("report/comparison/figures.py",),
    ),
    "import": CommandPicture(
        (
            "gait --strides 4 --out run",
            "export run --out lab",
            "import lab/angles.mot lab/ground_reaction.mot lab/moments.sto --mass 75 --out me",
            "gait --reference me --strides 2 --out simulated",
            "compare me/strides_right.parquet simulated --out imported",
        ),
        "imported/comparison.png",
        ("report/comparison/figures.py",),
    ),
    "sweep": CommandPicture(
        ("sweep --controller profile --controller off --mass 60,75,90 --strides 1 --step 1 --out sweep",),
        "sweep/figure.png",
        ("report/sweep/figure.py",),
    ),
    "design": CommandPicture(("design --mass 75 --out design",), "design/figure.png", ("report/design/figure.py",)),
    "tune": CommandPicture(("tune --budget 120 --out tune",), "tune/figure.png", ("report/tuning/figure.py",)),
    "baselines": CommandPicture(
        ("baselines --strides 2 --step 1 --out baselines",), "baselines/figure.png", ("report/sweep/figure.py",)
    ),
    "assess": CommandPicture(
        ("assess --only tuned --only hand-tuned --only spring-foot-6 --strides 2 --step 1 --out assess",),
        "assess/index.html",
        ("report/assessment/figure.py",),
    ),
    "reproduce": CommandPicture(
        ("reproduce --out reproduce",), "reproduce/fig-8.7.png", ("report/reproduction/figures.py",)
    ),
    "view-gait": CommandPicture((GAIT, "view gait --picture view-gait.png --at 50"), "view-gait.png", ("viewer",)),
    "view-walk": CommandPicture((WALK, "view walk --picture view-walk.png"), "view-walk.png", ("viewer",)),
    "view-diagnose": CommandPicture(
        (DIAGNOSE, "view diagnose --picture view-diagnose.png"), "view-diagnose.png", ("viewer",)
    ),
}
"""Picture by name."""


def compute_digest(name: str) -> str:
    """Return the digest of the commands of a picture and of the code that draws it."""
    picture = PICTURES[name]
    paths = [SOURCE / source for source in (*picture.sources, "report/style.py")]
    files = sorted(file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path]))
    content = [line.encode() for line in picture.commands]
    content += [file.read_bytes().replace(b"\r\n", b"\n") for file in files]
    return hashlib.sha256(b"\n".join(content)).hexdigest()


def read_digest(path: Path) -> str:
    """Return the digest in a picture."""
    with Image.open(path) as image:
        return str(image.info[DIGEST_KEY])


def run_command(command: str) -> None:
    """Run one command; raises SystemExit when it fails."""
    print(f"klute-sim {command}", flush=True)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run_klute_sim(command.split())
    except SystemExit as exit_error:
        if exit_error.code:
            raise


def open_picture(path: Path) -> Image.Image:
    """Return the picture in a PNG file, or the first one in a page."""
    if path.suffix == ".png":
        return Image.open(path)
    match = EMBEDDED_PNG.search(path.read_text("utf-8"))
    if match is None:
        raise ValueError(f"{path.name} has no picture")
    return Image.open(io.BytesIO(base64.b64decode(match[1])))


def save_picture(image: Image.Image, path: Path, digest: str) -> None:
    """Write ``image`` with few colours and ``digest``."""
    width = min(image.width, MAX_WIDTH_PIXELS)
    resized = image.convert("RGB").resize((width, round(width * image.height / image.width)), Image.Resampling.LANCZOS)
    reduced = resized.quantize(MAX_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    metadata = PngInfo()
    metadata.add_text(DIGEST_KEY, digest)
    reduced.save(path, optimize=True, pnginfo=metadata)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--only", action="append", choices=PICTURES, metavar="NAME", help="picture to draw; repeatable")
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    executed: set[str] = set()
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        for name in options.only or PICTURES:
            for command in PICTURES[name].commands:
                if command not in executed:
                    run_command(command)
                    executed.add(command)
            with open_picture(Path(PICTURES[name].output)) as image:
                save_picture(image, folder / f"{name}.png", compute_digest(name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
