"""Make the pictures of docs/view.md again: the windows of a walk and of the example's diagnosis.

    python scripts/view_pictures.py docs/pictures

Needs the extra 'rerun'.
"""

import argparse
import hashlib
import sys
import tempfile
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from klute_sim import viewer
from klute_sim.cli import main as klute_sim

MAX_COLOURS = 128
"""Of a picture: enough for lines and maps, and a quarter of the size."""
WIDTH_PIXELS = 1200
"""[pixels]"""
EFFECT_OPTIONS = ["--only", "braid_hysteresis", "--only", "seal_friction"]
"""Effects that are looked for, so that it does not take long."""
VIEWS = {
    "gait": (["gait", "--strides", "2"], ["--at", "1.65"]),
    "diagnose": (["diagnose", "data", "--example", *EFFECT_OPTIONS], []),
}
"""Name of the picture -> the command that makes the folder, and options of the view."""
DIGEST_KEY = "workbench"
"""Under which a picture carries the digest of the code that drew it."""


def compute_digest() -> str:
    """Of the code that the pictures show."""
    sources = sorted(Path(viewer.__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()


def run_cli(*arguments: str) -> None:
    """One command; raises SystemExit if it fails."""
    try:
        klute_sim(arguments)
    except SystemExit as left:
        if left.code:
            raise


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as home:
        for name, (command, view) in VIEWS.items():
            made, picture = Path(home) / name, folder / f"view-{name}.png"
            own = [str(Path(home) / word) if word == "data" else word for word in command]
            run_cli(*own, "--out", str(made))
            run_cli("view", str(made), "--picture", str(picture), *view)
            with Image.open(picture) as drawn:
                small = drawn.convert("RGB").resize((WIDTH_PIXELS, round(WIDTH_PIXELS * drawn.height / drawn.width)))
            few = small.quantize(MAX_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
            about = PngInfo()
            about.add_text(DIGEST_KEY, compute_digest())
            few.save(picture, optimize=True, pnginfo=about)
    return 0


if __name__ == "__main__":
    sys.exit(main())
