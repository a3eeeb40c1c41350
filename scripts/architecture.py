"""The house as it is: which package imports from which, held against its floors and drawn.

    python scripts/house.py docs/pictures/house.png

An arrow leads from a package to one that it imports from. One that follows from others (a over b to c) is left out,
or nothing could be seen. The picture carries what it shows, so that a test can say when it is old.
"""

import ast
import json
import sys
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).parents[1] / "src" / "klute_sim"
LAYERS = {
    **{"laws": 1, "effects": 2, "device": 3, "plant": 4, "recording": 4, "dataset": 5, "formats": 5, "control": 5},
    **{"rigs": 6, "compare": 6, "diagnose": 7, "envs": 7, "design": 7, "motion": 7, "reproduce": 8, "learn": 8},
    **{"report": 9, "sweep": 10, "tuning": 11, "baselines": 11, "cli": 12},
}
"""Package -> floor. Imports go down, never up or across."""
COMMON_MODULES = {"errors", "units", "provenance", "registration", ""}
"""Modules beside the packages, which all may import."""
METADATA_KEY = "house"
"""Under which the picture carries what it shows."""
ImportGraph = dict[str, list[str]]


def find_imports(file: Path) -> set[str]:
    """Packages and modules of klute_sim that ``file`` imports from."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            if name and name.split(".")[0] == "klute_sim":
                found.add(([*name.split("."), ""])[1])
    return found - COMMON_MODULES


def build_import_graph() -> ImportGraph:
    """Package -> those it imports from, without what follows from others."""
    direct = {
        name: set().union(*(find_imports(file) for file in (SOURCE / name).rglob("*.py"))) - {name} for name in LAYERS
    }
    reach: dict[str, set[str]] = {}
    for name in sorted(LAYERS, key=LAYERS.__getitem__):  # from the ground up: what is below is known
        reach[name] = direct[name].union(*(reach[below] for below in direct[name]))
    return {
        name: sorted(below - set().union(*(reach[other] for other in below))) for name, below in sorted(direct.items())
    }


def compute_positions(graph: ImportGraph) -> dict[str, tuple[float, float]]:
    """Package -> where its box is: its floor, and on it where its arrows are short."""
    order: dict[int, list[str]] = {}
    for name, floor in LAYERS.items():
        order.setdefault(floor, []).append(name)
    found: dict[str, tuple[float, float]] = {}

    def spread(floor: int) -> None:
        names = order[floor]
        for k, name in enumerate(names):
            found[name] = (k + 0.5) / len(names), float(floor)

    for floor in order:
        spread(floor)
    near = {name: set(graph[name]) | {other for other, below in graph.items() if name in below} for name in LAYERS}
    for _ in range(20):
        for floor in sorted(order):
            order[floor].sort(key=lambda name: sum(found[each][0] for each in near[name]) / max(len(near[name]), 1))
            spread(floor)
    return found


def draw_architecture(file: Path) -> None:
    """Draw the house into ``file``, a PNG."""
    from matplotlib import pyplot as plt

    graph = build_import_graph()
    where = compute_positions(graph)
    figure, axes = plt.subplots(figsize=(9.0, 8.0), layout="constrained")
    style: dict[str, Any] = {"boxstyle": "round,pad=0.35", "edgecolor": "0.35"}
    boxes = {}
    for name, (x, y) in where.items():
        shade = plt.get_cmap("YlGnBu")(0.05 + 0.35 * (y - 1) / max(LAYERS.values()))
        boxes[name] = axes.text(
            *(x, y, name), ha="center", va="center", fontsize=11, zorder=3, bbox={**style, "facecolor": shade}
        )
    for name, below in graph.items():
        for other in below:
            bend = 0.0 if LAYERS[name] - LAYERS[other] == 1 else 0.12
            axes.annotate(
                *("", where[other]),
                xytext=where[name],
                zorder=2,
                arrowprops={
                    **{"arrowstyle": "-|>", "color": "0.5", "connectionstyle": f"arc3,rad={bend}", "shrinkB": 3},
                    **{"patchA": boxes[name].get_bbox_patch(), "patchB": boxes[other].get_bbox_patch()},
                },
            )
    axes.set(xlim=(-0.02, 1.02), ylim=(0.4, max(LAYERS.values()) + 0.6), yticks=sorted(set(LAYERS.values())))
    axes.set_ylabel("floor")
    axes.set_xticks([])
    axes.spines[:].set_visible(False)
    axes.grid(axis="y", color="0.92")
    axes.tick_params(length=0)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=80, metadata={METADATA_KEY: json.dumps(graph)})
    plt.close(figure)


if __name__ == "__main__":
    draw_architecture(Path(sys.argv[1]))
