"""Export of a run or an imported reference to OpenSim: angles, moments, ground reactions, markers.

OpenSim frame: x forward, y up, z right. Flexion and dorsiflexion are positive (``knee_angle`` as in the models of
Rajagopal; older models such as gait2392 have the opposite sign). A generalised force has the sign of its coordinate, so
a plantarflexor moment is negative. The rig has no pelvis: ``pelvis_tilt`` is 0, and ``hip_flexion`` is the angle of the
thigh to the vertical.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.gait import reference, reference_folder
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.kinematics.leg import LEG_UNITS
from klute_sim.mocap.parsing.channel_names import PROSTHESIS_CHANNELS, Side
from klute_sim.mocap.reference_import import REFERENCE_COLUMNS
from klute_sim.recording import csv, parquet
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

RECORDING_FILE = "recording.parquet"
"""Name of the recording in a run folder."""
FOOT_MARKERS = {"HEEL": (-0.055, -0.06), "TOE": (0.145, -0.06)}
"""Virtual marker of the foot -> position forward of and above the ankle [m] (assumed, independent of body size)."""
HIP_LATERAL_OFFSET = 0.09
"""Lateral distance of the leg's plane from the body's midplane [m] (assumed)."""


def read_gait(folder: Path) -> Recording:
    """Return the recording in a ``folder`` of ``klute-sim gait``, or the mean stride in one of ``klute-sim import``.

    Raises InputError for other folders.
    """
    if (folder / RECORDING_FILE).is_file():
        recording = parquet.load_recording(folder / RECORDING_FILE)
        needed = ("thigh_angle", "knee_angle", "ankle_angle", "ankle_moment", "grf_vertical", "grf_forward")
        missing = [name for name in needed if name not in recording]
        if missing:
            raise InputError(f"{folder / RECORDING_FILE} is not a gait run: channel '{missing[0]}' is missing")
        return recording
    if (folder / reference_folder.METADATA_FILE).is_file():
        return _read_mean_stride(folder)
    raise InputError(
        f"{folder} contains neither {RECORDING_FILE} nor {reference_folder.METADATA_FILE}; pass a folder of "
        "klute-sim gait or import"
    )


def _read_mean_stride(folder: Path) -> Recording:
    stride = reference.load_reference(folder)
    mass = stride.mass or 1.0
    phase = np.linspace(0.0, 1.0, 101)
    columns: list[tuple[str, Array]] = [("time [s]", phase * stride.stride_time), ("gait_phase [%]", 100.0 * phase)]
    for column, name in REFERENCE_COLUMNS.items():
        factor = 1.0 if LEG_UNITS[name] == "deg" else mass
        columns.append((f"{name} [{LEG_UNITS[name]}]", stride(column, phase) * factor))
    columns.append(("thigh_angle [deg]", stride("shank_forward_deg", phase) - stride("knee_flexion_deg", phase)))
    return Recording.from_columns(columns, {"reference": stride.name, "sha256": stride.digest})


def to_joint_angles(recording: Recording, side: Side) -> Storage:
    """Return joint angles [deg] in the format of OpenSim's inverse kinematics."""
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
    """Return the joint moments [N.m] in the format of inverse dynamics.

    Those of hip and knee are the moments of the drives that guide the limb, which only runs of the gait rig have.
    """
    leg, moments = side[0], {"time": recording["time"]}
    if "hip_moment" in recording:
        moments |= {
            f"hip_flexion_{leg}_moment": -recording["hip_moment"],
            f"knee_angle_{leg}_moment": recording["knee_moment"],
        }
    moments[f"ankle_angle_{leg}_moment"] = -recording["ankle_moment"]
    return Storage(moments, in_degrees=False, name="Inverse Dynamics Generalized Forces")


def to_ground_reaction(recording: Recording, side: Side) -> Storage:
    """Return the force on the foot [N] and, if known, its point of application [m]; zero in swing."""
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
    """Return virtual markers on hip, knee, ankle, heel and toe [m]; raise InputError without recorded positions."""
    for name in ("carriage_x", "carriage_z", "ankle_x", "ankle_z"):
        if name not in recording:
            raise InputError(f"markers need the channel '{name}', which only runs of klute-sim gait have")
    thigh, shank = (np.radians(recording[name]) for name in ("thigh_angle", "shank_angle"))
    hip = np.stack([recording["carriage_x"], recording["carriage_z"]], axis=1)
    ankle = np.stack([recording["ankle_x"], recording["ankle_z"]], axis=1)
    # Least-squares lengths of thigh and shank that connect hip and ankle at the recorded inclinations. The load
    # shortens the shank by the displacement in the liner.
    thigh_axis, shank_axis = (np.stack([np.sin(a), np.cos(a)], axis=1) for a in (thigh, shank))
    system = np.stack([thigh_axis.ravel(), shank_axis.ravel()], axis=1)
    shortening = recording["liner_displacement"] if "liner_displacement" in recording else np.zeros(len(recording))
    lengths, *_ = np.linalg.lstsq(system, (hip - ankle + shortening[:, None] * shank_axis).ravel(), rcond=None)
    knee = hip - lengths[0] * thigh_axis
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
    """Return the channels that the prosthesis would log; raise InputError for a gait without a prosthesis."""
    for name in PROSTHESIS_CHANNELS:
        if name not in recording:
            raise InputError(f"a prosthesis log needs the channel '{name}', which only runs of klute-sim gait have")
    names = ("time", *PROSTHESIS_CHANNELS, "ankle_angle")
    return Recording({n: recording[n] for n in names}, {n: recording.units[n] for n in names}, recording.provenance)


def write_files(recording: Recording, side: Side, kinds: tuple[str, ...], folder: Path) -> list[str]:
    """Write ``recording`` into ``folder`` in all formats ``kinds``; return the file names."""
    for kind in kinds:
        for name, write in FILE_WRITERS[kind].items():
            write(recording, side, folder / name)
    return sorted(name for kind in kinds for name in FILE_WRITERS[kind])


FileWriter = Callable[[Recording, Side, Path], None]
"""Function that writes a recording of one side to a path."""
FILE_WRITERS: Mapping[str, Mapping[str, FileWriter]] = {
    "mot": {
        "angles.mot": lambda recording, side, path: storage.write(to_joint_angles(recording, side), path),
        "ground_reaction.mot": lambda recording, side, path: storage.write(to_ground_reaction(recording, side), path),
    },
    "sto": {"moments.sto": lambda recording, side, path: storage.write(to_joint_moments(recording, side), path)},
    "trc": {"markers.trc": lambda recording, side, path: trc.write(to_markers(recording, side), path)},
    "log": {"log.csv": lambda recording, side, path: csv.write(to_prosthesis_log(recording), path)},
    "csv": {"recording.csv": lambda recording, side, path: csv.write(recording, path)},
    "parquet": {RECORDING_FILE: lambda recording, side, path: parquet.write_recording(recording, path)},
}
"""Format -> file name -> function that writes the file."""
