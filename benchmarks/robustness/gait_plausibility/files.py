"""References, datasets and motion files of a made walker, with changes before they are written."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.robustness.gait_plausibility.walker import ANKLE, HIP, KNEE, SHANK, SIDES, Walker

from klute_sim.datasets.dataset import load_dataset
from klute_sim.errors import InputError
from klute_sim.gait.reference import load_reference
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.reference_import import import_reference
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.types import Array

Columns = dict[str, Array]
"""Heading or marker -> samples."""
Edit = Callable[[Columns], Columns]
"""Function that returns changed columns."""


def keep(columns: Columns) -> Columns:
    """Return ``columns``."""
    return columns


@dataclass(frozen=True)
class Variant:
    """A file or a set of files, wrong in a known way or right."""

    kind: str
    """``reference``, ``dataset``, ``opensim``, ``trc``, ``table`` or ``c3d``."""
    name: str
    """What was changed."""
    expected: tuple[str, ...] = ()
    """Names of findings of which one must be reported; empty: the files are right."""
    edit: Edit = keep
    """Change of the columns: of the reference, of the trial, of all OpenSim files together, or of the markers."""
    walker: Walker = field(default_factory=Walker)
    """Walker of the files."""
    mass: float | None = None
    """Body mass that the user of an import states [kg]; None: none."""
    stature: float | None = None
    """Stature that the user of an import states [m]; None: none."""
    load_edit: Edit = keep
    """Change of the ground reaction beside markers."""
    unit: str = ""
    """Unit in the header of a marker file; empty: the right one."""


def find_names(variant: Variant, folder: Path) -> tuple[list[str], str]:
    """Write and read the files of ``variant``; return the names of the findings and the message.

    Any other error is named ``error``.
    """
    folder.mkdir(parents=True)
    try:
        _READERS[variant.kind](variant, folder)
    except ImplausibleInputError as error:
        return [finding.name for finding in error.findings], str(error)
    except InputError as error:
        return ["error"], str(error)
    return [], ""


def write_table(columns: Columns, path: Path) -> Path:
    """Write ``columns`` as CSV; NaN becomes an empty cell."""
    rows = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(",".join("" if np.isnan(value) else f"{value:.9g}" for value in row))
    path.write_text("\n".join(rows) + "\n", "utf-8")
    return path


def _read_reference(variant: Variant, folder: Path) -> None:
    phase = np.linspace(0.0, 100.0, 51)
    columns = variant.edit({"gait_pct": phase, **variant.walker.compute_curves(phase / 100.0)})
    load_reference(write_table(columns, folder / "reference.csv"), min(max(variant.walker.stride_time, 0.5), 3.0))


def make_trial(walker: Walker) -> Columns:
    """Return the columns of a gait trial of a dataset."""
    leg, time = walker.compute_leg("right"), walker.time
    return {
        "time [s]": time,
        "shank_angle [deg]": leg[SHANK],
        "ankle_x [m]": leg["ANKLE"][:, 0],
        "ankle_z [m]": leg["ANKLE"][:, 1],
        "grf_vertical [N]": leg["vertical"],
        "grf_forward [N]": leg["forward"],
        "cop_x [m]": np.where(leg["vertical"] > 19.0, leg["cop"], np.nan),
        "pressure_command [bar]": 2.5 + 1.5 * np.sin(2.0 * np.pi * time / walker.stride_time),
        "ankle_angle [deg]": leg[ANKLE],
    }


def _read_dataset(variant: Variant, folder: Path) -> None:
    columns = variant.edit(make_trial(variant.walker))
    (folder / "dataset.toml").write_text(
        'format = "klute-sim-dataset/2"\nrig = "gait"\ndevice = "klute-1-1-4-pair"\n[[trial]]\nfiles = ["walk.csv"]\n',
        "utf-8",
    )
    write_table(columns, folder / "walk.csv")
    load_dataset(folder)


def make_opensim(walker: Walker) -> Columns:
    """Return angles [deg], ground reaction and moments with OpenSim's names; ``id:`` precedes the moments."""
    columns: Columns = {"time": walker.time, "pelvis_tilt": np.full(len(walker.time), -4.0)}
    columns["pelvis_tx"] = walker.speed * walker.time
    for number, side in enumerate(SIDES, 1):
        leg, letter = walker.compute_leg(side), side[0]
        columns |= {
            f"hip_flexion_{letter}": leg[HIP],
            f"knee_angle_{letter}": leg[KNEE],
            f"ankle_angle_{letter}": leg[ANKLE],
            **_name_loads(number, leg),
            f"id:ankle_angle_{letter}_moment": -leg["moment"],
        }
    return columns


def _name_loads(number: int, leg: Columns) -> Columns:
    zero = np.zeros(len(leg["vertical"]))
    return {
        f"ground_force_{number}_vx": leg["forward"],
        f"ground_force_{number}_vy": leg["vertical"],
        f"ground_force_{number}_vz": zero,
        f"ground_force_{number}_px": leg["cop"],
        f"ground_force_{number}_py": zero,
        f"ground_force_{number}_pz": zero,
    }


def _read_opensim(variant: Variant, folder: Path) -> None:
    columns = variant.edit(make_opensim(variant.walker))
    time = {"time": columns["time"]}
    forces = {name: values for name, values in columns.items() if name.startswith("ground_force")}
    moments = {name.removeprefix("id:"): values for name, values in columns.items() if name.startswith("id:")}
    angles = {name: v for name, v in columns.items() if name not in forces and not name.startswith(("id:", "time"))}
    paths = [folder / "ik.mot", folder / "grf.mot", folder / "id.sto"]
    for path, content in zip(paths, (angles, forces, moments), strict=True):
        storage.write(storage.Storage({**time, **content}, path.name == "ik.mot"), path)
    _import(paths, variant)


def _import(paths: Sequence[Path], variant: Variant) -> None:
    import_reference(paths, ImportOptions(mass=variant.mass, stature=variant.stature))


def make_markers(walker: Walker) -> Columns:
    """Return markers (n, 3) in a laboratory whose x, y, z are forward, up, right [m]; and ``time``."""
    columns: Columns = {"time": walker.time}
    for side, lateral in zip(SIDES, (0.1, -0.1), strict=True):
        leg = walker.compute_leg(side)
        for name in ("HIP", "KNEE", "ANKLE", "HEEL", "TOE"):
            columns[f"{side[0].upper()}_{name}"] = np.column_stack([leg[name], np.full(len(walker.time), lateral)])
    return columns


def make_loads(walker: Walker) -> Columns:
    """Return the ground reaction of both feet with OpenSim's names."""
    columns: Columns = {"time": walker.time}
    for number, side in enumerate(SIDES, 1):
        columns |= _name_loads(number, walker.compute_leg(side))
    return columns


def _read_trc(variant: Variant, folder: Path) -> None:
    markers, loads = variant.edit(make_markers(variant.walker)), variant.load_edit(make_loads(variant.walker))
    time = markers.pop("time")
    trc.write(trc.Markers(time, markers), folder / "walk.trc")
    text = (folder / "walk.trc").read_text("utf-8").splitlines()
    fields = text[2].split("\t")
    fields[4] = variant.unit or "m"
    (folder / "walk.trc").write_text("\n".join([*text[:2], "\t".join(fields), *text[3:]]) + "\n", "utf-8")
    storage.write(storage.Storage(loads, False), folder / "grf.mot")
    _import([folder / "walk.trc", folder / "grf.mot"], variant)


def make_table(walker: Walker) -> Columns:
    """Return one table of a treadmill laboratory in our names with units."""
    columns: Columns = {"time [s]": walker.time}
    for side in SIDES:
        leg, title = walker.compute_leg(side), side.capitalize()
        columns |= {
            f"{title}HipFlexionAngle [deg]": leg[HIP],
            f"{title}KneeFlexionAngle [deg]": leg[KNEE],
            f"{title}AnkleDorsiflexionAngle [deg]": leg[ANKLE],
            f"{title}ShankAngle [deg]": leg[SHANK],
            f"{title}AnkleMoment [N*m]": leg["moment"],
            f"{title}GRF_vertical [N]": leg["vertical"],
            f"{title}GRF_forward [N]": leg["forward"],
        }
    return columns


def _read_table(variant: Variant, folder: Path) -> None:
    _import([write_table(variant.edit(make_table(variant.walker)), folder / "walk.csv")], variant)


def _read_c3d(variant: Variant, folder: Path) -> None:
    import ezc3d

    markers, loads = variant.edit(make_markers(variant.walker)), variant.load_edit(make_loads(variant.walker))
    markers.pop("time")
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # laboratory's x, y, z of forward, up, right
    points = np.ones((4, len(markers), len(variant.walker.time)))
    points[:3] = 1e3 * np.stack([(position @ turn.T).T for position in markers.values()], axis=1)
    channels = []
    for number in (1, 2):
        ahead, up = loads[f"ground_force_{number}_vx"], loads[f"ground_force_{number}_vy"]
        centre = 1e3 * loads[f"ground_force_{number}_px"]
        zero = np.zeros_like(up)
        channels += [zero, ahead, up, (centre - 3000.0) * up, zero, zero]
    file = ezc3d.c3d()
    file["data"]["points"], file["data"]["analogs"] = points, np.stack(channels)[None]
    point, analog = file["parameters"]["POINT"], file["parameters"]["ANALOG"]
    point["LABELS"]["value"], point["UNITS"]["value"] = list(markers), [variant.unit or "mm"]
    point["RATE"]["value"], analog["RATE"]["value"] = [variant.walker.rate], [variant.walker.rate]
    analog["LABELS"]["value"] = [f"{name}{plate}" for plate in "12" for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
    analog["UNITS"]["value"] = 2 * ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    plates = file["parameters"]["FORCE_PLATFORM"]
    plates["USED"]["value"], plates["TYPE"]["value"] = [2], [2, 2]
    corners = np.array([[[x + 90, 6000, 0], [x - 90, 6000, 0], [x - 90, 0, 0], [x + 90, 0, 0]] for x in (100, -100)])
    plates["CORNERS"]["value"] = corners.transpose(2, 1, 0).astype(float)
    plates["ORIGIN"]["value"] = np.zeros((3, 2))
    plates["CHANNEL"]["value"] = np.arange(1, 13).reshape(2, 6).T
    file.write(str(folder / "walk.c3d"))
    _import([folder / "walk.c3d"], variant)


_READERS: dict[str, Callable[[Variant, Path], None]] = {
    "reference": _read_reference,
    "dataset": _read_dataset,
    "opensim": _read_opensim,
    "trc": _read_trc,
    "table": _read_table,
    "c3d": _read_c3d,
}
