"""README.txt of a measurement plan: how to play the commands, what to record, and which changes of the rig help."""

import textwrap
from collections.abc import Iterator, Sequence

import numpy as np

from klute_sim.bench.protocols.identification import SAMPLE_INTERVAL, IdentificationProtocol, Program
from klute_sim.device.device import Device
from klute_sim.laws import damper as damper_law
from klute_sim.laws import tendon as tendon_law

README_TEMPLATE = """\
Measurements of '{device}' on a tensile tester
{line}

1. Feed each command file to the {machines}. Its columns:
   time [s]                from 0, one row every {interval:g} ms
   length [mm]             {length}
   pressure_command [bar]  gauge pressure for the regulator
   {ranges}
   Speeds reach {speed:.2f} m/s and accelerations {acceleration:.0f} m/s2; a slower tester may play a file more slowly.

2. Record each protocol {repeats} times, into the files named here:
{protocols}
   The diagnosis measures noise from the differences between repeats. Run all protocols once, then all of them again,
   so that drift becomes visible.

3. Each recording is a CSV file with a heading line and these columns:
   time [s]                same clock for all columns
   length [mm]             as measured at the crosshead, not as commanded
   pressure_command [bar]  as given to the regulator, at the time it was given
   force [N]               load cell; tension is positive
   pressure [bar]          gauge on the {moving_part}
   muscle_length [mm]      length of the muscle alone (optional)
   Other units are allowed (kgf, kPa, in, ms): write them in the brackets. Leave cells without a sample empty. Log
   1000 rows per second if possible, 200 at least: nobody knows the motion between two rows.

4. Start at rest. Hold the first {held} until nothing changes, then start; the first 0.5 s of every file
   are at rest. The simulation starts in equilibrium, so remaining creep would be diagnosed as an effect.

5. Measure the device's own numbers (lengths, stiffnesses) as well as possible and put them into device.toml. In
   dataset.toml, under [uncertain], give the standard deviations of the others. The lengths above belong to the
   device.toml of this plan: if its resting or slack length changes, make a new plan.
{notes}
Effects that no command distinguishes
-------------------------------------
Some effects look alike under every command. A change of the rig distinguishes them:
{rig_changes}
Give a trial from another rig its own group. If an instrument was calibrated, or replaced by a second one, write its
readings into the column of its channel and trusted = ["{checked}"] into the [[trial]]. Write the numbers of the device
that differ under [trial.device].

Then run, in this folder: klute-sim diagnose .
"""
MUSCLE_RIG_CHANGES = """\
- Regulator error or pressure sensor error: put a second gauge on the muscle's port for one protocol. Where both
  gauges agree, the regulator is wrong.
- Load cell gain or tapering ends of the muscle: hang a dead weight on the load cell. Tapering ends do not change the
  reading of a weight.
- Slack in the tendon, a threshold pressure or a tapering end: record muscle_length [mm] as well.
- Offset of the load cell or of the device: record the load cell with the device unhooked.
- Clock skew or a slow pressure line: knock on the crosshead once while all channels record; all must show the knock at
  the same time."""
"""Changes of the rig for a device with a muscle."""
PART_RIG_CHANGES = """\
- Load cell gain or a wrong number of the device: hang a dead weight on the load cell.
- Offset of the load cell or of the device: record the load cell with the device unhooked.
- Clock skew or a slow sensor: knock on the crosshead once while all channels record; all must show the knock at
  the same time."""
"""Changes of the rig for a device without a muscle."""
PRESSURE_LINES = ("   pressure_command [bar]", "   pressure [bar]")
"""Beginnings of the lines of README.txt that a device without a supply does not need."""
MUSCLE_LENGTH_LINE = "   muscle_length [mm]"
"""Beginning of the line that a device without a muscle does not need."""
BARE_MUSCLE_NOTE = """
6. This device has no tendon: the clamps hold the muscle itself. At short lengths and low pressures it pushes (negative
   force). The clamps must take that, and the muscle must not buckle; if it does, empty the force cells in those rows
   (keep the rows: length and pressure are still needed).
"""
TENDON_NOTE = """
6. This device is a spring alone. Of a part that is pressed, such as a foot, the length is the slack length plus the
   compression, and the force of the press is positive. Forces reach about {force:.0f} N. If the part takes less,
   multiply all distances from the first length by the same factor: the diagnosis takes the recorded length.
"""
CYLINDER_NOTE = """
6. This device is a cylinder alone, clamped at both ends. It resists both ways: its force is negative while it is
   shortened.{force}
"""
DAMPER_FORCE_SENTENCE = (
    " The force of its damper reaches about {force:.0f} N; if it takes less, play the files more slowly."
)
"""Sentence of :data:`CYLINDER_NOTE` for a cylinder with a damper."""


def format_readme(
    device: Device,
    protocols: Sequence[IdentificationProtocol],
    programs: Sequence[Program],
    files: Sequence[Sequence[str]],
) -> str:
    """Return the content of README.txt for a plan that records ``files`` of each protocol."""
    has_supply = device.spec.supply is not None
    lengths = [program.unit_length for program in programs]
    title = f"Measurements of '{device.name}' on a tensile tester"
    readme = README_TEMPLATE.format(
        device=device.name,
        interval=1e3 * SAMPLE_INTERVAL,
        line="=" * len(title),
        machines="tester and the pressure regulator" if has_supply else "tester",
        length=_describe_length(device),
        ranges=_describe_ranges(programs, has_supply=has_supply),
        speed=_find_top_speed(programs),
        acceleration=max(np.abs(np.diff(length, 2)).max() for length in lengths) / SAMPLE_INTERVAL**2,
        repeats=len(files[0]),
        protocols="\n".join(
            line
            for protocol, program, names in zip(protocols, programs, files, strict=True)
            for line in _list_protocol_lines(device, protocol, program, names)
        ),
        moving_part=_name_moving_part(device),
        held="length and pressure" if has_supply else "length",
        notes=_describe_clamping(device, programs),
        checked="pressure" if device.spec.muscle else "force",
        rig_changes=MUSCLE_RIG_CHANGES if device.spec.muscle else PART_RIG_CHANGES,
    )
    absent = (*(() if has_supply else PRESSURE_LINES), *(() if device.spec.muscle else (MUSCLE_LENGTH_LINE,)))
    return "".join(line for line in readme.splitlines(keepends=True) if not line.startswith(absent))


def _name_moving_part(device: Device) -> str:
    return "muscle" if device.spec.muscle else "cylinder"


def _describe_length(device: Device) -> str:
    if device.spec.tendon is None:
        return f"of the {_name_moving_part(device)}, clamp to clamp"
    return "of the whole unit, muscle and tendon" if device.spec.muscle else "of the tendon, clamp to clamp"


def _describe_ranges(programs: Sequence[Program], *, has_supply: bool) -> str:
    lengths, pressures = (np.concatenate([program[k] for program in programs]) for k in (1, 2))
    statement = f"All lengths are between {1e3 * lengths.min():.1f} and {1e3 * lengths.max():.1f} mm"
    if not has_supply:
        return f"{statement}."
    return f"{statement}, all pressures between {1e-5 * pressures.min():.2f} and {1e-5 * pressures.max():.2f} bar."


def _find_top_speed(programs: Sequence[Program]) -> float:
    """Return the largest speed of the unit [m/s]."""
    return max(float(np.abs(np.diff(program.unit_length)).max()) for program in programs) / SAMPLE_INTERVAL


def _list_protocol_lines(
    device: Device, protocol: IdentificationProtocol, program: Program, files: Sequence[str]
) -> Iterator[str]:
    """Yield the lines about one protocol: its files, what it does, and which effects it reveals."""
    file_list = ", ".join(files) if len(files) <= 3 else f"{files[0]} to {files[-1]}"
    yield f"   {protocol.name}.csv ({program.time[-1]:.1f} s) -> {file_list}\n      {protocol.describe_for(device)}"
    revealed = protocol.list_revealed_effects(device)
    if revealed:
        sentence = f"Reveals: {', '.join(revealed)}."
        yield from textwrap.wrap(sentence, 115, initial_indent=" " * 6, subsequent_indent=" " * 6)


def _describe_clamping(device: Device, programs: Sequence[Program]) -> str:
    """Return what a device without a muscle or without a tendon asks of its clamps, and the force to expect."""
    spec, parameters = device.spec, device.parameters
    if spec.muscle:
        return "" if spec.tendon else BARE_MUSCLE_NOTE
    if spec.cylinder is None:
        stretch = max(program.unit_length.max() for program in programs) - parameters.tendon.slack_length
        return TENDON_NOTE.format(force=tendon_law.force(parameters.tendon, float(stretch)))
    speed = _find_top_speed(programs)
    force = max(abs(damper_law.force(parameters.damper, sign * speed)) for sign in (-1.0, 1.0))
    return CYLINDER_NOTE.format(force=DAMPER_FORCE_SENTENCE.format(force=force) if spec.damper else "")
