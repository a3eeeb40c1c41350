"""Regenerate the figures of the viewer in the documentation: a gait run, a walk and the example diagnosis.

    python scripts/view_pictures.py docs/pictures

Requires the extra 'rerun'.
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
"""Number of colours of a figure; sufficient for lines and maps at a quarter of the file size."""
WIDTH_PIXELS = 1200
"""Width of a figure [pixels]."""
EFFECT_OPTIONS = ["--only", "braid_hysteresis", "--only", "seal_friction"]
"""Effects that the diagnosis considers, which limits its duration."""
VIEWS = {
    "gait": (["gait", "--strides", "2"], ["--at", "50"]),
    "walk": (["walk", "--seconds", "8"], []),
    "diagnose": (["diagnose", "data", "--example", *EFFECT_OPTIONS], []),
}
"""Command that creates the folder, and options of the view, by name of the figure."""
DIGEST_KEY = "workbench"
"""Metadata key of the digest of the code that drew a figure."""


def compute_digest() -> str:
    """Return the digest of the code that draws the figures."""
    sources = sorted(Path(viewer.__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()


def run_cli(*arguments: str) -> None:
    """Run one command; raises SystemExit when it fails."""
    try:
        klute_sim(arguments)
    except SystemExit as exit_error:
        if exit_error.code:
            raise


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        for name, (command, view_options) in VIEWS.items():
            run_folder, figure = Path(temporary) / name, folder / f"view-{name}.png"
            arguments = [str(Path(temporary) / word) if word == "data" else word for word in command]
            run_cli(*arguments, "--out", str(run_folder))
            run_cli("view", str(run_folder), "--picture", str(figure), *view_options)
            with Image.open(figure) as image:
                resized = image.convert("RGB").resize((WIDTH_PIXELS, round(WIDTH_PIXELS * image.height / image.width)))
            reduced = resized.quantize(MAX_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
            metadata = PngInfo()
            metadata.add_text(DIGEST_KEY, compute_digest())
            reduced.save(figure, optimize=True, pnginfo=metadata)
    return 0


if __name__ == "__main__":
    sys.exit(main())
