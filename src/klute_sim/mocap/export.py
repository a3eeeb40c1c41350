"""A run, or an imported reference, as OpenSim's files: angles, moments, ground reactions, markers.

OpenSim's frame: x forward, y up, z right. Rotations grow with flexion and dorsiflexion (``knee_angle`` as in models
of Rajagopal's kind; older ones, gait2392 among them, have it the other way); a generalised force has its coordinate's
sign, so that the plantarflexors' moment is negative. The rig has no pelvis: ``pelvis_tilt`` is 0, and ``hip_flexion``
is of the thigh against the vertical.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.gait import reference, reference_folder
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.parsing.channel_names import PROSTHESIS_CHANNELS, Side
from klute_sim.mocap.reference_import import REFERENCE_COLUMNS
from klute_sim.mocap.strides.leg import LEG_UNITS
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Array, Recording

RECORDING_FILE = "recording.parquet"
FOOT_MARKERS = {"HEEL": (-0.055, -0.06), "TOE": (0.145, -0.06)}
"""Virtual markers of the foot: forward of and above the ankle [m] (assumed), whatever the walker's size."""
HIP_LATERAL_OFFSET = 0.09
"""Of the hip from the middle [m] (assumed): all is in one plane."""


def read_gait(folder: Path) -> Recording:
    """The gait in the folder ``run``: of ``klute-sim gait``, or the mean stride of ``klute-sim import``.

    Raises InputError for a folder of neither.
    """
    if (folder / RECORDING_FILE).is_file():
        recording = parquet.read(folder / RECORDING_FILE)
        needed = ("thigh_angle", "knee_angle", "ankle_angle", "ankle_moment", "grf_vertical", "grf_forward")
        lacking = [name for name in needed if name not in recording]
        if lacking:
            raise InputError(f"{folder / RECORDING_FILE} is no gait: channel '{lacking[0]}' is missing")
        return recording
    if (folder / reference_folder.METADATA_FILE).is_file():
        return _read_mean_stride(folder)
    raise InputError(
        f"{folder} has neither {RECORDING_FILE} nor {reference_folder.METADATA_FILE}: name a folder of klute-sim gait or import"
    )


def _read_mean_stride(folder: Path) -> Recording:
    human = reference.load_reference(folder)
    mass = human.mass or 1.0
    phase = np.linspace(0.0, 1.0, 101)
    columns: list[tuple[str, Array]] = [("time [s]", phase * human.stride_time), ("gait_phase [%]", 100.0 * phase)]
    for column, name in REFERENCE_COLUMNS.items():
        columns.append(
            (f"{name} [{LEG_UNITS[name]}]", human(column, phase) * (1.0 if LEG_UNITS[name] == "deg" else mass))
        )
    columns.append(("thigh_angle [deg]", human("shank_forward_deg", phase) - human("knee_flexion_deg", phase)))
    return Recording.from_columns(columns, {"reference": human.name, "sha256": human.digest})


def to_joint_angles(recording: Recording, side: Side) -> Storage:
    """Joint angles [deg], as inverse kinematics would have them."""
    leg, count = side[0], len(recording)
    columns = {"time": recording["time"], "pelvis_tilt": np.zeros(count)}
    if "carriage_x" in recording:
        columns |= {"pelvis_tx": recording["carriage_x"], "pelvis_ty": recording["carriage_z"]}
    columns |= {
        f"hip_flexion_{leg}": -recording["thigh_angle"],
        f"knee_angle_{leg}": recording["knee_angle"],
        f"ankle_angle_{leg}": recording["ankle_angle"],
    }
    return Storage(columns, in_degrees=True, name="Coordinates")


def to_joint_moments(recording: Recording, side: Side) -> Storage:
    """The ankle's moment [N.m], as inverse dynamics would have it; of hip and knee the rig knows none."""
    moment = {"time": recording["time"], f"ankle_angle_{side[0]}_moment": -recording["ankle_moment"]}
    return Storage(moment, in_degrees=False, name="Inverse Dynamics Generalized Forces")


def to_ground_reaction(recording: Recording, side: Side) -> Storage:
    """Force [N] on the foot and, where it is known, its point [m] on the ground; zero in swing."""
    zero = np.zeros(len(recording))
    columns = {
        "time": recording["time"],
        "ground_force_vx": recording["grf_forward"],
        "ground_force_vy": recording["grf_vertical"],
        "ground_force_vz": zero,
    }
    if "cop_x" in recording:
        columns |= {
            "ground_force_px": np.nan_to_num(recording["cop_x"]),
            "ground_force_py": zero,
            "ground_force_pz": zero,
        }
        columns |= {f"ground_torque_{axis}": zero for axis in "xyz"}
    return Storage(columns, in_degrees=False, name=f"ground reaction, {side} foot")


def to_markers(recording: Recording, side: Side) -> Markers:
    """Virtual markers on hip, knee, ankle, heel and toe [m]; raises InputError where positions are not recorded."""
    for name in ("carriage_x", "carriage_z", "ankle_x", "ankle_z"):
        if name not in recording:
            raise InputError(f"markers need the channel '{name}': only runs of klute-sim gait have positions")
    thigh, shank = (np.radians(recording[name]) for name in ("thigh_angle", "shank_angle"))
    hip = np.stack([recording["carriage_x"], recording["carriage_z"]], axis=1)
    ankle = np.stack([recording["ankle_x"], recording["ankle_z"]], axis=1)
    # The two lengths that carry the hip to the ankle at the recorded inclinations, in every sample alike.
    upper, lower = (np.stack([np.sin(a), np.cos(a)], axis=1) for a in (thigh, shank))
    system = np.stack([upper.ravel(), lower.ravel()], axis=1)
    lengths, *_ = np.linalg.lstsq(system, (hip - ankle).ravel(), rcond=None)
    knee = hip - lengths[0] * upper
    pitch = shank - np.radians(recording["ankle_angle"])
    along, above = (
        np.stack(pair, axis=1) for pair in ((np.cos(pitch), -np.sin(pitch)), (np.sin(pitch), np.cos(pitch)))
    )
    points = {"HIP": hip, "KNEE": knee, "ANKLE": ankle}
    points |= {name: ankle + ahead * along + up * above for name, (ahead, up) in FOOT_MARKERS.items()}
    lateral = HIP_LATERAL_OFFSET if side == "right" else -HIP_LATERAL_OFFSET
    return Markers(recording["time"], {f"{side[0].upper()} {name}": _to_3d(p, lateral) for name, p in points.items()})


def _to_3d(point: Array, lateral: float) -> Array:
    return np.stack([*point.T, np.full(len(point), lateral)], axis=1)


def to_prosthesis_log(recording: Recording) -> Recording:
    """What the prosthesis itself would have logged; raises InputError for a stride that nobody made with one."""
    for name in PROSTHESIS_CHANNELS:
        if name not in recording:
            raise InputError(f"a prosthesis' log needs the channel '{name}': only runs of klute-sim gait have it")
    kept = ("time", *PROSTHESIS_CHANNELS, "ankle_angle")
    return Recording({n: recording[n] for n in kept}, {n: recording.units[n] for n in kept}, recording.provenance)


def write_files(recording: Recording, side: Side, kinds: tuple[str, ...], folder: Path) -> list[str]:
    """Write ``recording`` into ``folder`` in all ``kinds``; the names of the files."""
    for kind in kinds:
        for name, make in FILE_WRITERS[kind].items():
            make(recording, side, folder / name)
    return sorted(name for kind in kinds for name in FILE_WRITERS[kind])


FileWriter = Callable[[Recording, Side, Path], None]
FILE_WRITERS: Mapping[str, Mapping[str, FileWriter]] = {
    "mot": {
        "angles.mot": lambda recording, side, path: storage.write(to_joint_angles(recording, side), path),
        "ground_reaction.mot": lambda recording, side, path: storage.write(to_ground_reaction(recording, side), path),
    },
    "sto": {"moments.sto": lambda recording, side, path: storage.write(to_joint_moments(recording, side), path)},
    "trc": {"markers.trc": lambda recording, side, path: trc.write(to_markers(recording, side), path)},
    "log": {"log.csv": lambda recording, side, path: csv.write(to_prosthesis_log(recording), path)},
    "csv": {"recording.csv": lambda recording, side, path: csv.write(recording, path)},
    "parquet": {RECORDING_FILE: lambda recording, side, path: parquet.write(recording, path)},
}
"""Kind -> name of a file -> what writes it."""
