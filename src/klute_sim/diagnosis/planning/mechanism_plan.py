"""Measurement plan for a joint or a free load: commands of its tests, a dataset file to fill, and instructions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.datasets.format import FORMAT_NAME
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR
from klute_sim.datasets.mechanism_channels import DISPLAY_UNITS, name_files, normalize_name, parse_channel
from klute_sim.datasets.trial import Use
from klute_sim.datasets.unit_conversion import get_conversion_factor
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device
from klute_sim.diagnosis.planning.measurement_plan import (
    PRESSURE_NOISE_BAR,
    SIMULATED_NOTE,
    is_complete_split,
    list_repeat_files,
    list_usual_uncertainties,
)
from klute_sim.files.toml import format_key, format_text
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.protocols import JointTrial
from klute_sim.mechanism.run import make_inputs
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_export import MODEL_FILE_NAME, build_model_files, write_files
from klute_sim.plant.mjcf.model_file import MODEL_NAMES, ModelFile
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers, set_model_numbers
from klute_sim.types import Array
from klute_sim.units import BAR

SAMPLE_INTERVAL, TIME_STEP = 5e-3, 5e-4
"""Sampling interval of the commands, and time step of simulated recordings [s]."""
POSITION_NOISE = {"deg": 0.05, "mm": 0.05}
"""Standard deviation of the noise of a simulated position, by its unit (assumed)."""
TEST_USES: Mapping[str, Use] = {
    **{"steps": "fit", "sines": "fit"},
    **{"multisine": "test", "co-contraction": "validation", "quick-release": "validation"},
}
"""Test -> use of its trials in a diagnosis."""
MASS_UNCERTAINTY, DAMPING_UNCERTAINTY = "5 %", "50 %"
"""Usual standard deviations of the largest mass of a model, and of the damping of its joint (assumed)."""
SLACK_LENGTH_KEY = "tendon.slack_length_mm"
"""Number that every tendon has for itself, because each is assembled on its own."""


@dataclass(frozen=True)
class MechanismPlan:
    """Trials to record on a joint or a free load."""

    file: ModelFile
    """MJCF file."""
    devices: Mapping[str, Device]
    """Tendon -> device."""
    numbers: Mapping[str, float]
    """Changed numbers of the model."""
    joint: str
    """Name of the joint."""
    unit: str
    """Unit of its position: ``deg`` or ``mm``."""
    trials: tuple[tuple[str, JointTrial], ...]
    """Test and trial, in the order of recording."""
    n_repeats: int
    """Number of recordings of each trial."""

    @property
    def has_loads(self) -> bool:
        """Whether a trial has an external load."""
        return any(trial.load is not None for _, trial in self.trials)

    @property
    def measured(self) -> tuple[str, ...]:
        """Channels to measure: the position of the joint and the pressure of every device."""
        quantity = "angle" if self.unit == "deg" else "position"
        pressures = [f"pressure_{normalize_name(name)}" for name in self.devices]
        return f"{quantity}_{normalize_name(self.joint)}", *pressures

    @property
    def device_files(self) -> dict[str, str]:
        """Tendon -> name of its device file; one file where all devices are equal."""
        are_equal = len({device.digest for device in self.devices.values()}) == 1
        return {
            tendon: "device.toml" if are_equal else f"device-{stem}.toml"
            for tendon, stem in name_files(self.devices).items()
        }

    def assign_use(self, test: str) -> Use | None:
        """Return the use of the trials of ``test``; None where :func:`is_complete_split` leaves it to the split."""
        return TEST_USES[test] if is_complete_split([TEST_USES[other] for other, _ in self.trials]) else None

    def make_commands(self, trial: JointTrial) -> tuple[Array, dict[str, Array]]:
        """Return time [s] and prescribed channels [SI] of ``trial``, with the resolution of the command file."""
        time: Array = SAMPLE_INTERVAL * np.arange(round(trial.duration / SAMPLE_INTERVAL) + 1, dtype=np.float64)
        inputs = make_inputs(trial, self.devices, self.joint, self.unit, time, has_load=self.has_loads)
        return time, {
            name: np.round(values, 0 if name.startswith("pressure") else 4) for name, values in inputs.items()
        }


def write_mechanism_plan(plan: MechanismPlan, folder: Path, *, simulate: bool) -> None:
    """Write command files, device files, model, dataset.toml and README.txt; with ``simulate`` also recordings."""
    for index, (_, trial) in enumerate(plan.trials):
        time, inputs = plan.make_commands(trial)
        commands = _to_columns(time, inputs)
        write_trial(folder / f"{trial.name}.csv", commands)
        if simulate:
            channels = _simulate_channels(plan, time, inputs)
            for repeat, file in enumerate(list_repeat_files(trial.name, plan.n_repeats)):
                rng = np.random.default_rng((index, repeat))
                write_trial(folder / file, {**commands, **_add_noise(channels, rng)})
    for tendon, file in plan.device_files.items():
        (folder / file).write_bytes(plan.devices[tendon].content)
    if plan.file.name not in MODEL_NAMES:
        write_files(build_model_files(plan.file, plan.file.make_spec()), folder)
    (folder / "dataset.toml").write_text(_format_dataset(plan, simulated=simulate), "utf-8")
    (folder / "README.txt").write_text(_format_readme(plan, simulated=simulate), "utf-8")


def _to_columns(time: Array, channels: Mapping[str, Array]) -> dict[str, Array]:
    columns = {"time [s]": np.round(time, 6)}
    for name, values in channels.items():
        channel = parse_channel(name)
        factor = get_conversion_factor(DISPLAY_UNITS[channel.si_unit], channel.si_unit) or 1.0
        columns[channel.display_heading] = values / factor
    return columns


def _simulate_channels(plan: MechanismPlan, time: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Return the measured channels at ``time`` [s] in their units for display, without noise."""
    grid = TIME_STEP * np.arange(1, round(time[-1] / TIME_STEP) + 1)
    mechanism = Mechanism(plan.file, tuple(plan.devices), tuple(inputs))
    rollout = simulate_mechanism(
        mechanism,
        {name: device.parameters for name, device in plan.devices.items()},
        {name: np.interp(grid, time, values) for name, values in inputs.items()},
        TIME_STEP,
        numbers=plan.numbers,
    )
    channels = {}
    for name in plan.measured:
        values = rollout.read_channel(mechanism.bind(parse_channel(name)))
        channels[name] = np.interp(time, np.concatenate([[0.0], grid]), np.concatenate([values[:1], values]))
    return {heading: values for heading, values in _to_columns(time, channels).items() if heading != "time [s]"}


def _add_noise(channels: Mapping[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    noisy = {}
    for heading, values in channels.items():
        unit = heading.partition("[")[2].removesuffix("]")
        noise = PRESSURE_NOISE_BAR if unit == "bar" else POSITION_NOISE[unit]
        noisy[heading] = np.round(values + rng.normal(0.0, noise, len(values)), 5)
    return noisy


def _list_uncertainties(plan: MechanismPlan) -> dict[str, str]:
    """Return the usual uncertain numbers of devices and model, with their standard deviations."""
    uncertain: dict[str, str] = {}
    for key, deviation in list_usual_uncertainties(next(iter(plan.devices.values()))).items():
        owners = [f"{tendon}{DEVICE_SEPARATOR}{key}" for tendon in plan.devices]
        uncertain |= dict.fromkeys(owners if key == SLACK_LENGTH_KEY else [key], deviation)
    spec = plan.file.make_spec()
    set_model_numbers(spec, plan.numbers)
    numbers = collect_model_numbers(spec)
    masses = {name: value for name, value in numbers.items() if name.endswith(".mass")}
    if masses:
        uncertain[max(masses, key=lambda name: masses[name])] = MASS_UNCERTAINTY
    damping = f"model.joint.{plan.joint}.damping"
    return uncertain | ({damping: DAMPING_UNCERTAINTY} if numbers.get(damping) else {})


def _format_dataset(plan: MechanismPlan, *, simulated: bool) -> str:
    model = plan.file.name if plan.file.name in MODEL_NAMES else MODEL_FILE_NAME
    _, inputs = plan.make_commands(plan.trials[0][1])
    files = plan.device_files
    own_files = files if len(set(files.values())) > 1 else {}
    lines = [SIMULATED_NOTE, ""] if simulated else []
    lines += [
        "# Paths are relative to this folder. Delete the trials that you did not record.",
        f'format = "{FORMAT_NAME}"',
        'rig = "mjcf"',
        f'model = "{model}"',
        f'device = "{next(iter(files.values()))}"',
        f"prescribed = {_format_list(inputs)}",
        f"measured = {_format_list(plan.measured)}",
        *(
            line
            for tendon, file in own_files.items()
            for line in ("", f"[devices.{format_key(tendon)}]", f'device = "{file}"')
        ),
        "",
        "# Numbers of the model that differ from its file, such as the heights of a frame that fits the muscles.",
        "[numbers]",
        *(f"{format_text(name)} = {value!r}" for name, value in plan.numbers.items()),
        "",
        "# Standard deviations of uncertain numbers of devices and model. Delete the numbers that you know exactly.",
        "[uncertain]",
        *(f'{format_text(key)} = "{deviation}"' for key, deviation in _list_uncertainties(plan).items()),
    ]
    for test, trial in plan.trials:
        use = plan.assign_use(test)
        for file in list_repeat_files(trial.name, plan.n_repeats):
            lines += ["", "[[trial]]", f'files = ["{file}"]', f'group = "{trial.name}"']
            lines += [f'use = "{use}"'] if use else []
    return "\n".join(lines) + "\n"


def _format_list(names: Sequence[str] | Mapping[str, Array]) -> str:
    return f"[{', '.join(chr(34) + name + chr(34) for name in names)}]"


README_TEMPLATE = """\
{note}Measurements of the joint '{joint}' of the model '{model}' with {devices}

1. Feed each command file to the pressure regulators{load}. Its rows are {interval:g} ms apart, and commands are linear
   between them. All pressures are between {lowest:.2f} and {highest:.2f} bar.

2. Record each trial {repeats} times, into the files named here. The diagnosis measures noise from the differences
   between repeats. Run all trials once, then all of them again, so that drift becomes visible.
{trials}

3. Each recording is a CSV file with a heading line, the columns of its command file, and these:
{channels}
   Other units are allowed: write them in the brackets. Log 200 rows per second or more.

4. Begin at rest: hold the first pressures until the joint no longer moves, then start.

5. Weigh and measure what can be weighed and measured, and put it into the device files, the model and [numbers].
   dataset.toml lists the numbers that are usually uncertain.

What commands and a position alone cannot tell
----------------------------------------------
- Inertia, weight and the force of the muscles scale together: weigh the load, or record a force (force_TENDON).
- A tilted stand or a shifted zero of the angle: let the joint hang without pressure, and read the angle.
- Friction of the joint or of the muscles: move the joint by hand without muscles, or record a force.
- A slow regulator or a slow sensor of the angle: the pressures that are recorded here separate them.

Then run, in this folder: klute-sim diagnose .
"""


def _format_readme(plan: MechanismPlan, *, simulated: bool) -> str:
    rows, lowest, highest = [], np.inf, -np.inf
    for test, trial in plan.trials:
        _, inputs = plan.make_commands(trial)
        pressures = np.concatenate([v for name, v in inputs.items() if name.startswith("pressure")]) / BAR
        lowest, highest = min(lowest, float(pressures.min())), max(highest, float(pressures.max()))
        files = list_repeat_files(trial.name, plan.n_repeats)
        listing = ", ".join(files) if plan.n_repeats <= 3 else f"{files[0]} to {files[-1]}"
        rows.append(f"   {trial.name}.csv ({test}, {trial.duration:.1f} s) -> {listing}")
    names = sorted({device.name for device in plan.devices.values()})
    return README_TEMPLATE.format(
        note=f"{SIMULATED_NOTE.removeprefix('# ')}\n\n" if simulated else "",
        joint=plan.joint,
        interval=1e3 * SAMPLE_INTERVAL,
        model=plan.file.name,
        devices=" and ".join(names),
        load=", and apply its external load" if plan.has_loads else "",
        lowest=lowest,
        highest=highest,
        repeats=plan.n_repeats,
        trials="\n".join(rows),
        channels="\n".join(f"   {parse_channel(name).display_heading}" for name in plan.measured),
    )
