"""Make every picture, and every page that is made, of the documentation again.

    python scripts/pictures.py

Needs the extra 'rerun'. Takes some minutes; look at what has changed before it is committed.
"""

import subprocess
import sys
from pathlib import Path

SCRIPTS_FOLDER = Path(__file__).parent
DOCS_FOLDER = SCRIPTS_FOLDER.parent / "docs"
SCRIPT_OUTPUTS = {
    "house.py": DOCS_FOLDER / "pictures" / "house.png",
    "view_pictures.py": DOCS_FOLDER / "pictures",
    "effect_pages.py": DOCS_FOLDER / "effects",
}
"""Script -> what it writes."""


def main() -> int:
    """Run them all; the first that fails ends it."""
    for script, place in SCRIPT_OUTPUTS.items():
        print(script, flush=True)
        code = subprocess.run([sys.executable, str(SCRIPTS_FOLDER / script), str(place)], check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
