"""``klute-sim bench``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from klute_sim.cli import common, completion
from klute_sim.cli.option_sections import Command, section

if TYPE_CHECKING:
    from klute_sim.device.device import Device


@click.command("bench", cls=Command)
@click.argument("protocol_name", metavar="[PROTOCOL|FILE]", required=False, shell_complete=completion.complete_protocol)
@click.argument("device_name", metavar="[DEVICE|FILE]", required=False, shell_complete=completion.complete_device)
@section("Simulation")
@click.option(
    "--mujoco",
    is_flag=True,
    help="Simulate the tester in MuJoCo, with a servo-driven crosshead and a load cell; slower.  [default: only the "
    "device is simulated]",
)
@common.TIME_STEP_OPTION
@section("Output")
@click.option("--list", "as_list", is_flag=True, help="List the protocols of the package.")
@click.option("--toml", "as_toml", is_flag=True, help="Print the file of PROTOCOL, as a template for your own.")
@common.out_option("bench", "the run")
@common.json_option()
def command(
    protocol_name: str | None,
    device_name: str | None,
    as_list: bool,
    as_toml: bool,
    mujoco: bool,
    step_ms: float,
    out: Path | None,
    as_json: bool,
) -> None:
    """Test a DEVICE on a simulated tensile tester with the commands of a PROTOCOL.

    DEVICE is a preset or a device file (default: klute-3-4-pair). PROTOCOL is a protocol of the package or a protocol
    file, in which numbers without a printed source are marked as assumed. Without PROTOCOL, the protocols are listed.

    The crosshead moves the whole unit [mm, mm/s; shortening is positive], and the regulator follows a pressure command
    [bar]. The results are force [N], work per cycle [J; positive: done by the device] and step responses.

    'klute-sim bench joint', 'bench mass' and 'bench knee' test a device on a joint or with a free load instead; see
    'klute-sim bench joint --help'.

    Writes summary.json, results.csv (one row per trial), index.html, figure.png, protocol.toml, device.toml and one
    Parquet file per trial, which a dataset for klute-sim diagnose can contain.

    \b
    Examples:
      klute-sim bench
      klute-sim bench isokinetic klute-3-4
      klute-sim bench workloop --mujoco --out loops
      klute-sim bench workloop --toml > mine.toml
      klute-sim bench mine.toml my-device.toml --json
    """
    from klute_sim.errors import InputError

    if protocol_name is None or as_list:
        if protocol_name is not None or as_toml:
            raise InputError("--toml needs a protocol" if as_toml else "--list takes no protocol")
        _list_protocols(as_json=as_json)
        return
    from klute_sim.bench.protocols.library import parse_protocol, read_protocol_bytes
    from klute_sim.cli.console import write_text

    content = read_protocol_bytes(protocol_name)
    parse_protocol(content, protocol_name)
    if as_toml:
        if as_json:
            raise InputError("--toml and --json exclude each other; give one of them")
        write_text(content.decode("utf-8-sig"))
        return
    from klute_sim.api.bench import DEFAULT_DEVICE, simulate_bench
    from klute_sim.api.rendering import print_summary
    from klute_sim.cli.console import progress_bar, stdout_console
    from klute_sim.recording.run_folder import create_run_folder

    device = _load_device(DEFAULT_DEVICE if device_name is None else device_name)
    with create_run_folder("bench", out) as (folder, scratch):
        with progress_bar("testing") as progress:
            run = simulate_bench(device, protocol_name, mujoco=mujoco, time_step=1e-3 * step_ms, progress=progress)
        with progress_bar("writing") as progress:
            summary = run.write_files(scratch, folder, progress)
    if as_json:
        click.echo(json.dumps(summary, indent=2, allow_nan=False))
        return
    console = stdout_console()
    print_summary(console, run.format_summary())
    n_files = len(run.recordings)
    console.print(
        f"Run folder: {folder}  (index.html, figure.png, results.csv, summary.json, {n_files} Parquet files)",
        soft_wrap=True,
    )


def _load_device(name: str) -> "Device":
    """Return the device of that ``name`` or path; raise InputError also for a protocol."""
    from klute_sim.bench.protocols.library import is_protocol, list_protocols
    from klute_sim.device.device import list_presets, load_device
    from klute_sim.errors import InputError
    from klute_sim.files.limits import DEVICE
    from klute_sim.files.reading import read_bytes

    message = f"'{name}' is a protocol where a device is expected: klute-sim bench PROTOCOL DEVICE"
    if name in list_protocols():
        raise InputError(message)
    path = Path(name)
    is_file = name not in list_presets() and path.exists() and not path.is_dir()
    if is_file and is_protocol(read_bytes(name, DEVICE)):
        raise InputError(message)
    return load_device(name)


def _list_protocols(*, as_json: bool) -> None:
    from klute_sim.bench.protocols.library import list_protocols, load_protocol

    protocols = {name: load_protocol(name) for name in list_protocols()}
    if as_json:
        rows = [{"name": name, "kind": p.kind, "description": p.description} for name, p in protocols.items()]
        click.echo(json.dumps(rows, indent=2))
        return
    for name, protocol in protocols.items():
        click.echo(f"{name:16} {protocol.description}")
