"""``klute-sim effects``."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim import units
from klute_sim.cli.given_path import GivenPath

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect, Form, Parameter

PLACES = {
    "acting_pressure": "the pressure that the muscle feels",
    "muscle_force": "the muscle's tension",
    "damper_force": "the damper's tension",
    "tendon_stretch": "the tendon's stretch",
    "tendon_force": "the tendon's tension",
    "pressure_target": "the pressure that is regulated to",
    "pressure_reached": "how the pressure follows",
    "remember": "its own memory",
    "reading": "what an instrument shows",
}
"""Hook -> what a law changes there."""
DEVICE = "klute-3-4-pair"
WHOLE_SERIES = "the pressure command as a whole"
"""Where an effect without laws acts."""


@click.command("effects")
@click.argument("name", metavar="[NAME]", required=False)
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON instead of tables: one object, or a list without NAME."
)
@click.option(
    "--catalogue",
    type=GivenPath(),
    default=None,
    metavar="FILE",
    help="Python file with effects of your own (docs/effects.md). Its code is run.",
)
@click.option(
    "--confusable",
    is_flag=True,
    help="Compute which effects look alike in the standard protocols, and the change of the rig that splits them.",
)
@click.option(
    "--device",
    "device_name",
    default=DEVICE,
    show_default=True,
    metavar="NAME|FILE",
    help="Device of --confusable and of the pictures.",
)
@click.option(
    "--out",
    type=GivenPath(),
    default=None,
    metavar="FOLDER",
    help="New or empty folder for pictures and data: of NAME what it changes, of --confusable who looks like whom.",
)
def command(
    name: str | None,
    as_json: bool,
    catalogue: Path | None,
    confusable: bool,
    device_name: str,
    out: Path | None,
) -> None:
    """List the physical effects that the base model leaves out, or show one.

    Shows each form's equation, where it acts, its parameters (unit, the value without effect, range, typical size,
    source; assumed ones marked), and the lines that put it into a device file.

    \b
    Examples:
      klute-sim effects
      klute-sim effects braid_hysteresis
      klute-sim effects pressure_lag --json
      klute-sim effects warming --catalogue my_effects.py
      klute-sim effects muscle_damping --out signature    pictures of what it changes
      klute-sim effects seal_friction --confusable        what it is easily taken for
      klute-sim effects --confusable --out who-is-who     all of them, as matrix and table
    """
    from klute_sim.effects import catalogue as known
    from klute_sim.errors import InputError

    if catalogue is not None:
        use(catalogue)
    if out is not None and name is None and not confusable:
        raise InputError("--out goes with NAME or --confusable")
    chosen = known.form_of(name, None)[0] if name else None
    if confusable:
        _confusable(device_name, chosen, out, as_json=as_json)
        return
    if out is not None and chosen is not None:
        _signatures(device_name, chosen, out)
    if name is None:
        shown = [describe(effect) for effect in known.effects().values()]
        if as_json:
            _json(shown)
        else:
            _print_all(shown)
        return
    one = describe(known.form_of(name, None)[0])
    if as_json:
        _json(one)
    else:
        _print_one(one)


def _confusable(device_name: str, chosen: "Effect | None", out: Path | None, *, as_json: bool) -> None:
    from contextlib import nullcontext

    from klute_sim.cli.console import console, progress_bar
    from klute_sim.device.files import load
    from klute_sim.diagnose.confusable import confusions, twins
    from klute_sim.diagnose.experiment import Bench
    from klute_sim.recording import run_folder

    device, bench = load(device_name), Bench()
    folder = run_folder.new("effects", out) if out is not None else nullcontext((None, None))
    with folder as (place, scratch):
        with progress_bar("simulating") as told:
            found = confusions(device, bench, told)
        alike = twins(found)
        rows = [
            {
                "effect": term.effect,
                "form": term.form,
                "channel": term.channel,
                "class_size": 1 + len(others),
                "size": next(s.size for s in found[0].signatures if s.term == term),
                "kept": next(s.kept for s in found[0].signatures if s.term == term),
                "alike": [
                    {
                        "effect": str(twin.term),
                        "cosine": twin.cosine,
                        "split_by": twin.split_by.words if twin.split_by else None,
                        "cosine_then": twin.after,
                    }
                    for twin in others
                ],
            }
            for term, others in alike.items()
        ]
        if scratch is not None:
            _write_matrices(found, rows, scratch)
    bench.close()
    shown = [row for row in rows if chosen is None or row["effect"] == chosen.name]
    if as_json:
        _json(shown)
        return
    _print_confusable(shown)
    if place is not None:
        console().print(f"Matrix and table: {place}", soft_wrap=True)


def _write_matrices(found: Any, rows: list[dict[str, Any]], scratch: Path) -> None:
    import csv

    from klute_sim.report import effects_figures

    (scratch / "confusable.json").write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", "utf-8")
    for number, one in enumerate(found):
        effects_figures.matrix(one).savefig(scratch / f"matrix_{number}.png", dpi=110)
        names = [str(signature.term) for signature in one.signatures]
        with (scratch / f"matrix_{number}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([one.change.words, *names])
            writer.writerows(
                [name, *(f"{c:.4f}" for c in line)] for name, line in zip(names, one.cosines(), strict=True)
            )


def _print_confusable(rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    table = Table("effect", "typical size over noise", "left after refitting", "looks like", "split by")
    for row in rows:
        name = f"{row['effect']} ({row['form']})" + (f" of {row['channel']}" if row["channel"] else "")
        likes = "\n".join(f"{t['effect']} ({t['cosine']:.2f})" for t in row["alike"]) or "nothing else"
        split = "\n".join(
            f"{t['split_by']} ({t['cosine_then']:.2f})" if t["split_by"] else "no change of the rig"
            for t in row["alike"]
        )
        table.add_row(name, f"{row['size']:.0f}", f"{100.0 * row['kept']:.0f} %", likes, split or "-")
    console().print(table)


def _signatures(device_name: str, effect: "Effect", out: Path) -> None:
    """A picture of every form of ``effect`` (of an instrument: on the force)."""
    from klute_sim.cli.console import notes
    from klute_sim.device.files import load
    from klute_sim.diagnose.experiment import Bench
    from klute_sim.diagnose.hypothesis import Term
    from klute_sim.diagnose.signature import signature
    from klute_sim.recording import run_folder
    from klute_sim.report import effects_figures

    device, bench = load(device_name), Bench()
    with run_folder.new("effects", out) as (place, scratch):
        for form in effect.forms:
            found = signature(device, Term(effect.name, form.name, None if effect.kind == "device" else "force"), bench)
            title = f"{effect.name} ({form.name}) at its typical size, protocol '{found.protocol}', {device.name}"
            effects_figures.signature(found, title).savefig(scratch / f"{effect.name}_{form.name}.png", dpi=110)
    bench.close()
    notes().print(f"Pictures: {place}", soft_wrap=True)


def use(catalogue: Path) -> None:
    """Let the effects of the file ``catalogue`` in, and say on stderr that its code is run."""
    from klute_sim.cli.console import notes
    from klute_sim.effects import catalogue as known

    if catalogue.is_file():
        notes().print(f"The code in {catalogue} is run.", soft_wrap=True)
    known.use(catalogue)


def describe(effect: "Effect") -> dict[str, Any]:
    """Everything the command shows of ``effect``."""
    return {
        "name": effect.name,
        "sentence": effect.sentence,
        "kind": effect.kind,
        "supply": effect.supply,
        "instead_of": effect.instead_of or None,
        "forms": [
            {
                "name": form.name,
                "equation": form.equation,
                "hooks": list(form.laws),
                "parameters": [_parameter(effect, parameter) for parameter in form.parameters],
                "device_file": snippet(effect, form),
            }
            for form in effect.forms
        ],
    }


def snippet(effect: "Effect", form: "Form") -> str | None:
    """The lines of a device file that have ``effect`` in it at its typical size; None for one of instruments."""
    if effect.kind != "device":
        return None
    numbers = (f"{parameter.key} = {float(parameter.typical)!r}" for parameter in form.parameters)
    needs = [f"# needs {effect.instead_of} = false in [muscle]"] if effect.instead_of else []
    return "\n".join([*needs, f"[effects.{effect.name}]", f'form = "{form.name}"', *numbers])


def unit(effect: "Effect", parameter: "Parameter") -> str:
    """The unit of ``parameter`` by the end of its key; an instrument's without bounds has that of its channel."""
    if effect.kind == "instrument" and math.isinf(parameter.high):
        return "channel's unit/s" if parameter.key.endswith("_per_s") else "channel's unit"
    return units.split(parameter.key)[1] or "1"


def _parameter(effect: "Effect", parameter: "Parameter") -> dict[str, Any]:
    return {
        "key": parameter.key,
        "unit": unit(effect, parameter),
        "neutral": parameter.neutral,
        "low": parameter.low if math.isfinite(parameter.low) else None,
        "high": parameter.high if math.isfinite(parameter.high) else None,
        "typical": parameter.typical,
        "source": parameter.source,
        "assumed": parameter.source.startswith("assumed"),
    }


def _json(shown: Any) -> None:
    click.echo(json.dumps(shown, indent=2, allow_nan=False))


def _print_all(shown: list[dict[str, Any]]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    table = Table("effect", "kind", "forms", "what it is")
    for effect in shown:
        forms = ", ".join(form["name"] for form in effect["forms"])
        table.add_row(effect["name"], effect["kind"], forms, effect["sentence"])
    console().print(table)


def _print_one(shown: dict[str, Any]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import console

    out = console()
    out.print(f"{shown['name']}: {shown['sentence']}", soft_wrap=True)
    out.print(_kind(shown), soft_wrap=True)
    for number, form in enumerate(shown["forms"]):
        usual = " (the usual one)" if number == 0 and len(shown["forms"]) > 1 else ""
        places = "; ".join(f"{hook}: {PLACES[hook]}" for hook in form["hooks"]) or WHOLE_SERIES
        out.print(f"\nForm {form['name']}{usual}: {form['equation']}", soft_wrap=True)
        out.print(f"It acts on {places}.", soft_wrap=True)
        table = Table("parameter", "unit", "without effect", "range", "typical", "source")
        for row in form["parameters"]:
            neutral = "none: a shape" if row["neutral"] is None else f"{row['neutral']:g}"
            style = "yellow" if row["assumed"] else None
            table.add_row(
                row["key"], row["unit"], neutral, _range(row), f"{row['typical']:g}", row["source"], style=style
            )
        out.print(table)
        if form["device_file"]:
            out.print("In a device file:\n")
            out.print(form["device_file"], soft_wrap=True)


def _kind(shown: dict[str, Any]) -> str:
    if shown["kind"] == "instrument":
        return (
            "An effect of an instrument. It is never in a device file: a diagnosis looks for it in every measured "
            "channel."
        )
    if shown["supply"]:
        return "An effect of the device, in its gas supply, which may do work."
    return "An effect of the device, not of its gas supply."


def _range(row: dict[str, Any]) -> str:
    if row["low"] is None and row["high"] is None:
        return "any"
    if row["low"] is None or row["high"] is None:
        return f"from {row['low']:g}" if row["high"] is None else f"up to {row['high']:g}"
    return f"{row['low']:g} to {row['high']:g}"
