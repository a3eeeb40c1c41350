"""Regenerate all figures and generated pages of the documentation.

    python scripts/pictures.py

Requires the extra 'rerun' and takes some minutes. Inspect the changes before committing them.
"""

import subprocess
import sys
from pathlib import Path

SCRIPTS_FOLDER = Path(__file__).parent
DOCS_FOLDER = SCRIPTS_FOLDER.parent / "docs"
SCRIPT_OUTPUTS = {
    "architecture.py": DOCS_FOLDER / "pictures" / "architecture.png",
    "view_pictures.py": DOCS_FOLDER / "pictures",
    "effect_pages.py": DOCS_FOLDER / "effects",
}
"""Output of each script."""


def main() -> int:
    """Run all scripts; stop at the first failure and return its exit code."""
    for script, output in SCRIPT_OUTPUTS.items():
        print(script, flush=True)
        exit_code = subprocess.run([sys.executable, str(SCRIPTS_FOLDER / script), str(output)], check=False).returncode
        if exit_code:
            return exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
