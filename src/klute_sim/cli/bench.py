"""``klute-sim bench``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from klute_sim.cli import common

if TYPE_CHECKING:
    from klute_sim.bench.run import BenchResult
    from klute_sim.device.device import Device

DEFAULT_DEVICE = "klute-3-4-pair"
"""Tested where none is named: the muscle-tendon unit of chapters 7 and 8."""


@click.command("bench")
@click.argument("protocol_name", metavar="[PROTOCOL|FILE]", required=False)
@click.argument("device_name", metavar="[DEVICE|FILE]", required=False)
@click.option("--list", "as_list", is_flag=True, help="List the protocols that come with the package.")
@click.option("--toml", "as_toml", is_flag=True, help="Print the protocol file itself, to start your own from.")
@click.option(
    "--mujoco",
    is_flag=True,
    help="In the MuJoCo tester, with a crosshead on a servo and a load cell; slower.  [default: the device alone]",
)
@common.TIME_STEP_OPTION
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
    """Run a PROTOCOL of a tensile tester on a DEVICE (preset or device file; left out: klute-3-4-pair).

    The crosshead moves the whole unit [mm, mm/s; shortening is positive], the regulator follows a pressure command
    [bar]; force [N], work per cycle [J; positive: done by the device] and responses are read. Without a PROTOCOL, the
    protocols are listed. A protocol is a file: numbers in it that nobody printed are marked as assumed.

    Writes summary.json, results.csv (a row per trial), figure.png, protocol.toml, device.toml and a Parquet file per
    trial, which is a valid trial of a dataset.

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
            raise InputError(f"{'--toml needs' if as_toml else '--list goes without'} a protocol")
        _list_protocols(as_json=as_json)
        return
    from klute_sim.bench.protocols import library as protocols_library

    content = protocols_library.read_protocol_bytes(protocol_name)
    protocol = protocols_library.parse_protocol(content, protocol_name)
    if as_toml:
        if as_json:
            raise InputError("--toml and --json do not go together")
        click.echo(content.decode("utf-8-sig"), nl=False)
        return
    from klute_sim.bench.run import run_protocol
    from klute_sim.cli.console import progress_bar
    from klute_sim.recording import run_folder

    device = _load_device(DEFAULT_DEVICE if device_name is None else device_name)
    with run_folder.create_run_folder("bench", out) as (folder, scratch):
        with progress_bar("testing") as progress:
            result = run_protocol(device, protocol, use_mujoco=mujoco, dt=1e-3 * step_ms, progress=progress)
        shown = _write(result, content, folder, scratch)
    _report(result, shown, as_json=as_json)


def _load_device(name: str) -> "Device":
    """The preset or device file of that ``name``; raises InputError, also for what is a protocol."""
    from klute_sim.bench.protocols import library as protocols_library
    from klute_sim.device.device import list_presets, load_device
    from klute_sim.errors import InputError

    swapped = f"'{name}' is a protocol where a device is expected: klute-sim bench PROTOCOL DEVICE"
    if name in protocols_library.list_protocols():
        raise InputError(swapped)
    path = Path(name)
    file = name not in list_presets() and path.exists() and not path.is_dir()
    if file and protocols_library.is_protocol(protocols_library.read_small_file(name, "device")):
        raise InputError(swapped)
    return load_device(name)


def _list_protocols(*, as_json: bool) -> None:
    from klute_sim.bench.protocols import library as protocols_library

    known = {name: protocols_library.load_protocol(name) for name in protocols_library.list_protocols()}
    if as_json:
        rows = [{"name": name, "kind": p.kind, "description": p.description} for name, p in known.items()]
        click.echo(json.dumps(rows, indent=2))
        return
    for name, protocol in known.items():
        click.echo(f"{name:16} {protocol.description}")


def _write(result: "BenchResult", content: bytes, folder: Path, scratch: Path) -> dict[str, Any]:
    """Fill ``scratch``; the summary."""
    from klute_sim.cli.console import progress_bar
    from klute_sim.recording import parquet
    from klute_sim.report.bench import figure as bench_figure
    from klute_sim.report.bench.table import format_results_csv, summarize_bench_run

    with progress_bar("writing") as progress:
        (scratch / "device.toml").write_bytes(result.device.content)
        (scratch / "protocol.toml").write_bytes(content)
        (scratch / "results.csv").write_text(format_results_csv(result), "utf-8")
        for number, trial in enumerate(result.trials):
            parquet.write(trial.recording, scratch / f"{trial.name}.parquet")
            progress(0.7 * number / len(result.trials))
        bench_figure.save_figure(result, scratch / "figure.png")
        files = [*sorted(file.name for file in scratch.iterdir()), "summary.json"]
        shown = {**summarize_bench_run(result), "run": str(folder), "files": files}
        (scratch / "summary.json").write_text(_to_json(shown) + "\n", "utf-8")
    return shown


def _to_json(summary: dict[str, Any]) -> str:
    return json.dumps(summary, indent=2, allow_nan=False)


def _report(result: "BenchResult", summary: dict[str, Any], *, as_json: bool) -> None:
    from klute_sim.cli.console import stdout_console
    from klute_sim.report.bench.table import build_table

    if as_json:
        click.echo(_to_json(summary))
        return
    out = stdout_console()
    out.print(build_table(result))
    for remark in summary["remarks"]:
        out.print(remark, soft_wrap=True)
    out.print(
        f"Run folder: {summary['run']}  (figure.png, results.csv, summary.json, {len(result.trials)} Parquet files)",
        soft_wrap=True,
    )
