"""``klute-sim baselines``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from rich.table import Table

CONDITION_COLUMNS = (
    ("moment\nsd", "moment_distance [sd]", ".2f"),
    ("angle\nsd", "angle_distance [sd]", ".2f"),
    ("power\nsd", "power_distance [sd]", ".2f"),
    ("peak power\nW/kg", "ankle_power_peak [W/kg]", ".2f"),
    ("net work\nJ/kg", "ankle_work_net [J/kg]", "+.3f"),
    ("air\ng/stride", "air_per_stride [g]", ".2f"),
)
"""Title, heading and format of what is shown in every condition; the files have more."""
LEVEL_COLUMNS = (
    ("quasi-stiffness\nN·m/kg/deg", "quasi_stiffness [N*m/kg/deg]", ".3f"),
    ("energy\nreturn", "energy_return [1]", ".2f"),
    ("roll-over\nradius m", "rollover_radius [m]", ".2f"),
    ("plantar-\nflexion deg", "ankle_plantarflexion [deg]", ".1f"),
    ("strides\nper tank", "strides_per_tank [1]", ".0f"),
)
"""Likewise, on the level at the reference's speed."""


@click.command("baselines")
@click.option(
    "--only", multiple=True, metavar="NAME", help="One of the baselines; may be given several times.  [default: all]"
)
@common.MASS_OPTION
@common.strides_option("Strides of each walk")
@common.TIME_STEP_OPTION
@common.jobs_option()
@common.resumable_out_option("baselines", "the walks")
@common.json_option("the tables")
def command(
    only: tuple[str, ...], mass: float, strides: int, step_ms: float, jobs: int, out: Path | None, as_json: bool
) -> None:
    """Walk what a new controller or device is held against: passive feet, off, constant, hand-tuned, machine, tuned.

    Each at the reference's speed, at 0.8 and 1.25 of it, and 5 degrees uphill and downhill. Distance to the human is
    given on the level at the reference's speed only: elsewhere nobody was measured. There, angles of thigh and shank
    and the ground reaction are the reference's in space, in its time scaled with the speed (assumed).

    Writes baselines.json, table.json and a file per walk.

    \b
    Examples:
      klute-sim baselines
      klute-sim baselines --only hand-tuned --only machine --mass 90
    """
    from klute_sim.baselines import table
    from klute_sim.baselines.library import load_baselines
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.parameter_sweep.local import LocalRunner
    from klute_sim.parameter_sweep.store import open_store, write_atomically
    from klute_sim.parameter_sweep.sweep import run_cases
    from klute_sim.report.gait.table import MAX_GRF_TRACKING_RMS_BW

    planned = table.plan_runs(load_baselines(only), mass, strides, 1e-3 * step_ms)
    store = open_store(out, table.describe_runs(planned), "baselines")
    with progress_bar("walking") as progress, LocalRunner(jobs) as processes:
        walked, _ = run_cases([each.case for each in planned], store, processes.run, progress)
    found = [
        table.BaselineRun(each.baseline, each.condition, each.case, result)
        for each, result in zip(planned, walked, strict=True)
    ]
    rows = table.build_rows(found)
    text = json.dumps({"folder": str(store.folder), "rows": rows}, indent=2, allow_nan=False)
    with store.translate_write_errors():
        write_atomically(store.folder / "table.json", text + "\n")
    if as_json:
        click.echo(text)
        return
    out_ = stdout_console()
    for condition in dict.fromkeys(row["condition"] for row in rows):
        own = [row for row in rows if row["condition"] == condition]
        out_.print(
            _build_table(
                _format_title(own[0]), own, CONDITION_COLUMNS if condition == "level" else CONDITION_COLUMNS[3:]
            )
        )
    level = [row for row in rows if row["condition"] == "level"]
    out_.print(_build_table("on the level: what a wearer would notice", level, LEVEL_COLUMNS))
    out_.print(
        f"A tank of {1e3 * table.TANK_VOLUME_M3:g} l at {table.TANK_PRESSURE_PA / 1e5:g} bar, used down to "
        f"{table.MIN_TANK_PRESSURE_PA / 1e5:g} bar, is assumed. On slopes and at other speeds the limb's motion is assumed.",
        soft_wrap=True,
    )
    if any(row["remark"] for row in rows):
        out_.print(
            f"Where the load was not followed (rms above {MAX_GRF_TRACKING_RMS_BW:g} body weights), the ankle did not carry what the "
            "reference's does: its moments and powers are not those of walking.",
            soft_wrap=True,
        )
    out_.print(f"Folder: {store.folder}", soft_wrap=True)


def _format_title(row: dict[str, Any]) -> str:
    if row["slope [deg]"]:
        return f"{abs(row['slope [deg]']):g} degrees {row['condition']}"
    return "level, the reference's speed" if row["speed_asked [m/s]"] is None else f"{row['speed_asked [m/s]']:.2f} m/s"


def _build_table(title: str, rows: list[dict[str, Any]], columns: tuple[tuple[str, str, str], ...]) -> "Table":
    from rich import box
    from rich.table import Table
    from rich.text import Text

    result = Table(title=Text(title), box=box.SIMPLE_HEAD)
    result.add_column("")
    for name, _, _ in columns:
        result.add_column(name, justify="right", no_wrap=True)
    result.add_column("")
    for row in rows:
        cells = ["-" if row.get(heading) is None else format(row[heading], form) for _, heading, form in columns]
        result.add_row(row["baseline"], *cells, row["remark"] or "")
    return result
