"""Write a page for each effect of the catalogue, and an overview of effects that are hard to distinguish.

    python scripts/effect_pages.py docs/effects

The pages contain the text of ``klute-sim effects NAME``. The simulated results are stored beside them in
``confusable.json``, with the digest of the code that produced them. The script takes less than a minute on one core.
"""

import argparse
import ast
import hashlib
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import klute_sim
from klute_sim.cli.console import progress_bar
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.planning.identifiability import (
    INDISTINGUISHABLE_COSINE,
    compute_identifiability,
    find_indistinguishable_classes,
    remove_base_effect,
    to_json_rows,
)
from klute_sim.diagnosis.planning.proposals import RIG_CHANGES
from klute_sim.diagnosis.planning.signatures import simulate_effect_responses
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect
from klute_sim.report.diagnosis.text import join_words
from klute_sim.report.effects import figures as effects_figures
from klute_sim.report.effects import text as words
from klute_sim.report.effects.formulas import format_equation
from klute_sim.types import ProgressCallback

COMMAND = "python scripts/effect_pages.py docs/effects"
GENERATED_MARK = f"<!-- Written by `{COMMAND}`. Change the catalogue instead. -->\n"
DATA_FILE, INDEX_FILE, PICTURES_FOLDER = "confusable.json", "README.md", "pictures"
SIGNIFICANT_DIGITS = 3
"""Significant digits of stored numbers, which are equal on all machines."""
CONFUSION_TABLE_HEAD = (
    "typical size over noise",
    "left after refitting",
    "class size",
    "similar to",
    "|cos|",
    "separated by",
    "remaining cosine",
)
"""Columns of the table of confusions; :data:`INDEX_FILE` explains them."""
EFFECTS_DRAWN_PER_ANALYSIS = 10.0
"""Number of effects that are drawn in the time of one analysis of all signatures."""
SIMULATION_SOURCES = (
    *("laws/*.py", "effects/**/*.py", "device/dynamics.py", "device/rollout.py", "diagnosis/planning/signatures.py"),
    *("diagnosis/planning/identifiability.py", "diagnosis/experiments/base.py", "diagnosis/experiments/bench.py"),
    *("diagnosis/fitting/hypothesis.py", "bench/protocols/*.py"),
)
"""Files whose code determines the simulated results."""


UNDRAWN_KINDS = ("body", "mechanism")
"""Kinds of effects that no protocol of the bench shows."""


def compute_digest() -> str:
    """Return the digest of :data:`SIMULATION_SOURCES` and of the device parameters, without comments and docstrings."""
    source = Path(klute_sim.__file__).parent
    files = [file for pattern in SIMULATION_SOURCES for file in sorted(source.glob(pattern))]
    text = "".join(
        f"{file.relative_to(source).as_posix()} {_serialise_code(ast.parse(file.read_bytes()))}" for file in files
    )
    return hashlib.sha256(f"{text} {load_device(words.SIGNATURE_DEVICE).parameters!r}".encode()).hexdigest()


def _serialise_code(node: Any) -> str:
    """Return a syntax tree in a form that is equal in all versions of Python, without docstrings and sentences."""
    if isinstance(node, list):
        return "".join(map(_serialise_code, node))
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return ""
    if isinstance(node, ast.AST):
        return f"({type(node).__name__}{''.join(_serialise_code(value) for _, value in ast.iter_fields(node))})"
    # Hooks, keys and names are identifiers; other strings are sentences.
    return "" if node is None or (isinstance(node, str) and not node.isidentifier()) else repr(node)


def simulate_effects(folder: Path, progress: ProgressCallback) -> dict[str, Any]:
    """Simulate all effects, write figures and matrices into ``folder``, and return the content of :data:`DATA_FILE`."""
    device, simulator = load_device(words.SIGNATURE_DEVICE), Simulator()
    effects = [effect for effect in catalogue.get_effects().values() if effect.kind not in UNDRAWN_KINDS]
    replacing_effects = [effect for effect in effects if effect.replaces_switch]
    total = 1.0 + len(replacing_effects) + len(effects) / EFFECTS_DRAWN_PER_ANALYSIS

    def report_from(start: float) -> ProgressCallback:
        return lambda fraction, stage: progress((start + fraction) / total, stage)

    identifiability = compute_identifiability(device, simulator, report_from(0.0))
    effects_figures.write_matrices(identifiability, folder)
    rows = to_json_rows(identifiability)
    for k, effect in enumerate(replacing_effects):
        effect_rows = to_json_rows(
            compute_identifiability(remove_base_effect(device, effect), simulator, report_from(1.0 + k))
        )
        rows += [row for row in effect_rows if row["effect"] == effect.name]
    figure_protocols = {}
    for k, effect in enumerate(effects):
        report_from(1.0 + len(replacing_effects))(k / EFFECTS_DRAWN_PER_ANALYSIS, effect.name)
        for signature in simulate_effect_responses(device, effect, simulator):
            effects_figures.save_signature_figure(signature, folder)
            figure_protocols[effects_figures.format_file_name(effect.name, signature.term.form)] = signature.protocol
    simulator.close()
    classes = [
        {
            "effects": list(map(str, group.terms)),
            "n_effects": group.n_effects,
            "cosine": group.cosine,
            "separated_by": group.separated_by.description if group.separated_by else None,
            "remaining_cosine": group.remaining_cosine,
        }
        for group in find_indistinguishable_classes(identifiability)
    ]
    data = {
        "digest": compute_digest(),
        "device": words.SIGNATURE_DEVICE,
        "shown_in": figure_protocols,
        "classes": classes,
        "effects": rows,
    }
    rounded: dict[str, Any] = json.loads(
        json.dumps(data), parse_float=lambda text: float(f"{float(text):.{SIGNIFICANT_DIGITS}g}")
    )
    return rounded


def render_pages(data: dict[str, Any]) -> dict[str, str]:
    """Return the text of each file, from the catalogue and the content of :data:`DATA_FILE`."""
    effects = catalogue.get_effects().values()
    return {INDEX_FILE: _render_index(data)} | {f"{effect.name}.md": _render_page(effect, data) for effect in effects}


def _render_table(head: tuple[str, ...], table_rows: Sequence[tuple[str, ...]]) -> str:
    cells = [head, ("---",) * len(head), *table_rows]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in cells)


def _render_page(effect: Effect, data: dict[str, Any]) -> str:
    description = words.describe_effect(effect)
    text = f"{GENERATED_MARK}\n# {effect.name}\n\n{effect.description}\n\n{words.describe_kind(description)}\n"
    for number, form in enumerate(description["forms"]):
        default_note = words.format_default_note(number, description["forms"])
        text += f"\n## Form {form['name']}{default_note}\n\n{format_equation(form['equation'])}\n\n"
        text += f"{words.describe_hooks(form)}\n\n"
        text += _render_table(
            words.PARAMETER_HEADINGS, [words.format_parameter_cells(row) for row in form["parameters"]]
        )
        if form["device_file"]:
            text += f"\nIn a [device file](../devices.md):\n\n```toml\n{form['device_file']}\n```\n"
        if effect.kind in UNDRAWN_KINDS:
            continue
        figure = effects_figures.format_file_name(effect.name, form["name"])
        quantity = " of the force" if effect.kind == "instrument" else ""
        test_setup = f"protocol `{data['shown_in'].get(figure)}` on device {_device_label(effect, data)}"
        text += f"\n![{effect.name} ({form['name']}): with and without]({PICTURES_FOLDER}/{figure})\n"
        text += (
            f"\nInfluence of the typical size{quantity} in {test_setup}, the standard protocol that shows it best.\n"
        )
    return f"{text}\n## Similar effects\n\n{_render_confusions(effect, data)}"


def _device_label(effect: Effect, data: dict[str, Any]) -> str:
    return str(data["device"]) + (
        f" with `{effect.replaces_switch} = false` in `[muscle]`" if effect.replaces_switch else ""
    )


def _render_confusions(effect: Effect, data: dict[str, Any]) -> str:
    if effect.data_driven:
        return "It combines functions and can resemble many effects, so it is compared with none.\n"
    if effect.kind == "body":
        return "It shows only in gait: no standard protocol of the bench compares it with others.\n"
    if effect.kind == "mechanism":
        return "It shows on a mechanism only: no standard protocol of the bench compares it with others.\n"
    kind = "channel" if effect.kind == "instrument" else "form"
    lines: list[tuple[str, ...]] = []
    for row in data["effects"]:
        if row["effect"] != effect.name:
            continue
        label = row[kind]
        if effect.kind == "instrument" and len(effect.forms) > 1:
            label += f", {row['form']}"
        effect_cells = (
            label,
            f"{row['signal_to_noise']:.0f}",
            f"{100.0 * row['orthogonal_fraction']:.0f} %",
            str(row["class_size"]),
        )
        similar_effects = [
            (
                _link_term(pair["effect"]),
                f"{pair['cosine']:.3f}",
                pair["separated_by"] or words.NO_DISTINGUISHING_CHANGE,
                _format_remaining_cosine(pair),
            )
            for pair in row["similar_effects"]
        ] or [(f"nothing; closest: {_link_term(row['closest'])}", f"{row['closest_cosine']:.3f}", "", "")]
        lines += [
            (*effect_cells, *similar_effects[0]),
            *(("",) * len(effect_cells) + like for like in similar_effects[1:]),
        ]
    test_setup = f"n all standard protocols together, on device {_device_label(effect, data)}"
    if not lines:
        return f"I{test_setup}, the uncertain numbers of the device reproduce all of its influence.\n"
    table = _render_table((kind, *CONFUSION_TABLE_HEAD), lines)
    return f"I{test_setup}:\n\n{table}\n[The overview]({INDEX_FILE}#indistinguishable-effects) explains the columns.\n"


def _format_remaining_cosine(pair: dict[str, Any]) -> str:
    return f"{pair['remaining_cosine']:.3f}"


def _link_term(term: str) -> str:
    """Return the label of a term as a link to the page of its effect."""
    return f"[{term}]({term.split()[0]}.md)"


def _render_index(data: dict[str, Any]) -> str:
    rows = [
        (
            f"[`{effect.name}`]({effect.name}.md)",
            f"{effect.kind}{', supply' * effect.acts_in_supply}{', data-driven' * effect.data_driven}",
            ", ".join(f"`{form.name}`" for form in effect.forms),
            effect.description,
        )
        for effect in catalogue.get_effects().values()
    ]
    groups = [
        (
            ", ".join(map(_link_term, group["effects"])),
            str(group["n_effects"]),
            f"{group['cosine']:.3f}",
            group["separated_by"] or words.NO_DISTINGUISHING_CHANGE,
            _format_remaining_cosine(group),
        )
        for group in data["classes"]
    ]
    base_terms = join_words(
        [f"`{effect.name}`" for effect in catalogue.get_effects().values() if effect.replaces_switch]
    )
    data_driven = join_words([f"`{effect.name}`" for effect in catalogue.get_effects().values() if effect.data_driven])
    matrices = "".join(
        f"- {change.description}: [table](matrix_{k}.csv), [picture]({PICTURES_FOLDER}/matrix_{k}.png)\n"
        for k, change in enumerate(RIG_CHANGES)
    )
    return f"""{GENERATED_MARK}
# The catalogue of effects

[Effects](../effects.md) explains how to use them. The first form is the default. In equations, $\\Delta F$ is what the
effect adds to the tension $F$.

{_render_table(("effect", "kind", "forms", "description"), rows)}
## Indistinguishable effects

On device {data["device"]}, every form of every effect is simulated at a small size in all standard protocols. The part
that the uncertain numbers of the device can reproduce is projected off. The remainder, over the noise of an ordinary
load cell and gauge, is the signature of the effect. Two effects are indistinguishable if their signatures have a cosine
of {INDISTINGUISHABLE_COSINE:g} or more, whatever their sizes. A class is a connected group of
indistinguishable effects. These protocols do not separate its effects well; another instrument may.

- *Effects* is the number of different effects in the class, which may contain several forms of one effect.
- *Separated by* is the change of the rig that separates a class best, if all its cosines fall below
  {INDISTINGUISHABLE_COSINE:g}. *Remaining cosine* is its largest cosine with that change, or with the best one where
  none is sufficient.

The pages of the effects have two more columns:

- *Typical size over noise* is the root of chi squared of the typical size after projection.
- *Left after refitting* is the fraction of the change that projection leaves: small where the numbers of the device
  reproduce the effect.

{_render_table(("class", "effects", "largest cosine", "separated by", "remaining cosine"), groups)}
All other effects are distinguishable (their largest cosine is below {INDISTINGUISHABLE_COSINE:g}).
[{DATA_FILE}]({DATA_FILE}) has the numbers.

![Cosines between all signatures]({PICTURES_FOLDER}/matrix_0.png)

All cosines between signatures:

{matrices}
{base_terms} are terms of the base model and are not in the matrices. Their pages
compare them with all other effects on the device without that term. {data_driven}
are data-driven: they identify no physical effect and are not compared.

`{COMMAND}` writes these pages and has to be run again when a law changes.
"""


def write_pages(folder: Path, progress: ProgressCallback = lambda fraction, stage: None) -> None:
    """Write all files into ``folder`` and remove pages and figures of effects that no longer exist."""
    with tempfile.TemporaryDirectory() as scratch:
        data = simulate_effects(Path(scratch), progress)
        pictures = folder / PICTURES_FOLDER
        pictures.mkdir(parents=True, exist_ok=True)
        for outdated in (*pictures.glob("*.png"), *folder.glob("matrix_*.csv")):
            outdated.unlink()
        for file in Path(scratch).iterdir():
            (pictures if file.suffix == ".png" else folder).joinpath(file.name).write_bytes(file.read_bytes())
    # One line per row keeps differences readable.
    parts = ",\n".join(f'"{key}": {_format_json(value)}' for key, value in data.items())
    (folder / DATA_FILE).write_text(f"{{\n{parts}\n}}\n", "utf-8")
    texts = render_pages(data)
    for page in folder.glob("*.md"):
        if page.name not in texts and page.read_text("utf-8").startswith(GENERATED_MARK):
            page.unlink()
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")


def _format_json(value: Any) -> str:
    if not isinstance(value, list):
        return json.dumps(value)
    return "[\n" + ",\n".join(json.dumps(row) for row in value) + "\n]"


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pages go: docs/effects")
    with progress_bar("simulating every effect") as progress:
        write_pages(parser.parse_args().folder, progress)
    return 0


if __name__ == "__main__":
    sys.exit(main())
