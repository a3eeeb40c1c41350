"""Write a page for every effect of the catalogue, and one about all of them: which look alike, and what splits them.

    python scripts/effect_pages.py docs/effects

The pages say what ``klute-sim effects NAME`` says. What has to be simulated for them is kept in ``confusable.json``
beside them, with the digest of the laws that it is of. It takes less than a minute on one core.
"""

import argparse
import ast
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import klute_sim
from klute_sim.cli.console import progress_bar
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import Simulator
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

COMMAND = "python scripts/effect_pages.py docs/effects"
GENERATED_MARK = f"<!-- Written by `{COMMAND}`. Change the catalogue instead. -->\n"
DATA_FILE, INDEX_FILE, PICTURES_FOLDER = "confusable.json", "README.md", "pictures"
SIGNIFICANT_DIGITS = 3
"""Significant ones of a number that is kept: so many are the same on every machine."""
CONFUSION_TABLE_HEAD = (
    "typical size over noise",
    "left after refitting",
    "class size",
    "looks like",
    "|cos|",
    "split by",
    "then",
)
"""Of what an effect is easily taken for; :data:`INDEX` says what it means."""
EFFECTS_DRAWN_PER_ANALYSIS = 10.0
"""Effects that are drawn while all signatures are computed once."""
SIMULATION_SOURCES = (
    *("laws/*.py", "effects/*.py", "device/step.py", "device/rollout.py", "diagnose/confusable.py"),
    *("diagnose/experiment.py", "diagnose/on_bench.py", "diagnose/hypothesis.py", "diagnose/protocols.py"),
    "diagnose/signature.py",
)
"""Files whose code decides what is simulated."""


def compute_digest() -> str:
    """Of the code in :data:`OF_THE_LAWS` and the numbers of the device: comments, docstrings and sentences are not."""
    source = Path(klute_sim.__file__).parent
    files = [file for pattern in SIMULATION_SOURCES for file in sorted(source.glob(pattern))]
    text = "".join(
        f"{file.relative_to(source).as_posix()} {_serialise_code(ast.parse(file.read_bytes()))}" for file in files
    )
    return hashlib.sha256(f"{text} {load_device(words.SIGNATURE_DEVICE).parameters!r}".encode()).hexdigest()


def _serialise_code(node: Any) -> str:
    """A syntax tree in the same words in every version of Python, without what is only there to be read."""
    if isinstance(node, list):
        return "".join(map(_serialise_code, node))
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return ""
    if isinstance(node, ast.AST):
        return f"({type(node).__name__}{''.join(_serialise_code(value) for _, value in ast.iter_fields(node))})"
    # Hooks, keys and names are identifiers; other strings are sentences.
    return "" if node is None or (isinstance(node, str) and not node.isidentifier()) else repr(node)


def simulate_effects(folder: Path, progress: Callable[[float], None]) -> dict[str, Any]:
    """All that takes long: the pictures and matrices go into ``folder``, the content of :data:`DATA` comes back."""
    device, bench = load_device(words.SIGNATURE_DEVICE), Simulator()
    effects = [effect for effect in catalogue.get_effects().values() if effect.kind != "body"]
    replaced = [effect for effect in effects if effect.replaces_switch]
    parts = 1.0 + len(replaced) + len(effects) / EFFECTS_DRAWN_PER_ANALYSIS

    def after(begun: float) -> Callable[[float], None]:
        return lambda share: progress((begun + share) / parts)

    found = compute_identifiability(device, bench, after(0.0))
    effects_figures.write_matrices(found, folder)
    every = to_json_rows(found)
    for k, effect in enumerate(replaced):
        there = to_json_rows(compute_identifiability(remove_base_effect(device, effect), bench, after(1.0 + k)))
        every += [row for row in there if row["effect"] == effect.name]
    shown_in = {}
    for k, effect in enumerate(effects):
        after(1.0 + len(replaced))(k / EFFECTS_DRAWN_PER_ANALYSIS)
        for signature in simulate_effect_responses(device, effect, bench):
            effects_figures.save_signature_figure(signature, folder)
            shown_in[effects_figures.format_file_name(effect.name, signature.term.form)] = signature.protocol
    bench.close()
    alike = [
        {
            "effects": list(map(str, group.terms)),
            "size": group.n_effects,
            "cosine": group.cosine,
            "split_by": group.separated_by.description if group.separated_by else None,
            "cosine_then": group.remaining_cosine,
        }
        for group in find_indistinguishable_classes(found)
    ]
    kept = {
        "digest": compute_digest(),
        "device": words.SIGNATURE_DEVICE,
        "shown_in": shown_in,
        "classes": alike,
        "effects": every,
    }
    rounded: dict[str, Any] = json.loads(
        json.dumps(kept), parse_float=lambda text: float(f"{float(text):.{SIGNIFICANT_DIGITS}g}")
    )
    return rounded


def render_pages(data: dict[str, Any]) -> dict[str, str]:
    """File -> text, from the catalogue and the content of :data:`DATA`."""
    effects = catalogue.get_effects().values()
    return {INDEX_FILE: _render_index(data)} | {f"{effect.name}.md": _render_page(effect, data) for effect in effects}


def _render_table(head: tuple[str, ...], table_rows: Sequence[tuple[str, ...]]) -> str:
    cells = [head, ("---",) * len(head), *table_rows]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in cells)


def _render_page(effect: Effect, data: dict[str, Any]) -> str:
    shown = words.describe_effect(effect)
    text = f"{GENERATED_MARK}\n# {effect.name}\n\n{effect.description}\n\n{words.describe_kind(shown)}\n"
    for number, form in enumerate(shown["forms"]):
        text += f"\n## Form {form['name']}{words.format_default_note(number, shown['forms'])}\n\n```\n{form['equation']}\n```\n\n"
        text += f"{words.describe_hooks(form)}\n\n"
        text += _render_table(
            words.PARAMETER_HEADINGS, [words.format_parameter_cells(row) for row in form["parameters"]]
        )
        if form["device_file"]:
            text += f"\nIn a [device file](../devices.md):\n\n```toml\n{form['device_file']}\n```\n"
        if effect.kind == "body":
            continue
        picture = effects_figures.format_file_name(effect.name, form["name"])
        of = " of the force" if effect.kind == "instrument" else ""
        where = f"protocol `{data['shown_in'].get(picture)}` on device {_device_label(effect, data)}"
        text += f"\n![{effect.name} ({form['name']}): with and without]({PICTURES_FOLDER}/{picture})\n"
        text += (
            f"\nWhat the typical size{of} changes in {where}: of the standard protocols, it shows most in this one.\n"
        )
    return f"{text}\n## Easily taken for\n\n{_render_confusions(effect, data)}"


def _device_label(effect: Effect, data: dict[str, Any]) -> str:
    return str(data["device"]) + (
        f" with `{effect.replaces_switch} = false` in `[muscle]`" if effect.replaces_switch else ""
    )


def _render_confusions(effect: Effect, data: dict[str, Any]) -> str:
    if effect.data_driven:
        return "It is a combination of functions and can look like many effects, so it is compared with none.\n"
    if effect.kind == "body":
        return "It shows on walks only: no standard protocol of the bench compares it with others.\n"
    of = "channel" if effect.kind == "instrument" else "form"
    lines: list[tuple[str, ...]] = []
    for row in data["effects"]:
        if row["effect"] != effect.name:
            continue
        own = (row[of], f"{row['size']:.0f}", f"{100.0 * row['kept']:.0f} %", str(row["class_size"]))
        likes = [
            (
                _link_term(pair["effect"]),
                f"{pair['cosine']:.3f}",
                pair["split_by"] or words.NO_DISTINGUISHING_CHANGE,
                _format_split_cosine(pair),
            )
            for pair in row["alike"]
        ] or [(f"nothing; closest: {_link_term(row['closest'])}", f"{row['closest_cosine']:.3f}", "", "")]
        lines += [(*own, *likes[0]), *(("",) * len(own) + like for like in likes[1:])]
    where = f"n all standard protocols together, on device {_device_label(effect, data)}"
    if not lines:
        return f"I{where}, it changes nothing that the device's own numbers could not imitate.\n"
    table = _render_table((of, *CONFUSION_TABLE_HEAD), lines)
    return f"I{where}:\n\n{table}\nWhat the columns mean is said [here]({INDEX_FILE}#which-look-alike).\n"


def _format_split_cosine(pair: dict[str, Any]) -> str:
    return f"{pair['cosine_then']:.3f}"


def _link_term(term: str) -> str:
    """A term as one says it, leading to its effect's page."""
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
            str(group["size"]),
            f"{group['cosine']:.3f}",
            group["split_by"] or words.NO_DISTINGUISHING_CHANGE,
            _format_split_cosine(group),
        )
        for group in data["classes"]
    ]
    replaced = join_words([f"`{effect.name}`" for effect in catalogue.get_effects().values() if effect.replaces_switch])
    driven = join_words([f"`{effect.name}`" for effect in catalogue.get_effects().values() if effect.data_driven])
    matrices = "".join(
        f"- {change.description}: [table](matrix_{k}.csv), [picture]({PICTURES_FOLDER}/matrix_{k}.png)\n"
        for k, change in enumerate(RIG_CHANGES)
    )
    return f"""{GENERATED_MARK}
# The catalogue of effects

How to use them is on the page about [effects](../effects.md). The first form is the usual one.

{_render_table(("effect", "kind", "forms", "what it is"), rows)}
## Which look alike

On device {data["device"]}, every form of every effect is tried a little in all standard protocols. What the device's
uncertain numbers could do instead is projected off. What is left, over the noise of an ordinary load cell and gauge, is
the effect's signature. Two effects whose signatures have a cosine of {INDISTINGUISHABLE_COSINE:g} or more look alike, whatever their
sizes. What hangs together so is a class. These protocols do not tell it apart well; another instrument may.

- *Typical size over noise* is the root of chi squared that the typical size makes, after projection.
- *Left after refitting* is the share of the change that projection leaves: little of what the device's own numbers
  imitate.
- *Split by* is the change of the rig that makes a class least alike, if it gets all its cosines below {INDISTINGUISHABLE_COSINE:g}. *Then*
  is its largest cosine with that change; where no change is enough, with the best one.

{_render_table(("class", "size", "largest |cos|", "split by", "then"), groups)}
All others look like nothing else (their largest cosine is below {INDISTINGUISHABLE_COSINE:g}). The numbers are in [{DATA_FILE}]({DATA_FILE}).

![Cosines between all signatures]({PICTURES_FOLDER}/matrix_0.png)

All cosines between signatures:

{matrices}
{replaced} are terms of the base model, so they are in no matrix. On their own
pages they are compared with all others on the device without that term. {driven}
are data-driven: they name nothing and are compared with nothing.

All of this is made by `{COMMAND}`, which has to be run again when a law changes.
"""


def write_pages(folder: Path, progress: Callable[[float], None] = lambda share: None) -> None:
    """Put everything into ``folder``; pages and pictures of effects that are gone go."""
    with tempfile.TemporaryDirectory() as scratch:
        data = simulate_effects(Path(scratch), progress)
        pictures = folder / PICTURES_FOLDER
        pictures.mkdir(parents=True, exist_ok=True)
        for old in (*pictures.glob("*.png"), *folder.glob("matrix_*.csv")):
            old.unlink()
        for made in Path(scratch).iterdir():
            (pictures if made.suffix == ".png" else folder).joinpath(made.name).write_bytes(made.read_bytes())
    # A row of each list is a line: so few that one sees what has changed.
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
    return "[\n" + ",\n".join(json.dumps(each) for each in value) + "\n]"


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the pages go: docs/effects")
    with progress_bar("simulating every effect") as told:
        write_pages(parser.parse_args().folder, told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
