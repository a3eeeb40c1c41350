"""Measurement plan for a tensile tester: command files, a dataset file to fill, and instructions."""

import string
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from klute_sim.bench.protocols.identification import IdentificationProtocol, Program
from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets.format import FORMAT_NAME
from klute_sim.datasets.split import MIN_GROUPS_FOR_TEST
from klute_sim.datasets.trial import Use
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, check_accepts_pressure, check_is_testable
from klute_sim.device.dynamics import compute_tension
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.interpolation import interpolate_smoothly
from klute_sim.diagnosis.planning.measurement_readme import format_readme
from klute_sim.errors import InputError
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_REPEATS, MAX_REPEATS = 2, 26
"""Limits of the number of repeats: noise needs two, and the files are lettered."""
FORCE_NOISE_N, PRESSURE_NOISE_BAR = 3.0, 0.01
"""Standard deviations of the noise of simulated recordings [N, bar] (assumed)."""
TIME_STEP = 2.5e-4
"""Time step of simulated recordings [s]; the sampling interval of the commands is a multiple of it."""
DEFAULT_UNCERTAINTIES = {
    "muscle.c10_kpa": "10 %",
    "muscle.friction_slope_n_per_bar": "10 %",
    "tendon.slack_length_mm": "1 %",
    "tendon.stiffness_1_n_per_mm": "10 %",
    "tendon.stiffness_2_n_per_mm": "10 %",
    "damper.orifice_concentric_mm": "3 %",
    "damper.orifice_eccentric_mm": "3 %",
}
"""Usual standard deviations of the numbers of a device that are rarely known exactly (assumed)."""
SIMULATED_NOTE = "# simulated, not measured: klute-sim plan --simulate made the recordings from device.toml"


def select_protocols(names: Sequence[str], device: Device) -> list[IdentificationProtocol]:
    """Return the identification protocols of these names, in the order of recording.

    Without names, all that reveal something of ``device``. Raises InputError for an unknown name.
    """
    protocols = load_identification_protocols()
    for name in names:
        if name not in protocols:
            raise InputError(f"there is no protocol '{name}'; allowed: {', '.join(protocols)}")
    if names:
        return [protocol for name, protocol in protocols.items() if name in names]
    return [protocol for protocol in protocols.values() if not protocol.explain_uselessness(device)]


def check_has_plan(device: Device) -> None:
    """Raise InputError when a tester cannot pull ``device``, or no plan reveals it."""
    check_is_testable(device)
    check_accepts_pressure(device, "the plan")
    if device.spec.muscle is None and device.spec.cylinder is not None and device.spec.tendon is not None:
        raise InputError(
            f"device '{device.name}' has no plan: its [tendon] cannot push the piston of its [cylinder] back between "
            "moves; plan both parts alone (one file without [tendon], one without [cylinder] and [damper]), or record "
            "pulls that each begin with the piston at its inner stop"
        )


def assign_uses(protocols: Sequence[IdentificationProtocol]) -> list[Use | None]:
    """Return the use of each protocol's trials; None where :func:`is_complete_split` leaves it to the split."""
    uses = [protocol.use for protocol in protocols]
    return list(uses) if is_complete_split(uses) else [None] * len(uses)


def is_complete_split(uses: Sequence[Use]) -> bool:
    """Return whether ``uses`` of groups leave groups to fit, and to test where there are enough of them.

    Otherwise the split of the dataset decides.
    """
    return "fit" in uses and ("test" in uses or len(uses) < MIN_GROUPS_FOR_TEST)


def list_repeat_files(name: str, n_repeats: int) -> list[str]:
    """Return the names of the files for the repeats of the trial called ``name``."""
    return [f"{name}_{letter}.csv" for letter in string.ascii_lowercase[:n_repeats]]


def check_repeats(n_repeats: int) -> None:
    """Raise InputError unless ``n_repeats`` is within its limits."""
    if not MIN_REPEATS <= n_repeats <= MAX_REPEATS:
        raise InputError(
            f"the number of repeats is {n_repeats}; allowed: {MIN_REPEATS} to {MAX_REPEATS} (noise is measured from "
            "repeats)"
        )


def round_program(program: Program) -> Program:
    """Return ``program`` with the resolution of its CSV file: 0.1 um and 10 Pa, rounded down."""
    length = np.floor(1e7 * program.unit_length + 1e-3) / 1e7
    return Program(np.round(program.time, 6), length, np.floor(0.1 * program.command + 1e-3) * 10.0)


def command_columns(device: Device, program: Program) -> dict[str, Array]:
    """Return the columns of the command file of ``program``; a ``device`` without a supply needs no pressures."""
    columns = {"time [s]": program.time, "length [mm]": np.round(1e3 * program.unit_length, 4)}
    if device.spec.supply is None:
        return columns
    return {**columns, "pressure_command [bar]": np.round(1e-5 * program.command, 4)}


def simulate_recording(device: Device, program: Program, seed: Sequence[int]) -> dict[str, Array]:
    """Return the columns of a simulated recording of ``program`` on ``device``, with noise from ``seed``."""
    time, length, command = program
    grid = TIME_STEP * np.arange(1, round(time[-1] / TIME_STEP) + 1)
    state = compute_equilibrium_state(device.parameters, float(length[0]), float(command[0]))
    rollout = simulate_rollouts(
        device.parameters,
        interpolate_smoothly(grid, time, length),
        np.interp(grid, time, command),
        TIME_STEP,
        initial_state=state,
        n_jobs=1,
    )
    initial_tension = compute_tension(device.parameters, state, float(length[0]), 0.0)
    force = np.interp(time, [0.0, *grid], [initial_tension, *rollout.tension])
    pressure = np.interp(time, [0.0, *grid], [state.pressure, *rollout.pressure]) / BAR
    rng = np.random.default_rng(seed)
    columns = {
        **command_columns(device, program),
        "force [N]": np.round(force + rng.normal(0.0, FORCE_NOISE_N, len(time)), 3),
    }
    if device.spec.supply is None:
        return columns
    return {**columns, "pressure [bar]": np.round(pressure + rng.normal(0.0, PRESSURE_NOISE_BAR, len(time)), 5)}


def write_plan_files(
    device: Device,
    protocols: Sequence[IdentificationProtocol],
    programs: Sequence[Program],
    n_repeats: int,
    folder: Path,
    *,
    simulate: bool,
) -> None:
    """Write the command files, device.toml, dataset.toml and README.txt; with ``simulate`` also recordings."""
    for index, (protocol, program) in enumerate(zip(protocols, programs, strict=True)):
        write_trial(folder / f"{protocol.name}.csv", command_columns(device, program))
        if simulate:
            for repeat, file in enumerate(list_repeat_files(protocol.name, n_repeats)):
                write_trial(folder / file, simulate_recording(device, program, (index, repeat)))
    dataset_file = format_dataset_toml(device, protocols, n_repeats, simulated=simulate)
    (folder / "device.toml").write_bytes(device.content)
    (folder / "dataset.toml").write_text(dataset_file, "utf-8")
    files = [list_repeat_files(protocol.name, n_repeats) for protocol in protocols]
    note = f"{SIMULATED_NOTE.removeprefix('# ')}\n\n" if simulate else ""
    readme = note + format_readme(device, protocols, programs, files)
    (folder / "README.txt").write_text(readme, "utf-8")


def list_usual_uncertainties(device: Device) -> dict[str, str]:
    """Return those of :data:`DEFAULT_UNCERTAINTIES` whose numbers ``device`` has."""
    values, muscle = device.spec.collect_values(), device.spec.muscle
    is_off = {
        "muscle.c10_kpa": not (muscle and muscle.bladder),
        "muscle.friction_slope_n_per_bar": not (muscle and muscle.friction),
    }
    return {
        key: deviation for key, deviation in DEFAULT_UNCERTAINTIES.items() if values.get(key) and not is_off.get(key)
    }


def format_dataset_toml(
    device: Device, protocols: Sequence[IdentificationProtocol], n_repeats: int, *, simulated: bool
) -> str:
    """Return the content of dataset.toml with the trials to record."""
    uncertain = list_usual_uncertainties(device)
    lines = [SIMULATED_NOTE, ""] if simulated else []
    lines += [
        "# Paths are relative to this folder. Delete the trials that you did not record.",
        f'format = "{FORMAT_NAME}"',
        'rig = "bench"',
        'device = "device.toml"',
        "",
        "# Standard deviations of the device's uncertain numbers. The diagnosis refits these numbers before it adds an",
        "# effect. Delete the numbers that you know exactly, and add other uncertain ones.",
        "[uncertain]",
        *(f'"{key}" = "{deviation}"' for key, deviation in uncertain.items()),
    ]
    for protocol, use in zip(protocols, assign_uses(protocols), strict=True):
        lines += ["", f"# {protocol.describe_for(device)}"]
        for file in list_repeat_files(protocol.name, n_repeats):
            lines += ["[[trial]]", f'files = ["{file}"]', f'group = "{protocol.name}"']
            lines += [f'use = "{use}"'] if use else []
    return "\n".join(lines) + "\n"
