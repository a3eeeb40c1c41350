"""Check and draw the architecture: the packages, their layers and their imports.

    python scripts/architecture.py docs/pictures/architecture.png

An arrow points from a package to a package that it imports. Imports that follow from other imports (a over b to c) are
left out of the figure. The figure stores its graph as metadata, so a test can detect an outdated figure.
"""

import argparse
import ast
import json
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).parents[1] / "src" / "klute_sim"
LAYERS = {
    **{"files": 1, "laws": 1, "plausibility": 1, "effects": 2, "device": 3, "plant": 4, "recording": 4},
    **{"controllers": 4, "datasets": 5, "rendering": 5, "gait": 6, "bench": 6, "mechanism": 6},
    **{"comparison": 7, "diagnosis": 7, "mocap": 7, "sizing": 7, "walker": 7},
    **{"envs": 8, "reproduction": 8, "parameter_sweep": 9, "training": 9, "play": 9, "report": 10, "viewer": 11},
    **{"tuning": 12, "baselines": 12, "api": 13, "cli": 14},
}
"""Layer of each package. A package imports only from lower layers."""
COMMON_MODULES = {
    "constants",
    "errors",
    "mask_runs",
    "parameters",
    "provenance",
    "terminal_table",
    "types",
    "units",
    "",
}
"""Modules outside the packages that every package may import; they import no package."""
METADATA_KEY = "architecture"
"""Key of the import graph in the metadata of the figure."""
ImportGraph = dict[str, list[str]]


def find_imports(file: Path) -> set[str]:
    """Return the packages of klute_sim that ``file`` imports."""
    imports = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            if name and name.split(".")[0] == "klute_sim":
                imports.add(([*name.split("."), ""])[1])
    return imports - COMMON_MODULES


def find_package_imports(package: str) -> set[str]:
    """Return the other packages that ``package`` imports."""
    return set().union(*(find_imports(file) for file in (SOURCE / package).rglob("*.py"))) - {package}


def build_import_graph() -> ImportGraph:
    """Return the packages that each package imports, without imports that follow from others."""
    imports = {name: find_package_imports(name) for name in LAYERS}
    reachable: dict[str, set[str]] = {}
    for name in sorted(LAYERS, key=LAYERS.__getitem__):  # from the lowest layer, so that imports are complete
        reachable[name] = imports[name].union(*(reachable[lower] for lower in imports[name]))
    return {
        name: sorted(lower - set().union(*(reachable[other] for other in lower)))
        for name, lower in sorted(imports.items())
    }


def compute_positions(graph: ImportGraph) -> dict[str, tuple[float, float]]:
    """Return the position of each package: its layer, and a horizontal position that keeps arrows short."""
    order: dict[int, list[str]] = {}
    for name, layer in LAYERS.items():
        order.setdefault(layer, []).append(name)
    positions: dict[str, tuple[float, float]] = {}

    def spread(layer: int) -> None:
        names = order[layer]
        for k, name in enumerate(names):
            positions[name] = (k + 0.5) / len(names), float(layer)

    for layer in order:
        spread(layer)
    neighbours = {
        name: set(graph[name]) | {other for other, lower in graph.items() if name in lower} for name in LAYERS
    }

    def mean_position(name: str) -> float:
        return sum(positions[other][0] for other in neighbours[name]) / max(len(neighbours[name]), 1)

    for _ in range(20):
        for layer in sorted(order):
            order[layer].sort(key=mean_position)
            spread(layer)
    return positions


def draw_architecture(file: Path) -> None:
    """Draw the architecture into ``file``, a PNG."""
    from matplotlib import pyplot as plt

    graph = build_import_graph()
    positions = compute_positions(graph)
    figure, axes = plt.subplots(figsize=(9.0, 8.0), layout="constrained")
    style: dict[str, Any] = {"boxstyle": "round,pad=0.35", "edgecolor": "0.35"}
    boxes = {}
    for name, (x, y) in positions.items():
        shade = plt.get_cmap("YlGnBu")(0.05 + 0.35 * (y - 1) / max(LAYERS.values()))
        boxes[name] = axes.text(
            *(x, y, name), ha="center", va="center", fontsize=11, zorder=3, bbox={**style, "facecolor": shade}
        )
    for name, imports in graph.items():
        for other in imports:
            bend = 0.0 if LAYERS[name] - LAYERS[other] == 1 else 0.12
            axes.annotate(
                *("", positions[other]),
                xytext=positions[name],
                zorder=2,
                arrowprops={
                    **{"arrowstyle": "-|>", "color": "0.5", "connectionstyle": f"arc3,rad={bend}", "shrinkB": 3},
                    **{"patchA": boxes[name].get_bbox_patch(), "patchB": boxes[other].get_bbox_patch()},
                },
            )
    axes.set(xlim=(-0.02, 1.02), ylim=(0.4, max(LAYERS.values()) + 0.6), yticks=sorted(set(LAYERS.values())))
    axes.set_ylabel("layer")
    axes.set_xticks([])
    axes.spines[:].set_visible(False)
    axes.grid(axis="y", color="0.92")
    axes.tick_params(length=0)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=80, metadata={METADATA_KEY: json.dumps(graph)})
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="PNG file of the figure")
    draw_architecture(parser.parse_args().file)
