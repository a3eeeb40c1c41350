"""``klute-sim measure``."""

import json
import string
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common
from klute_sim.cli.nonempty_path import NonEmptyPath

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from klute_sim.bench.protocols.identification import IdentificationProtocol, Program
    from klute_sim.datasets.trial import Use
    from klute_sim.device.device import Device

MIN_REPEATS, MAX_REPEATS = 2, 26
"""Repeats: one is none, and they are lettered."""
FORCE_NOISE_N, PRESSURE_NOISE_BAR = 3.0, 0.01
"""Standard deviations of a rehearsal's noise [N, bar]."""
TIME_STEP = 2.5e-4
"""Of a rehearsal's simulation [s]; a whole part of the commands' sample."""
DEFAULT_UNCERTAINTIES = {
    "muscle.c10_kpa": "10 %",
    "muscle.friction_slope_n_per_bar": "10 %",
    "tendon.slack_length_mm": "1 %",
    "tendon.stiffness_1_n_per_mm": "10 %",
    "tendon.stiffness_2_n_per_mm": "10 %",
    "damper.orifice_concentric_mm": "3 %",
    "damper.orifice_eccentric_mm": "3 %",
}
"""Numbers of a device that one seldom knows, and a usual standard deviation."""


@click.command("measure")
@click.argument("device_name", metavar="DEVICE")
@click.option("--out", type=NonEmptyPath(), required=True, metavar="FOLDER", help="New or empty folder for the plan.")
@click.option(
    "--repeats",
    type=int,
    default=MIN_REPEATS,
    show_default=True,
    metavar="N",
    help="How often each protocol is recorded; only repeats tell noise from misfit.",
)
@click.option(
    "--only",
    multiple=True,
    metavar="PROTOCOL",
    help="Plan this protocol only (steps, ramps, sines, release, hold, slack, mixed); may be given several times.",
)
@click.option(
    "--rehearse",
    is_flag=True,
    help="Simulate the recordings, too, with noise, to try what comes afterwards. They are no measurements.",
)
@common.json_option()
def command(device_name: str, out: Path, repeats: int, only: tuple[str, ...], rehearse: bool, as_json: bool) -> None:
    """Plan what to record with DEVICE (preset or device file) on a tensile tester.

    Writes into FOLDER one CSV per protocol with the commands for the tester (time [s], length [mm] of the whole
    unit, pressure_command [bar]; 200 Hz), the device file, a dataset.toml that names the files you will record, and
    README.txt: what to record, how, and what to change on the rig where no command tells two effects apart.

    \b
    Examples:
      klute-sim measure klute-3-4-pair --out my-bench
      klute-sim measure my-device.toml --out short --only steps --only ramps --repeats 3
      klute-sim measure klute-3-4-pair --out tried --rehearse
    """
    from klute_sim.bench.protocols.identification import PROTOCOLS
    from klute_sim.device.device import check_takes_pressure, load_device
    from klute_sim.errors import InputError
    from klute_sim.recording import run_folder

    if not MIN_REPEATS <= repeats <= MAX_REPEATS:
        raise InputError(
            f"--repeats is {repeats}; allowed: {MIN_REPEATS} to {MAX_REPEATS} (noise shows only where a protocol is repeated)"
        )
    for name in only:
        if name not in PROTOCOLS:
            raise InputError(f"there is no protocol '{name}'; there are: {', '.join(PROTOCOLS)}")
    device = load_device(device_name)
    check_takes_pressure(device, "the plan")
    chosen = [protocol for name, protocol in PROTOCOLS.items() if not only or name in only]
    programs = [round_program(protocol.build_program(device)) for protocol in chosen]
    with run_folder.create_run_folder("measure", out) as (folder, scratch):
        _write_plan(device, chosen, programs, repeats, scratch, simulate=rehearse)
        files = sorted(file.name for file in scratch.iterdir())
    shown = {
        "folder": str(folder),
        "device": device.name,
        "simulated": rehearse,
        "protocols": [
            {
                "name": protocol.name,
                "sentence": protocol.description,
                "shows": list(protocol.revealed_effects),
                "use": use,
                "duration_s": float(program.time[-1]),
                "command": f"{protocol.name}.csv",
                "record": list_recording_files(protocol, repeats),
            }
            for protocol, program, use in zip(chosen, programs, assign_uses(chosen), strict=True)
        ],
        "files": files,
    }
    if as_json:
        click.echo(json.dumps(shown, indent=2, allow_nan=False))
    else:
        _print_plan(shown)


def assign_uses(protocols: "Sequence[IdentificationProtocol]") -> "list[Use | None]":
    """What the trials of each protocol are for; where none would be left to fit, the program is to decide."""
    given = [protocol.use for protocol in protocols]
    return list(given) if "fit" in given else [None] * len(given)


def list_recording_files(protocol: "IdentificationProtocol", n_repeats: int) -> list[str]:
    """Names of the files that will hold the repeats of ``protocol``."""
    return [f"{protocol.name}_{letter}.csv" for letter in string.ascii_lowercase[:n_repeats]]


def round_program(program: "Program") -> "Program":
    """``program`` as its CSV file says it: to 0.1 um and 10 Pa, never longer or higher than it was."""
    import numpy as np

    length = np.floor(1e7 * program.unit_length + 1e-3) / 1e7
    return type(program)(np.round(program.time, 6), length, np.floor(0.1 * program.command + 1e-3) * 10.0)


def command_columns(program: "Program") -> "dict[str, NDArray[np.float64]]":
    """The columns of a command file."""
    import numpy as np

    return {
        "time [s]": program.time,
        "length [mm]": np.round(1e3 * program.unit_length, 4),
        "pressure_command [bar]": np.round(1e-5 * program.command, 4),
    }


def simulate_recording(device: "Device", program: "Program", seed: Sequence[int]) -> "dict[str, NDArray[np.float64]]":
    """What a recording of ``program`` might hold: ``device`` simulated, with noise. No measurement."""
    import numpy as np

    from klute_sim.device.dynamics import compute_equilibrium_state, compute_tension
    from klute_sim.device.rollout import simulate_rollouts
    from klute_sim.units import BAR

    time, length, command = program
    fine = TIME_STEP * np.arange(1, round(time[-1] / TIME_STEP) + 1)
    start = compute_equilibrium_state(device.parameters, float(length[0]), float(command[0]))
    found = simulate_rollouts(
        device.parameters,
        np.interp(fine, time, length),
        np.interp(fine, time, command),
        TIME_STEP,
        initial_state=start,
        n_jobs=1,
    )
    first = compute_tension(device.parameters, start, float(length[0]), 0.0)
    force = np.interp(time, [0.0, *fine], [first, *found.tension])
    pressure = np.interp(time, [0.0, *fine], [start.pressure, *found.pressure]) / BAR
    rng = np.random.default_rng(seed)
    return {
        **command_columns(program),
        "force [N]": np.round(force + rng.normal(0.0, FORCE_NOISE_N, len(time)), 3),
        "pressure [bar]": np.round(pressure + rng.normal(0.0, PRESSURE_NOISE_BAR, len(time)), 5),
    }


def _write_plan(
    device: "Device",
    protocols: "Sequence[IdentificationProtocol]",
    programs: "Sequence[Program]",
    n_repeats: int,
    folder: Path,
    *,
    simulate: bool,
) -> None:
    from klute_sim.datasets.write import write_trial

    for number, (protocol, program) in enumerate(zip(protocols, programs, strict=True)):
        write_trial(folder / f"{protocol.name}.csv", command_columns(program))
        if simulate:
            for repeat, file in enumerate(list_recording_files(protocol, n_repeats)):
                write_trial(folder / file, simulate_recording(device, program, (number, repeat)))
    (folder / "device.toml").write_bytes(device.content)
    (folder / "dataset.toml").write_text(format_dataset_toml(device, protocols, n_repeats, simulated=simulate), "utf-8")
    (folder / "README.txt").write_text(
        format_readme(device, protocols, programs, n_repeats, simulated=simulate), "utf-8"
    )


def format_dataset_toml(
    device: "Device", protocols: "Sequence[IdentificationProtocol]", n_repeats: int, *, simulated: bool
) -> str:
    """The dataset's file, with the trials that will be recorded."""
    from klute_sim.datasets.format import FORMAT_NAME

    numbers, muscle = device.spec.collect_values(), device.spec.muscle
    off = {"muscle.c10_kpa": not muscle.bladder, "muscle.friction_slope_n_per_bar": not muscle.friction}
    doubted = {
        key: deviation for key, deviation in DEFAULT_UNCERTAINTIES.items() if numbers.get(key) and not off.get(key)
    }
    lines = [SIMULATED_NOTE, ""] if simulated else []
    lines += [
        "# Paths are relative to this folder. Delete the trials that you did not record.",
        f'format = "{FORMAT_NAME}"',
        'rig = "bench"',
        'device = "device.toml"',
        "",
        "# Numbers of the device that you know only so well (standard deviations): they are refitted before anything",
        "# is blamed. Delete what you know, add what you doubt.",
        "[uncertain]",
        *(f'"{key}" = "{deviation}"' for key, deviation in doubted.items()),
    ]
    for protocol, use in zip(protocols, assign_uses(protocols), strict=True):
        lines += ["", f"# {protocol.description}"]
        for file in list_recording_files(protocol, n_repeats):
            lines += ["[[trial]]", f'files = ["{file}"]', f'group = "{protocol.name}"']
            lines += [f'use = "{use}"'] if use else []
    return "\n".join(lines) + "\n"


SIMULATED_NOTE = "# simulated, not measured: klute-sim measure --rehearse made the recordings from device.toml"

README_TEMPLATE = """\
{mark}What to record with '{device}' on a tensile tester
{line}

1. Feed each command file to the tester and the pressure regulator. Its columns:
   time [s]                from 0, a row every 5 ms
   length [mm]             {length}
   pressure_command [bar]  gauge pressure for the regulator
   All lengths are between {short:.1f} and {long:.1f} mm, all pressures between {least:.2f} and {most:.2f} bar. Speeds
   reach {speed:.2f} m/s and accelerations {acceleration:.0f} m/s2; a tester that cannot may play a file more slowly.

2. Record each protocol {repeats} times, into the files named here:
{protocols}
   With one recording nobody can tell noise from what the simulation gets wrong. Run all protocols once, then all of
   them again, so that a drift shows.

3. Each recording is a CSV file with a heading line and these columns:
   time [s]                the clock of the others
   length [mm]             as measured at the crosshead, not as commanded
   pressure_command [bar]  as given to the regulator, when it was given
   force [N]               the load cell; pulling is positive
   pressure [bar]          a gauge on the muscle
   muscle_length [mm]      of the muscle alone; if you can
   Other units will do (kgf, kPa, in, ms): write them in the brackets. Leave cells without a sample empty. Log 1000
   rows per second if you can, 200 at least: between rows the length is taken for a straight line.

4. Start at rest. Hold the first length and pressure until nothing changes, then start; the first 0.5 s of every file
   stand still. The simulation begins in equilibrium, and what still creeps would be taken for an effect.

5. Measure the device's own numbers (lengths, stiffnesses) as well as you can and put them into device.toml. In
   dataset.toml, under [uncertain], say how well you know the others. The lengths above belong to the device.toml of
   this plan: if its resting or slack length changes, make a new plan.
{bare}
What no command can tell apart
------------------------------
Some effects look alike whatever you command. Another rig splits them:
- A wrong regulator or a wrong pressure sensor: put a second gauge on the muscle's port for one protocol. Where both
  gauges agree, the regulator is wrong.
- A load cell's wrong gain or tapering ends of the muscle: hang a known dead weight on the load cell. Tapering ends do
  not change what a weight weighs.
- Slack in the tendon or a threshold pressure or a tapering end: record muscle_length [mm], too.
- Load cell offset or the device's own: record the load cell with the device unhooked.
- A late clock or a slow line: knock on the crosshead once with all channels on; all must show it at the same time.
Give a trial from another rig a group of its own, and say under [trial.device] what was different about the device.

Then, in this folder: klute-sim diagnose .
"""
BARE_MUSCLE_NOTE = """
6. This device has no tendon: the clamps hold the muscle itself. When it is short and its pressure is low, it pushes
   (negative force). The clamps have to take that, and the muscle must not buckle; if it does, empty the cells of force
   in those rows (not the rows: length and pressure are still needed).
"""


def format_readme(
    device: "Device",
    protocols: "Sequence[IdentificationProtocol]",
    programs: "Sequence[Program]",
    n_repeats: int,
    *,
    simulated: bool,
) -> str:
    """What to do, in plain words."""
    import numpy as np

    from klute_sim.bench.protocols.identification import SAMPLE_INTERVAL

    rigid = device.parameters.tendon.is_rigid
    told = []
    for protocol, program in zip(protocols, programs, strict=True):
        files = list_recording_files(protocol, n_repeats)
        named = ", ".join(files) if n_repeats <= 3 else f"{files[0]} to {files[-1]}"
        told.append(f"   {protocol.name}.csv ({program.time[-1]:.1f} s) -> {named}\n      {protocol.description}")
        if protocol.revealed_effects:
            shows = f"Shows best: {', '.join(protocol.revealed_effects)}."
            told += textwrap.wrap(shows, 115, initial_indent=" " * 6, subsequent_indent=" " * 6)
    length, pressure = ([p[k] for p in programs] for k in (1, 2))
    title = f"What to record with '{device.name}' on a tensile tester"
    return README_TEMPLATE.format(
        mark=f"{SIMULATED_NOTE.removeprefix('# ')}\n\n" if simulated else "",
        device=device.name,
        line="=" * len(title),
        length="of the muscle, clamp to clamp" if rigid else "of the whole unit, muscle and tendon",
        short=1e3 * min(x.min() for x in length),
        long=1e3 * max(x.max() for x in length),
        least=1e-5 * min(p.min() for p in pressure),
        most=1e-5 * max(p.max() for p in pressure),
        speed=max(np.abs(np.diff(x)).max() for x in length) / SAMPLE_INTERVAL,
        acceleration=max(np.abs(np.diff(x, 2)).max() for x in length) / SAMPLE_INTERVAL**2,
        repeats=n_repeats,
        protocols="\n".join(told),
        bare=BARE_MUSCLE_NOTE if rigid else "",
    )


def _print_plan(plan: dict[str, Any]) -> None:
    from rich.table import Table

    from klute_sim.cli.console import stdout_console

    table = Table("protocol", "seconds", "use", "what it is for")
    for row in plan["protocols"]:
        table.add_row(row["name"], f"{row['duration_s']:.1f}", row["use"] or "drawn later", row["sentence"])
    out = stdout_console()
    out.print(table)
    if plan["simulated"]:
        out.print("The recordings are simulated, not measured.")
    out.print(f"Plan: {plan['folder']}; begin with README.txt there.", soft_wrap=True)
