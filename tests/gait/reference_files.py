"""Reference files of made subjects, written from the default reference."""

import csv
import io
from importlib import resources
from pathlib import Path

from klute_sim.gait.reference import DEVIATION_COLUMNS
from klute_sim.gait.reference_folder import CURVES_FILE, FORMAT, METADATA_FILE

LOAD_COLUMNS = ("ankle_plantarflexor_moment_nm_per_kg", "ankle_power_w_per_kg")


def write_reference(path: Path, *, load_ratio: float = 1.0, with_deviations: bool = True) -> Path:
    """Write the default reference with its ankle moment and power times ``load_ratio``."""
    text = (resources.files("klute_sim.gait") / "normative_gait.csv").read_text("utf-8")
    rows = list(csv.DictReader(io.StringIO(text)))
    names = [name for name in rows[0] if with_deviations or name not in DEVIATION_COLUMNS]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow(row | {name: repr(load_ratio * float(row[name])) for name in LOAD_COLUMNS})
    return path


def write_reference_folder(
    folder: Path, *, mass: float, stature: float, stride_time: float = 1.1, load_ratio: float = 1.0
) -> Path:
    """Write a folder as ``klute-sim import`` does, of a subject with ``mass`` [kg] and ``stature`` [m]."""
    folder.mkdir()
    write_reference(folder / CURVES_FILE, load_ratio=load_ratio, with_deviations=False)
    numbers = {"mass_kg": mass, "stature_m": stature, "stride_time_s": stride_time}
    lines = [f'format = "{FORMAT}"', *(f"{name} = {value!r}" for name, value in numbers.items())]
    (folder / METADATA_FILE).write_text("\n".join(lines) + "\n", "utf-8")
    return folder
