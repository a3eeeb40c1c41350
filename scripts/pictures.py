"""Regenerate all figures and generated pages of the documentation.

    python scripts/pictures.py

Requires the extras 'rerun', 'rendering' and 'tune', and takes some minutes. Inspect the changes before committing them.
"""

import subprocess
import sys
from pathlib import Path

SCRIPTS_FOLDER = Path(__file__).parent
DOCS_FOLDER = SCRIPTS_FOLDER.parent / "docs"
SCRIPT_OUTPUTS = {
    "architecture.py": DOCS_FOLDER / "pictures" / "architecture.png",
    "command_pictures.py": DOCS_FOLDER / "pictures",
    "first_screen.py": DOCS_FOLDER / "pictures",
    "effect_pages.py": DOCS_FOLDER / "effects",
}
"""Output of each script."""
MODULE_OUTPUTS = {"benchmarks.effect_sizes": DOCS_FOLDER / "effect-sizes.md"}
"""Output of each module of the benchmarks."""


def main() -> int:
    """Run all commands; stop at the first failure and return its exit code."""
    commands = [[str(SCRIPTS_FOLDER / script), str(output)] for script, output in SCRIPT_OUTPUTS.items()]
    commands += [["-m", module, str(output)] for module, output in MODULE_OUTPUTS.items()]
    for command in commands:
        print(*command, flush=True)
        exit_code = subprocess.run([sys.executable, *command], cwd=SCRIPTS_FOLDER.parent, check=False).returncode
        if exit_code:
            return exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
