"""A made walker whose every file is known: the package's own reference, both legs, in a laboratory's formats."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.gait import reference
from klute_sim.mocap.formats import storage, trc
from klute_sim.types import Array

HUMAN = reference.load_default_reference()
MASS = 70.0
PERIOD = 1.1
THIGH, SHANK = 0.43, 0.43
HEEL, TOE = (-0.05, -0.07), (0.15, -0.07)
"""Of the foot, forward of and above the ankle [m]; level, so that the flat foot has no pitch."""
SPEED = 1.2
LATER = {"right": 0.1, "left": 0.1 + PERIOD / 2}
"""First heel strikes [s]."""


@dataclass
class Walker:
    """Everything at ``time``."""

    seconds: float = 4.5
    rate: float = 100.0

    def __post_init__(self) -> None:
        self.time = np.arange(round(self.seconds * self.rate) + 1) / self.rate

    def phase(self, side: str) -> Array:
        return np.asarray(((self.time - LATER[side]) / PERIOD) % 1.0)

    def of(self, column: str, side: str) -> Array:
        """A column of the reference; loads in N, moments in N.m."""
        values = HUMAN(column, self.phase(side))
        if column.startswith("grf"):
            values = np.where(self.loaded(side), values, 0.0)
        return values * (MASS if "_per_kg" in column else 1.0)

    def loaded(self, side: str) -> Array:
        return np.asarray(HUMAN("grf_vertical_n_per_kg", self.phase(side)) > 0.3)

    def points(self, side: str) -> dict[str, Array]:
        """Joint and foot, (n, 2): forward and up [m]."""
        shank = np.radians(self.of("shank_forward_deg", side))
        thigh = shank - np.radians(self.of("knee_flexion_deg", side))
        pitch = shank - np.radians(self.of("ankle_dorsiflexion_deg", side))
        hip = np.stack([SPEED * self.time, np.full(len(self.time), 0.93)], axis=1)
        knee = hip - THIGH * np.stack([np.sin(thigh), np.cos(thigh)], axis=1)
        ankle = knee - SHANK * np.stack([np.sin(shank), np.cos(shank)], axis=1)
        found = {"HIP": hip, "KNEE": knee, "ANKLE": ankle}
        for name, (ahead, up) in (("HEEL", HEEL), ("TOE", TOE)):
            along = np.stack([np.cos(pitch), -np.sin(pitch)], axis=1)
            found[name] = ankle + ahead * along + up * np.stack([np.sin(pitch), np.cos(pitch)], axis=1)
        return found

    def pressure_centre(self, side: str) -> Array:
        """Where the ground reaction has the reference's moment about the ankle, at height 0 [m]."""
        ankle = self.points(side)["ANKLE"]
        up, along = self.of("grf_vertical_n_per_kg", side), self.of("grf_forward_n_per_kg", side)
        moment = self.of("ankle_plantarflexor_moment_nm_per_kg", side)
        # moment = (x - xa) up - (0 - za) along
        ahead = np.divide(moment - ankle[:, 1] * along, up, out=np.zeros_like(up), where=up > 1.0)
        return np.asarray(np.where(up > 1.0, ankle[:, 0] + ahead, 0.0))


def opensim(folder: Path, walker: Walker, knee_sign: float = 1.0, tilt: float = 4.03) -> list[Path]:
    """Angles, ground reaction and moments in OpenSim's names; ``tilt`` closes the gap of the reference's pelvis."""
    angles = {"time": walker.time, "pelvis_tilt": np.full(len(walker.time), -tilt), "pelvis_tx": SPEED * walker.time}
    forces, moments = {"time": walker.time}, {"time": walker.time}
    for number, side in enumerate(("right", "left"), 1):
        leg = side[0]
        hip = walker.of("knee_flexion_deg", side) - walker.of("shank_forward_deg", side) + tilt
        angles |= {
            f"hip_flexion_{leg}": hip,
            f"knee_angle_{leg}": knee_sign * walker.of("knee_flexion_deg", side),
            f"ankle_angle_{leg}": walker.of("ankle_dorsiflexion_deg", side),
        }
        zero = np.zeros(len(walker.time))
        forces |= {
            f"ground_force_{number}_vx": walker.of("grf_forward_n_per_kg", side),
            f"ground_force_{number}_vy": walker.of("grf_vertical_n_per_kg", side),
            f"ground_force_{number}_vz": zero,
            f"ground_force_{number}_px": walker.pressure_centre(side),
            f"ground_force_{number}_py": zero,
            f"ground_force_{number}_pz": zero,
        }
        moments[f"ankle_angle_{leg}_moment"] = -walker.of("ankle_plantarflexor_moment_nm_per_kg", side)
    paths = [folder / "ik.mot", folder / "grf.mot", folder / "id.sto"]
    for path, columns, degrees in zip(paths, (angles, forces, moments), (True, False, False), strict=True):
        storage.write(storage.Storage(columns, degrees), path)
    return paths


def markers(walker: Walker, turn: Array | None = None) -> trc.Markers:
    """Markers on the joints, in a laboratory whose x, y, z are forward, up, right, or ``turn`` ed."""
    positions = {}
    for side, lateral in (("right", 0.1), ("left", -0.1)):
        for name, point in walker.points(side).items():
            place = np.stack([*point.T, np.full(len(point), lateral)], axis=1)
            positions[f"{side[0].upper()}_{name}"] = place if turn is None else place @ turn.T
    return trc.Markers(walker.time, positions)


def treadmill(folder: Path, walker: Walker) -> Path:
    """One table in the manner of D-Flow: radians, plantarflexion positive with -pi/2 in standing, belt that starts."""
    names = ["time", "LeftBeltSpeed", "RightBeltSpeed"]
    ramp = np.clip(walker.time / 1.5, 0.0, 1.0)
    columns = [walker.time, SPEED * ramp, SPEED * ramp]
    for side in ("left", "right"):
        title = side.capitalize()
        names += [f"{title}AnklePlantarFlexionMoment", f"{title}AnklePlantarFlexionAngle"]
        names += [f"{title}KneeFlexionAngle", f"{title}HipFlexionAngle"]
        columns += [
            walker.of("ankle_plantarflexor_moment_nm_per_kg", side),
            -np.pi / 2 - np.radians(walker.of("ankle_dorsiflexion_deg", side)),
            np.radians(walker.of("knee_flexion_deg", side)),
            np.radians(walker.of("hip_flexion_deg", side)),
        ]
        names += [f"{title}GRF_x", f"{title}GRF_y", f"{title}GRF_z", f"{title}COP_x"]
        columns += [
            walker.of("grf_forward_n_per_kg", side),
            walker.of("grf_vertical_n_per_kg", side),
            0.02 * walker.of("grf_vertical_n_per_kg", side),
            np.sin(walker.time),
        ]
    path = folder / "treadmill.csv"
    rows = [",".join(names), *(",".join(repr(float(v)) for v in row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(rows) + "\n")
    return path


def c3d(folder: Path, walker: Walker, moment_unit: str = "Nmm", readings: tuple[float, ...] = 6 * (0.0,)) -> Path:
    """Markers in millimetres, z up and y forward, and two force plates of type 2, one for each foot; needs ezc3d.

    ``readings`` are those of the channels of an unloaded plate [N, N.mm].
    """
    import ezc3d

    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # laboratory's x, y, z of forward, up, right
    placed = markers(walker, turn).positions
    points = np.ones((4, len(placed), len(walker.time)))
    points[:3] = 1e3 * np.stack([place.T for place in placed.values()], axis=1)
    channels = []
    for side in ("right", "left"):
        ahead, up = walker.of("grf_forward_n_per_kg", side), walker.of("grf_vertical_n_per_kg", side)
        centre = 1e3 * walker.pressure_centre(side)
        # About the plate's middle, which is at y = 3000 mm, of forces on its surface: Mx = y Fz, My = -x Fz.
        channels += [np.zeros_like(up), ahead, up, (centre - 3000.0) * up, 0.0 * up, 0.0 * up]
    file = ezc3d.c3d()
    file["data"]["points"] = points
    loads = np.stack(channels) + np.tile(readings, 2)[:, None]
    if moment_unit == "Nm":
        loads[[3, 4, 5, 9, 10, 11]] /= 1e3
    file["data"]["analogs"] = loads[None]
    point, analog = file["parameters"]["POINT"], file["parameters"]["ANALOG"]
    point["LABELS"]["value"], point["UNITS"]["value"] = list(placed), ["mm"]
    point["RATE"]["value"], analog["RATE"]["value"] = [walker.rate], [walker.rate]
    analog["LABELS"]["value"] = [f"{name}{plate}" for plate in "12" for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
    analog["UNITS"]["value"] = 2 * ["N", "N", "N", moment_unit, moment_unit, moment_unit]
    plates = file["parameters"]["FORCE_PLATFORM"]
    plates["USED"]["value"], plates["TYPE"]["value"] = [2], [2, 2]
    corners = np.array([[[x + 90, 6000, 0], [x - 90, 6000, 0], [x - 90, 0, 0], [x + 90, 0, 0]] for x in (100, -100)])
    plates["CORNERS"]["value"] = corners.transpose(2, 1, 0).astype(float)
    plates["ORIGIN"]["value"] = np.zeros((3, 2))
    plates["CHANNEL"]["value"] = np.arange(1, 13).reshape(2, 6).T
    path = folder / "walk.c3d"
    file.write(str(path))
    return path
