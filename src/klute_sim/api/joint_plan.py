"""Plan measurements of a joint or a free load: :func:`plan_joint_measurements`, with its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.joint import DEFAULT_DEVICE, assign_devices
from klute_sim.api.rendering import Summary
from klute_sim.api.saved_plan import SavedPlan
from klute_sim.diagnosis.planning.measurement_plan import MIN_REPEATS, check_repeats, list_repeat_files
from klute_sim.diagnosis.planning.mechanism_plan import MechanismPlan, write_mechanism_plan
from klute_sim.errors import InputError
from klute_sim.mechanism.mounting import mount_devices
from klute_sim.mechanism.protocols import TESTS, ProtocolSettings, plan_test
from klute_sim.mechanism.run import check_pressures, find_joint
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.units import BAR

TESTS_WITHOUT_LOAD = ("steps", "sines", "multisine")
"""Tests that are planned where no load is given."""


@dataclass(frozen=True, repr=False)
class JointPlan(SavedPlan):
    """Plan of measurements on a joint or a free load: trials of its tests, and instructions."""

    plan: MechanismPlan
    """Trials, devices and model."""
    simulate: bool
    """Whether the plan contains simulated recordings."""

    def to_dict(self) -> dict[str, Any]:
        """Return model, devices and trials with their files, ready for JSON."""
        return {
            "model": self.plan.file.name,
            "devices": {tendon: device.name for tendon, device in self.plan.devices.items()},
            "measured": list(self.plan.measured),
            "simulated": self.simulate,
            "trials": [
                {
                    "name": trial.name,
                    "test": test,
                    "use": self.plan.assign_use(test),
                    "duration_s": trial.duration,
                    "command": f"{trial.name}.csv",
                    "recordings": list_repeat_files(trial.name, self.plan.n_repeats),
                }
                for test, trial in self.plan.trials
            ],
        }

    def format_summary(self) -> Summary:
        """Yield the table of the trials."""
        from klute_sim.terminal_table import create_table

        table = create_table("trial", "test", "seconds", "use")
        for row in self.to_dict()["trials"]:
            table.add_row(row["name"], row["test"], f"{row['duration_s']:.1f}", row["use"] or "assigned later")
        yield table
        yield from self._describe_origin()

    def __repr__(self) -> str:
        """Return one line: model, number of trials and repeats."""
        return f"JointPlan({self.plan.file.name!r}, {len(self.plan.trials)} trials, {self.plan.n_repeats} repeats)"

    def _write(self, folder: Path) -> None:
        write_mechanism_plan(self.plan, folder, simulate=self.simulate)


def plan_joint_measurements(
    device: DeviceLike | Mapping[str, DeviceLike] = DEFAULT_DEVICE,
    *,
    model: str | Path = "antagonist_joint",
    only: Sequence[str] = (),
    n_repeats: int = MIN_REPEATS,
    mean_pressure_bar: float = 2.5,
    difference_bar: float = 1.0,
    load: float | None = None,
    simulate: bool = False,
) -> JointPlan:
    """Return a plan of the measurements that a diagnosis of ``model`` with ``device`` on its tendons needs.

    Args:
        device: Device, preset or path for all tendons, or a mapping from tendons to devices.
        model: Model of the package, or the path of an MJCF file with one joint.
        only: Names of the tests. Empty: all; those with a load only where ``load`` is given.
        n_repeats: Number of recordings of each trial; noise is measured from the differences between repeats.
        mean_pressure_bar: Mean gauge pressure [bar].
        difference_bar: Amplitude of the pressure difference [bar].
        load: External moment [N m] or force [N] of the tests with a load.
        simulate: Whether to simulate the recordings, with noise, to test the diagnosis.

    Raises InputError when an input is not usable.
    """
    check_repeats(n_repeats)
    file = load_model_file(model)
    joint, unit = find_joint(file)
    tendons = [tendon.name for tendon in file.make_spec().tendons if tendon.name]
    devices = {name: to_device(entry) for name, entry in assign_devices(device, tendons).items()}
    if len(devices) not in (1, 2):
        raise InputError(f"{file.path} has {len(devices)} devices; a plan needs one, or two antagonists")
    tests = tuple(dict.fromkeys(only)) or (tuple(TESTS) if load is not None else TESTS_WITHOUT_LOAD)
    for test in tests:
        if load is None and test in TESTS and test not in TESTS_WITHOUT_LOAD:
            raise InputError(f"test '{test}' needs a load; give one, or plan only: {', '.join(TESTS_WITHOUT_LOAD)}")
    settings = ProtocolSettings(mean_pressure_bar * BAR, difference_bar * BAR, load or 0.0)
    trials = tuple((test, trial) for test in tests for trial in plan_test(test, settings))
    check_pressures(devices, [trial for _, trial in trials])
    plan = MechanismPlan(file, devices, mount_devices(file, devices), joint, unit, trials, n_repeats)
    return JointPlan(plan, simulate)
