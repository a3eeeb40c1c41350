"""Make every picture, and every page that is made, of the documentation again.

    python scripts/pictures.py

Needs the extra 'rerun'. Takes some minutes; look at what has changed before it is committed.
"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"
SCRIPTS = {
    "house.py": DOCS / "pictures" / "house.png",
    "view_pictures.py": DOCS / "pictures",
    "effect_pages.py": DOCS / "effects",
}
"""Script -> what it writes."""


def main() -> int:
    """Run them all; the first that fails ends it."""
    for script, place in SCRIPTS.items():
        print(script, flush=True)
        code = subprocess.run([sys.executable, str(HERE / script), str(place)], check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
