"""``klute-sim sweep``."""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from klute_sim.gait.reference import Reference
    from klute_sim.parameter_sweep.plan import SweepPlan
    from klute_sim.parameter_sweep.runner import Runner
    from klute_sim.parameter_sweep.sweep import SweepResult

REFERENCE_SPEED = "own"
"""The word for the speed that reference and legs imply."""


def _parse_numbers(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> list[float]:
    """Each number once, in the order given; a callback of options."""
    return list(dict.fromkeys(_parse_number(word, option, "a number") for word in _split_values(values)))


def _parse_speeds(context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> list[float | None]:
    """Likewise; None for the walker's own."""
    own = f"a number or {REFERENCE_SPEED!r}"
    return list(
        dict.fromkeys(
            None if word == REFERENCE_SPEED else _parse_number(word, option, own) for word in _split_values(values)
        )
    )


def _split_values(values: tuple[str, ...]) -> list[str]:
    return [word.strip() for text in values for word in text.split(",")]


def _parse_number(text: str, option: click.Parameter, expected: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"'{text}' is not {expected}", param=option) from None


@click.command("sweep")
@click.option(
    "--device",
    "devices",
    multiple=True,
    metavar="NAME|FILE",
    help="Preset or device file; may be given several times.  [default: klute-1-1-4-pair]",
)
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="WORD",
    help="As in 'klute-sim gait': profile, off, constant:BAR, machine, or a file; may be given several times."
    "  [default: profile]",
)
@click.option(
    "--speed",
    "speeds",
    callback=_parse_speeds,
    multiple=True,
    metavar="M/S,...",
    help="Walking speeds [m/s]; own: what reference and legs imply.  [default: own]",
)
@click.option(
    "--slope",
    "slopes",
    callback=_parse_numbers,
    multiple=True,
    metavar="DEG,...",
    help="Slopes of the ground, uphill positive; the limb's motion on them is assumed [degrees].  [default: 0]",
)
@click.option(
    "--reference",
    "references",
    multiple=True,
    metavar="FILE|FOLDER",
    help="Gait to walk on: a folder made by klute-sim import, or a CSV of docs/gait.md; may be given several times; "
    "able-bodied: the package's own.  [default: able-bodied]",
)
@click.option(
    "--mass",
    "masses",
    callback=_parse_numbers,
    multiple=True,
    metavar="KG,...",
    help="Body masses [kg].  [default: what the folder of --reference states, or 75]",
)
@click.option(
    "--stature",
    "statures",
    callback=_parse_numbers,
    multiple=True,
    metavar="M,...",
    help="Statures [m].  [default: what the folder of --reference states, or 1.75]",
)
@click.option(
    "--spring-foot",
    "feet",
    callback=_parse_numbers,
    multiple=True,
    metavar="STIFFNESS,...",
    help="Passive feet beside the devices named, without pressure [N·m/deg]; without any named, alone.",
)
@common.strides_option("Strides of each walk")
@common.TIME_STEP_OPTION
@common.jobs_option(default=None)
@click.option(
    "--ray",
    "address",
    is_flag=False,
    flag_value="auto",
    default=None,
    metavar="[ADDRESS|local]",
    help="Walk on a Ray cluster: the one at ADDRESS, the one that Ray finds, or a local one made for this.",
)
@common.resumable_out_option("sweep", "the sweep")
@click.option("--csv", "with_csv", is_flag=True, help="Write sweep.csv, too.")
@common.json_option()
def command(
    devices: tuple[str, ...],
    controllers: tuple[str, ...],
    speeds: list[float | None],
    slopes: list[float],
    references: tuple[str, ...],
    masses: list[float],
    statures: list[float],
    feet: list[float],
    strides: int,
    step_ms: float,
    jobs: int | None,
    address: str | None,
    out: Path | None,
    with_csv: bool,
    as_json: bool,
) -> None:
    """Walk every combination of devices, controllers, walkers, speeds and slopes; one row for each.

    Each is walked as 'klute-sim gait' does, on all cores or on a cluster. What a combination cannot do is a row with
    the reason. Finished walks are on the disk at once: after an interrupt, the same command with the same --out goes on
    where it was.

    Writes sweep.parquet (a row per combination, columns 'name [unit]'), sweep.json (what was asked for, device files
    included) and a file per walk.

    \b
    Examples:
      klute-sim sweep --mass 60,75,90 --speed own,1.0,1.4
      klute-sim sweep --slope -5,0,5 --controller profile --controller off
      klute-sim sweep --reference anna --reference ben --reference able-bodied
      klute-sim sweep --device klute-1-1-4-pair --spring-foot 4,6,8
      klute-sim sweep --device klute-1-1-4-pair --device my.toml --controller profile --controller off
      klute-sim sweep --controller constant:2 --controller mine.csv --out my-sweep --csv
      klute-sim sweep --mass 60,75,90 --ray local
      klute-sim sweep --mass 60,75,90 --ray 10.0.0.1:6379 --json | python -m json.tool
    """
    from klute_sim.errors import InputError
    from klute_sim.parameter_sweep import local
    from klute_sim.parameter_sweep.plan import SweepPlan

    plan = SweepPlan(
        **_load_devices_and_controllers(devices, controllers, feet),
        references=_load_references(references),
        speeds=speeds or [None],
        slopes_deg=slopes or [0.0],
        masses=masses or [None],
        statures=statures or [None],
        strides=strides,
        dt=1e-3 * step_ms,
    )
    if address is None:
        with local.LocalRunner(jobs or 0) as processes:
            swept, folder = _run_and_write(plan, processes.run, out, with_csv=with_csv)
    elif jobs is not None:
        raise InputError("--jobs goes without --ray: a cluster has as many as it has")
    else:
        from klute_sim.parameter_sweep import cluster

        with cluster.connect(address) as ray:
            swept, folder = _run_and_write(plan, partial(cluster.run_on_cluster, ray=ray), out, with_csv=with_csv)
    _report(swept, folder, as_json=as_json)


def _load_devices_and_controllers(
    devices: tuple[str, ...], controllers: tuple[str, ...], feet: list[float]
) -> dict[str, Any]:
    """Devices, controllers and passive feet, everything once; raises InputError."""
    from klute_sim.controllers import parse
    from klute_sim.device.device import DEFAULT_DEVICE, load_device

    usual = load_device(DEFAULT_DEVICE)
    alone = feet and not devices and not controllers
    return {
        "devices": {} if alone else {name: load_device(name) for name in devices or [DEFAULT_DEVICE]},
        "controllers": {} if alone else {name: parse.parse_controller(name) for name in controllers or ["profile"]},
        "feet": dict.fromkeys(feet, usual),
    }


def _load_references(names: tuple[str, ...]) -> "dict[str, Reference | None]":
    from klute_sim.gait import reference
    from klute_sim.parameter_sweep.plan import ABLE_BODIED_REFERENCE

    return {
        word: None if word == ABLE_BODIED_REFERENCE else reference.load_reference(word)
        for word in names or [ABLE_BODIED_REFERENCE]
    }


def _run_and_write(
    plan: "SweepPlan", runner: "Runner", out: Path | None, *, with_csv: bool
) -> tuple["SweepResult", Path]:
    """Walk and write; what came of it, and the folder."""
    from klute_sim.cli.console import progress_bar, stderr_console
    from klute_sim.parameter_sweep import table
    from klute_sim.parameter_sweep.store import open_store
    from klute_sim.parameter_sweep.sweep import run_sweep

    store = open_store(out, plan.describe(), "sweep")
    try:
        with progress_bar("walking") as progress:
            swept = run_sweep(plan, store, runner, progress)
    except KeyboardInterrupt:
        stderr_console().print(
            f"What has been walked is kept: the same command with --out {store.folder} goes on where it was.",
            soft_wrap=True,
        )
        raise
    with store.translate_write_errors():
        table.write_parquet(swept.rows, plan, store.folder / "sweep.parquet")
        if with_csv:
            table.write_csv(swept.rows, store.folder / "sweep.csv")
    return swept, store.folder


def _report(result: "SweepResult", folder: Path, *, as_json: bool) -> None:
    from klute_sim.cli.console import stderr_console, stdout_console
    from klute_sim.parameter_sweep import display

    if result.n_resumed:
        stderr_console().print(f"{result.n_resumed} walks were there from before.")
    if as_json:
        found = {"folder": str(folder), "kept": result.n_resumed, "failed": result.n_failed, "rows": result.rows}
        click.echo(json.dumps(found, indent=2, allow_nan=False))
        return
    out = stdout_console()
    out.print(display.format_table(result.rows))
    for remark in display.collect_remarks(result.rows, result.n_failed):
        out.print(remark, soft_wrap=True)
    files = sorted(file.name for file in folder.glob("sweep.*"))
    out.print(f"Sweep folder: {folder}  ({', '.join(files)})", soft_wrap=True)
