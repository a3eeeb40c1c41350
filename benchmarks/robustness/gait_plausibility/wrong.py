"""Gait files that are wrong in a known way, with the names of the findings of which one must be reported."""

from collections.abc import Callable

import numpy as np
from benchmarks.robustness.gait_plausibility.files import Columns, Edit, Variant
from benchmarks.robustness.gait_plausibility.walker import (
    ANKLE,
    FORWARD,
    HIP,
    KNEE,
    MOMENT,
    POWER,
    SHANK,
    UNUSUAL_WALKERS,
    VERTICAL,
    Walker,
)

from klute_sim.types import Array

GRAVITY = 9.80665
POUND_FORCE = 4.4482216
INCH = 0.0254
ANGLE_EDITS: dict[str, tuple[Callable[[Array], Array], tuple[str, ...]]] = {
    "radians": (np.radians, ("unit",)),
    "converted to degrees twice": (np.degrees, ("unit",)),
    "opposite sign": (lambda x: -x, ("sign", "zero")),
    "from the horizontal, 90 - angle": (lambda x: 90.0 - x, ("zero", "sign")),
    "from the horizontal, 90 + angle": (lambda x: 90.0 + x, ("zero",)),
    "included angle, 180 - angle": (lambda x: 180.0 - x, ("zero",)),
    "wrapped at 360": (lambda x: x % 360.0, ("wrapped",)),
    "wrapped at 180": (lambda x: x % 180.0, ("wrapped",)),
}
"""Mistake -> its effect on an angle, and the kinds of finding that name it."""


SHORT_WALK = Walker(seconds=3.4)
"""Walker whose times in milliseconds are below the largest duration of a recording, which is refused before."""


def on(part: str, change: Callable[[Array], Array]) -> Edit:
    """Return an edit that applies ``change`` to every column whose name contains ``part``."""
    return lambda columns: {name: change(v) if part in name else v for name, v in columns.items()}


def times(part: str, factor: float) -> Edit:
    """Return an edit that multiplies every column whose name contains ``part``."""
    return on(part, lambda values: factor * values)


def both(*edits: Edit) -> Edit:
    """Return the ``edits`` one after the other."""

    def edit(columns: Columns) -> Columns:
        for one in edits:
            columns = one(columns)
        return columns

    return edit


def exchange(first: str, second: str) -> Edit:
    """Return an edit that exchanges two columns; unknown samples become 0."""
    return lambda columns: {
        **columns,
        first: np.nan_to_num(columns[second]),
        second: np.nan_to_num(columns[first]),
    }


def reverse(columns: Columns) -> Columns:
    """Return all columns but time and phase in reverse order."""
    return {n: v if n.startswith(("time", "gait_pct")) else v[::-1] for n, v in columns.items()}


def put_code(part: str, code: float, first: int = 20, count: int = 4) -> Edit:
    """Return an edit that writes ``code`` in ``count`` rows from row ``first``."""

    def change(values: Array) -> Array:
        values = values.copy()
        values[first : first + count] = code
        return values

    return on(part, change)


def _list_references() -> list[Variant]:
    variants = []
    for column in (HIP, KNEE, ANKLE, SHANK):
        for mistake, (change, kinds) in ANGLE_EDITS.items():
            if column == KNEE and "wrapped" in mistake:
                continue  # a knee that does not extend beyond 0 does not wrap
            names = tuple(f"{column}-{kind}" for kind in kinds)
            variants.append(Variant("reference", f"{column}: {mistake}", names, on(column, change)))
    for column in (MOMENT, POWER, VERTICAL, FORWARD):
        name = f"{column}-sign"
        variants.append(Variant("reference", f"{column}: opposite sign", (name,), times(column, -1.0)))
    mass = Walker.mass
    force_units = {
        "BW": 1.0 / GRAVITY,
        "%BW": 100.0 / GRAVITY,
        "N": mass,
        "kN": mass / 1e3,
        "lbf": mass / POUND_FORCE,
        "kgf": mass / GRAVITY,
    }
    for unit, factor in force_units.items():
        edit = times("grf_", factor)
        variants.append(Variant("reference", f"ground reaction in {unit}", (f"{VERTICAL}-unit",), edit))
    for unit, factor in {"N·m": mass, "N·mm/kg": 1e3, "%BW·h": 100.0 / GRAVITY / Walker.stature}.items():
        variants.append(Variant("reference", f"moment in {unit}", (f"{MOMENT}-unit",), times(MOMENT, factor)))
    variants.append(Variant("reference", "power in W", (f"{POWER}-unit",), times(POWER, mass)))
    for first, second in (
        (HIP, KNEE),
        (SHANK, KNEE),
        (ANKLE, SHANK),
        (VERTICAL, FORWARD),
        (MOMENT, POWER),
        (HIP, SHANK),
    ):
        names = (f"{first}-exchanged", f"{second}-exchanged")
        variants.append(Variant("reference", f"{first} and {second} exchanged", names, exchange(first, second)))

    def at(phase: Callable[[Array], Array]) -> Edit:
        return lambda c: {"gait_pct": c["gait_pct"], **Walker().compute_curves(phase(c["gait_pct"] / 100.0))}

    def other_leg(columns: Columns) -> Columns:
        other = Walker().compute_curves(columns["gait_pct"] / 100.0 + 0.5)
        return {**columns, **{name: other[name] for name in (HIP, KNEE, ANKLE, SHANK)}}

    def late_angles(delay: float) -> Edit:
        def edit(columns: Columns) -> Columns:
            late = Walker().compute_curves(columns["gait_pct"] / 100.0 - delay)
            return {**columns, **{name: late[name] for name in (HIP, KNEE, ANKLE, SHANK)}}

        return edit

    variants += [
        Variant("reference", "angles 20 % late", ("time-offset",), late_angles(0.2)),
        Variant("reference", "angles 25 % early", ("time-offset",), late_angles(-0.25)),
        Variant("reference", "time reversed", ("time-reversed",), reverse),
        Variant("reference", "begins in mid-stance", ("stride-start",), at(lambda p: p + 0.3)),
        Variant("reference", "begins at toe-off", ("stride-start",), at(lambda p: p + 0.63)),
        Variant("reference", "only the stance", ("stride-length",), at(lambda p: 0.63 * p)),
        Variant("reference", "two strides", ("stride-length",), at(lambda p: 2.0 * p)),
        Variant("reference", "angles of the other leg", ("side-exchanged",), other_leg),
        Variant("reference", "-999 for missing", (f"{KNEE}-missing",), put_code(KNEE, -999.0)),
        Variant("reference", "9999 for missing", (f"{ANKLE}-missing",), put_code(ANKLE, 9999.0, 30, 2)),
    ]
    for gait in ("slow amputee", "runner", "child"):
        walker = UNUSUAL_WALKERS[gait]
        variants += [
            Variant("reference", f"{gait}, shank in radians", (f"{SHANK}-unit",), on(SHANK, np.radians), walker),
            Variant("reference", f"{gait}, opposite shank", (f"{SHANK}-sign",), times(SHANK, -1.0), walker),
            Variant("reference", f"{gait}, BW", (f"{VERTICAL}-unit",), times("grf_", 1.0 / GRAVITY), walker),
        ]
    return variants


def _list_datasets() -> list[Variant]:
    variants = []
    for channel in ("shank_angle", "ankle_angle"):
        for mistake, (change, kinds) in ANGLE_EDITS.items():
            names = tuple(f"{channel}-{kind}" for kind in kinds)
            variants.append(Variant("dataset", f"{channel}: {mistake}", names, on(channel, change)))
    lengths = {"mm": 1e3, "cm": 1e2, "in": 1.0 / INCH}
    for channel in ("ankle_x", "ankle_z", "cop_x"):
        for unit, factor in lengths.items():
            edit = times(channel, factor)
            variants.append(Variant("dataset", f"{channel} in {unit}", (f"{channel}-unit",), edit))
        names = (f"{channel}-sign",)
        variants.append(Variant("dataset", f"{channel}: opposite sign", names, times(channel, -1.0)))
    weight = Walker.mass * GRAVITY
    forces = {"lbf": 1 / POUND_FORCE, "%BW": 100 / weight, "BW": 1 / weight, "kN": 1e-3, "kgf": 1 / GRAVITY}
    for unit, factor in {**forces, "N/kg": 1.0 / Walker.mass}.items():
        variants.append(Variant("dataset", f"ground reaction in {unit}", ("grf_vertical-unit",), times("grf", factor)))
    for unit, factor in {"ms": 1e3, "min": 1.0 / 60.0, "frames": 100.0, "hours": 1.0 / 3600.0}.items():
        variants.append(Variant("dataset", f"time in {unit}", ("time-unit",), times("time", factor), SHORT_WALK))

    def add(part: str, offset: float) -> Edit:
        return on(part, lambda values: values + offset)

    def other_foot(columns: Columns) -> Columns:
        left = Walker().compute_leg("left")
        return {
            **columns,
            "grf_vertical [N]": left["vertical"],
            "grf_forward [N]": left["forward"],
            "cop_x [m]": np.where(left["vertical"] > 19.0, left["cop"], np.nan),
        }

    sideways = on("ankle_x", lambda x: 0.1 + 0.02 * np.sin(np.arange(len(x)) / 17.0))
    forward = both(times("shank", -1.0), times("ankle_x", -1.0), times("cop_x", -1.0), times("grf_forward", -1.0))
    variants += [
        Variant(
            "dataset",
            "all positions in mm",
            ("ankle_x-unit",),
            both(times("ankle_x", 1e3), times("ankle_z", 1e3), times("cop", 1e3)),
        ),
        Variant("dataset", "vertical reaction down", ("grf_vertical-sign",), times("grf_vertical", -1.0)),
        Variant("dataset", "fore-aft reaction reversed", ("grf_forward-sign",), times("grf_forward", -1.0)),
        Variant("dataset", "forward axis reversed", ("forward-sign",), forward),
        Variant("dataset", "time reversed", ("time-reversed",), reverse),
        Variant(
            "dataset", "x and z of the ankle exchanged", ("ankle_x-exchanged",), exchange("ankle_x [m]", "ankle_z [m]")
        ),
        Variant("dataset", "sideways axis for x", ("ankle_x-axis",), sideways),
        Variant(
            "dataset",
            "reactions exchanged",
            ("grf_vertical-exchanged",),
            exchange("grf_vertical [N]", "grf_forward [N]"),
        ),
        Variant(
            "dataset",
            "shank and ankle exchanged",
            ("shank_angle-exchanged",),
            exchange("shank_angle [deg]", "ankle_angle [deg]"),
        ),
        Variant("dataset", "centre of pressure 1.7 m off", ("cop_x-origin",), add("cop_x", 1.7)),
        Variant("dataset", "height of a platform", ("ankle_z-zero",), add("ankle_z", 0.9)),
        Variant("dataset", "load of the other foot", ("side-exchanged",), other_foot),
        Variant("dataset", "-9999 for missing", ("ankle_x-missing",), put_code("ankle_x", -9999.0, 100)),
        Variant("dataset", "1e30 for missing", ("shank_angle-missing",), put_code("shank", 1e30, 100)),
        Variant("dataset", "0 for missing", ("ankle_z-missing",), put_code("ankle_z", 0.0, 100)),
    ]
    for gait in ("slow amputee", "treadmill", "child", "fast"):
        walker = UNUSUAL_WALKERS[gait]
        variants += [
            Variant("dataset", f"{gait}, ankle_x in mm", ("ankle_x-unit",), times("ankle_x", 1e3), walker),
            Variant("dataset", f"{gait}, shank in radians", ("shank_angle-unit",), on("shank", np.radians), walker),
            Variant("dataset", f"{gait}, opposite shank", ("shank_angle-sign",), times("shank", -1.0), walker),
        ]
    return variants


def _list_motion_files() -> list[Variant]:
    leg, table_moment = "id:ankle_angle", "AnkleMoment"

    def swap(first: str, second: str, start: int = 0, stop: int | None = None) -> Edit:
        def edit(columns: Columns) -> Columns:
            a, b = columns[first].copy(), columns[second].copy()
            a[start:stop], b[start:stop] = columns[second][start:stop], columns[first][start:stop]
            return {**columns, first: a, second: b}

        return edit

    sides = both(*(swap(f"R_{name}", f"L_{name}") for name in ("HIP", "KNEE", "ANKLE", "HEEL", "TOE")))
    table_sides = both(
        *(
            exchange(f"Right{name} [deg]", f"Left{name} [deg]")
            for name in ("HipFlexionAngle", "KneeFlexionAngle", "AnkleDorsiflexionAngle", "ShankAngle")
        )
    )
    feet = both(swap("R_HEEL", "R_TOE"), swap("L_HEEL", "L_TOE"))
    knees = both(swap("R_KNEE", "R_ANKLE"), swap("L_KNEE", "L_ANKLE"))
    forces = {"lbf": 1 / POUND_FORCE, "kN": 1e-3, "N/kg": 1 / Walker.mass, "%BW": 100 / (Walker.mass * GRAVITY)}
    unit_names = ("grf_vertical-unit", "ground_force_1_vy-unit", "ground_force_2_vy-unit")
    table_names = ("grf_vertical-unit", "RightGRF_vertical [N]-unit", "LeftGRF_vertical [N]-unit")
    variants = []
    for unit, factor in forces.items():
        variants += [
            Variant("opensim", f"forces in {unit}", unit_names, times("_v", factor)),
            Variant("trc", f"forces in {unit}", unit_names, load_edit=times("_v", factor)),
            Variant("table", f"forces in {unit} under [N]", table_names, times("GRF", factor)),
        ]
    for unit, factor in {"ms": 1e3, "min": 1 / 60.0, "frames": 100.0}.items():
        variants += [
            Variant("opensim", f"time in {unit}", ("time-unit",), times("time", factor), SHORT_WALK),
            Variant("table", f"time in {unit}", ("time-unit",), times("time", factor), SHORT_WALK),
            Variant(
                "trc",
                f"time in {unit}",
                ("time-unit",),
                times("time", factor),
                SHORT_WALK,
                None,
                None,
                times("time", factor),
            ),
        ]
    moment_names = ("ankle_angle_r_moment-unit", "ankle_angle_l_moment-unit")
    for unit, factor in {"N·mm": 1e3, "N·m/kg": 1 / Walker.mass}.items():
        variants += [
            Variant("opensim", f"moment in {unit}", moment_names, times(leg, factor)),
            Variant(
                "table",
                f"moment in {unit} under [N*m]",
                ("RightAnkleMoment [N*m]-unit", "LeftAnkleMoment [N*m]-unit"),
                times(table_moment, factor),
            ),
        ]
    variants += [
        Variant("opensim", "hip in radians, knee in degrees", ("hip_flexion_deg-unit",), on("hip_flexion", np.radians)),
        Variant("opensim", "-9999 for missing", ("knee_angle_r-missing",), put_code("knee_angle_r", -9999.0, 100)),
        Variant(
            "opensim",
            "99999 for missing force",
            ("ground_force_1_vx-missing",),
            put_code("ground_force_1_vx", 99999.0, 100),
        ),
        Variant("opensim", "mass in lb", ("mass-unit",), mass=Walker.mass / 0.45359237),
        Variant("opensim", "time reversed", ("time-reversed",), reverse),
        Variant("table", "legs exchanged", ("side-exchanged",), table_sides),
        Variant("table", "mass in lb", ("mass-unit",), mass=Walker.mass / 0.45359237),
        Variant(
            "table",
            "ankle in radians under [deg]",
            ("ankle_dorsiflexion_deg-unit",),
            on("AnkleDorsi", np.radians),
        ),
        Variant("trc", "m under mm", ("marker-unit",), unit="mm"),
        Variant("trc", "mm under m", ("marker-unit",), both(times("R_", 1e3), times("L_", 1e3))),
        Variant("trc", "cm under m", ("marker-unit",), both(times("R_", 1e2), times("L_", 1e2))),
        Variant("trc", "in under m", ("marker-unit",), both(times("R_", 1 / INCH), times("L_", 1 / INCH))),
        Variant("trc", "knee and ankle exchanged", ("marker-exchanged",), knees),
        Variant(
            "trc", "knee and ankle exchanged for a while", ("marker-exchanged",), swap("R_KNEE", "R_HIP", 100, 160)
        ),
        Variant("trc", "right and left exchanged", ("side-exchanged",), sides),
        Variant("trc", "heel and toe exchanged", ("forward-sign",), feet),
        Variant("trc", "origin for hidden markers", ("marker-missing",), put_code("R_KNEE", 0.0, 100)),
        Variant("trc", "-9999 for hidden markers", ("marker-missing",), put_code("R_KNEE", -9999.0, 100)),
        Variant(
            "trc", "stature in another unit", ("stature-unit",), stature=2.3, walker=Walker(stature=1.4, speed=1.0)
        ),
        Variant("trc", "mass in lb", ("mass-unit",), mass=Walker.mass / 0.45359237),
        Variant("trc", "centre of pressure in mm", ("cop-unit",), load_edit=times("_p", 1e3)),
        Variant("trc", "centre of pressure 1.5 m off", ("cop-origin",), load_edit=on("_px", lambda x: x + 1.5)),
        Variant("trc", "centre of pressure reversed", ("cop-sign", "cop-origin"), load_edit=times("_px", -1.0)),
        Variant("c3d", "m under mm", ("marker-unit",), both(times("R_", 1e-3), times("L_", 1e-3))),
        Variant("c3d", "mm under m", ("marker-unit",), unit="m"),
        Variant("c3d", "right and left exchanged", ("side-exchanged",), sides),
        Variant("c3d", "heel and toe exchanged", ("forward-sign",), feet),
        Variant("c3d", "knee and ankle exchanged", ("marker-exchanged",), knees),
        Variant("c3d", "mass in lb", ("mass-unit",), mass=Walker.mass / 0.45359237),
        Variant("c3d", "plates 1.5 m off", ("cop-origin",), load_edit=on("_px", lambda x: x + 1.5)),
        Variant(
            "c3d",
            "moments of the plates in N·m under N·mm",
            ("cop-origin", "cop-unit"),
            load_edit=on("_px", lambda x: 3.0 + (x - 3.0) / 1e3),
        ),
    ]
    return variants


def list_variants() -> list[Variant]:
    """Return all wrong variants."""
    return [*_list_references(), *_list_datasets(), *_list_motion_files()]
