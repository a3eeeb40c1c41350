"""Effects of the body that carries the device: ankle, foot, return spring and socket. Only gait runs show them.

Each law changes fields of :class:`klute_sim.laws.foot.Foot`, whose nominal values come from the MJCF. The replay uses
the changed foot; for MuJoCo the MJCF model is edited to match (:mod:`klute_sim.gait.body`).
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.foot import Foot

MIN_KEEL_TIME_CONSTANT = 1e-3
"""Time constant of a foot that bends without loss [s].

Assumed: too short to show in a gait run, and long enough for MuJoCo's time step at any stiffness of the foot.
"""
MIN_SOCKET_TIME_CONSTANT = 3e-3
"""Time constant of a socket without loss [s] (assumed): a tenth of the period of 2 kg on 100 N/mm."""


def add_ankle_friction(p: Any, foot: Foot) -> Foot:
    """Return the foot with ``p.moment`` [N.m] more Coulomb friction in the ankle."""
    return foot._replace(ankle_friction=foot.ankle_friction + p.moment)


def add_ankle_damping(p: Any, foot: Foot) -> Foot:
    """Return the foot with ``p.damping`` [N.m.s/rad] more viscous damping in the ankle."""
    return foot._replace(ankle_damping=foot.ankle_damping + p.damping)


def add_friction_and_damping(p: Any, foot: Foot) -> Foot:
    """Return the foot with more Coulomb friction and more viscous damping in the ankle."""
    return add_ankle_damping(p, add_ankle_friction(p, foot))


def scale_spring_stiffness(p: Any, foot: Foot) -> Foot:
    """Return the foot with ``p.gain`` times the stiffness of the return spring."""
    return foot._replace(spring_stiffness=p.gain * foot.spring_stiffness)


def shift_spring_rest_angle(p: Any, foot: Foot) -> Foot:
    """Return the foot with a return spring that is slack ``p.shift`` [rad] further in dorsiflexion."""
    return foot._replace(spring_rest_angle=foot.spring_rest_angle - p.shift)


def add_bumper(p: Any, foot: Foot) -> Foot:
    """Return the foot with a bumper of ``p.stiffness`` [N.m/rad] from ``p.begin`` [rad] of dorsiflexion on."""
    return foot._replace(bumper_stiffness=foot.bumper_stiffness + p.stiffness, bumper_onset_angle=p.begin)


def scale_insertion(p: Any, foot: Foot) -> Foot:
    """Return the foot with the tendon inserted ``p.gain`` times as far from the ankle."""
    return foot._replace(insertion_x=p.gain * foot.insertion_x, insertion_z=p.gain * foot.insertion_z)


def scale_mass(p: Any, foot: Foot) -> Foot:
    """Return the foot with ``p.gain`` times the mass and the same shape."""
    heavier = add_distal_mass(foot, (p.gain - 1.0) * foot.mass)
    return heavier._replace(mass=p.gain * foot.mass, inertia=p.gain * foot.inertia)


def add_distal_mass(foot: Foot, mass: float) -> Foot:
    """Return ``foot`` with ``mass`` [kg] more below the socket, at the centre of mass of the foot.

    Mass and inertia of the foot itself do not change.
    """
    distal_mass = foot.distal_mass + mass
    lift = mass / distal_mass * (foot.com_z - foot.distal_com_z)
    return foot._replace(distal_mass=distal_mass, distal_com_z=foot.distal_com_z + lift)


def add_keel_compliance(p: Any, foot: Foot) -> Foot:
    """Return a foot that bends by ``p.compliance`` [rad/(N.m)] more, without loss."""
    return _add_compliance(foot, p.compliance, MIN_KEEL_TIME_CONSTANT, 0.0)


def add_viscous_keel(p: Any, foot: Foot) -> Foot:
    """Return a foot that bends by ``p.compliance`` [rad/(N.m)] more with the time constant ``p.time_constant`` [s]."""
    return _add_compliance(foot, p.compliance, max(p.time_constant, MIN_KEEL_TIME_CONSTANT), 0.0)


def add_friction_keel(p: Any, foot: Foot) -> Foot:
    """Return a foot that bends by ``p.compliance`` [rad/(N.m)] more against a dry friction of ``p.moment`` [N.m]."""
    return _add_compliance(foot, p.compliance, MIN_KEEL_TIME_CONSTANT, p.moment)


def _add_compliance(foot: Foot, compliance: float, time_constant: float, friction_moment: float) -> Foot:
    """Return ``foot`` with more ``compliance`` [rad/(N.m)]; its losses are weighted by its part of the total."""
    if compliance == 0.0:
        return foot
    total = foot.keel_compliance + compliance
    mean_time_constant = (foot.keel_compliance * foot.keel_time_constant + compliance * time_constant) / total
    return foot._replace(
        keel_compliance=total,
        keel_time_constant=mean_time_constant,
        keel_friction_angle=foot.keel_friction_angle + compliance * friction_moment,
    )


def add_socket_compliance(p: Any, foot: Foot) -> Foot:
    """Return the foot on a socket that yields along the pylon by ``p.compliance`` [m/N], without loss."""
    return _add_pistoning(foot, p.compliance, MIN_SOCKET_TIME_CONSTANT)


def add_damped_socket(p: Any, foot: Foot) -> Foot:
    """Return the foot on a socket that yields by ``p.compliance`` [m/N] along the pylon in ``p.time_constant`` [s]."""
    return _add_pistoning(foot, p.compliance, max(p.time_constant, MIN_SOCKET_TIME_CONSTANT))


def _add_pistoning(foot: Foot, compliance: float, time_constant: float) -> Foot:
    """Return ``foot`` on a socket with ``compliance`` [m/N]; the socket of a foot is rigid without this effect."""
    if compliance == 0.0:
        return foot
    return foot._replace(socket_compliance=compliance, socket_time_constant=time_constant)


def add_socket_tilt(p: Any, foot: Foot) -> Foot:
    """Return the foot on a socket that tilts by ``p.compliance`` [rad/(N.m)] about ``p.height`` [m], without loss."""
    return _add_tilt(foot, p.compliance, p.height, MIN_SOCKET_TIME_CONSTANT)


def add_damped_socket_tilt(p: Any, foot: Foot) -> Foot:
    """Return the foot on a socket that tilts by ``p.compliance`` [rad/(N.m)] with ``p.time_constant`` [s]."""
    return _add_tilt(foot, p.compliance, p.height, max(p.time_constant, MIN_SOCKET_TIME_CONSTANT))


def _add_tilt(foot: Foot, compliance: float, height: float, time_constant: float) -> Foot:
    """Return ``foot`` on a socket that tilts; the socket of a foot does not tilt without this effect."""
    if compliance == 0.0:
        return foot
    return foot._replace(tilt_compliance=compliance, tilt_time_constant=time_constant, tilt_height=height)


def _make_form(name: str, equation: str, law: Any, *parameters: EffectParameter) -> EffectForm:
    return EffectForm(name=name, equation=equation, parameters=parameters, laws={"foot": law})


_JOINT_SOURCE = "assumed: no friction of this ankle is published; 10 % of its peak moment would be a seized bearing"
_FRICTION_MOMENT = EffectParameter(
    key="moment_n_m", neutral=0.0, lower=0.0, upper=15.0, typical=2.0, source=_JOINT_SOURCE
)
_DAMPING = EffectParameter(key="damping_n_m_s", neutral=0.0, lower=0.0, upper=10.0, typical=1.0, source=_JOINT_SOURCE)

ANKLE_FRICTION = Effect(
    name="ankle_friction",
    description="The ankle has dry friction in its bearing, or viscous bushes.",
    kind="body",
    forms=(
        _make_form("coulomb", "M = -moment sign(dq/dt)", add_ankle_friction, _FRICTION_MOMENT),
        _make_form("viscous", "M = -damping dq/dt", add_ankle_damping, _DAMPING),
        _make_form(
            "both", "M = -moment sign(dq/dt) - damping dq/dt", add_friction_and_damping, _FRICTION_MOMENT, _DAMPING
        ),
    ),
)
_SPRING_SOURCE = "assumed: the return spring of models/ankle.xml is assumed itself"
RETURN_SPRING_ERROR = Effect(
    name="return_spring_error",
    description="The ankle's return spring is stiffer or softer than assumed, or slack at another angle.",
    kind="body",
    forms=(
        _make_form(
            "stiffness",
            "M = -gain k (q - q0)",
            scale_spring_stiffness,
            EffectParameter(key="gain", neutral=1.0, lower=0.3, upper=3.0, typical=1.1, source=_SPRING_SOURCE),
        ),
        _make_form(
            "rest",
            "M = -k (q - q0 + shift)",
            shift_spring_rest_angle,
            EffectParameter(key="shift_deg", neutral=0.0, lower=-15.0, upper=15.0, typical=1.0, source=_SPRING_SOURCE),
        ),
    ),
)
_BUMPER_SOURCE = "assumed: rubber bumpers of prosthetic ankles yield several degrees under body weight"
END_STOP = Effect(
    name="end_stop",
    description="A bumper limits dorsiflexion before the end stop does.",
    kind="body",
    forms=(
        _make_form(
            "bumper",
            "M = stiffness max(0, dorsiflexion - begin)",
            add_bumper,
            EffectParameter(
                key="stiffness_n_m_per_deg", neutral=0.0, lower=0.0, upper=100.0, typical=4.0, source=_BUMPER_SOURCE
            ),
            EffectParameter(key="begin_deg", neutral=None, lower=1.0, upper=25.0, typical=7.0, source=_BUMPER_SOURCE),
        ),
    ),
)
MOMENT_ARM_ERROR = Effect(
    name="moment_arm_error",
    description="The tendon is inserted nearer to or further from the ankle's axis than in the drawing.",
    kind="body",
    forms=(
        _make_form(
            "insertion",
            "insertion = gain insertion_0",
            scale_insertion,
            EffectParameter(
                key="gain",
                neutral=1.0,
                lower=0.7,
                upper=1.4,
                typical=1.05,
                source="assumed: 2.4 mm of 48; the Achilles tendon's own arm varies by 4.5 mm (Wolfram 2018)",
            ),
        ),
    ),
)
INERTIA_ERROR = Effect(
    name="inertia_error",
    description="The foot is heavier or lighter than assumed, for example because of a shoe.",
    kind="body",
    forms=(
        _make_form(
            "mass",
            "m = gain m_0, I = gain I_0",
            scale_mass,
            EffectParameter(
                key="gain",
                neutral=1.0,
                lower=0.4,
                upper=3.0,
                typical=1.4,
                source="assumed: a shoe weighs 0.3 kg, the foot 0.8 kg",
            ),
        ),
    ),
)
_KEEL_SOURCE = "assumed: stiffer than the stiffest setting of a measured foot, 14.9 N.m/deg (docs/real-data.md)"
_COMPLIANCE = EffectParameter(
    key="compliance_deg_per_n_m", neutral=0.0, lower=0.0, upper=0.5, typical=0.05, source=_KEEL_SOURCE
)
FOOT_STIFFNESS = Effect(
    name="foot_stiffness",
    description=(
        "The foot is not rigid: beyond the ankle's hinge it bends under load. It is visible if `ankle_angle` is "
        "measured with markers on the foot; exclude it if an encoder on the hinge measures the angle."
    ),
    kind="body",
    forms=(
        _make_form(
            "linear",
            "angle = hinge + compliance M, M the moment in the hinge",
            add_keel_compliance,
            _COMPLIANCE,
        ),
    ),
)
FOOT_HYSTERESIS = Effect(
    name="foot_hysteresis",
    description=(
        "The foot bends under load and returns late or incompletely, so it dissipates energy. It is visible if "
        "`ankle_angle` is measured on the foot, not with an encoder on the hinge."
    ),
    kind="body",
    forms=(
        _make_form(
            "viscous",
            "angle = hinge + b, time db/dt = compliance M - b",
            add_viscous_keel,
            _COMPLIANCE,
            EffectParameter(
                key="time_constant_s",
                neutral=None,
                lower=0.002,
                upper=2.0,
                typical=0.03,
                source="assumed: about a tenth of the loading time of the foot",
            ),
        ),
        _make_form(
            "coulomb",
            "angle = hinge + b, b follows compliance M, at most compliance moment behind",
            add_friction_keel,
            _COMPLIANCE,
            EffectParameter(
                key="moment_n_m",
                neutral=None,
                lower=0.1,
                upper=30.0,
                typical=3.0,
                source="assumed: 3 % of the peak moment; loops of a measured foot are 0.3 to 3 N.m wide",
            ),
        ),
    ),
)
_SOCKET_SOURCE = "a range of 30 mm and 15 degrees was measured in one person (doi 10.1177/0309364615610660)"
_PISTONING_COMPLIANCE = EffectParameter(
    key="compliance_mm_per_kn",
    neutral=0.0,
    lower=0.0,
    upper=60.0,
    typical=10.0,
    source=f"assumed: 8 mm under body weight; {_SOCKET_SOURCE}",
)
_SOCKET_TIME_CONSTANT = EffectParameter(
    key="time_constant_s",
    neutral=None,
    lower=MIN_SOCKET_TIME_CONSTANT,
    upper=0.3,
    typical=0.03,
    source="assumed: no damping of a socket was found; about a tenth of the loading time of the foot",
)
SOCKET_PISTONING = Effect(
    name="socket_pistoning",
    description=(
        "The limb moves in its socket under load. It is visible if `ankle_x` and `ankle_z` are derived from the limb "
        "above the socket; exclude it if the markers are on the prosthesis."
    ),
    kind="body",
    forms=(
        _make_form(
            "axial",
            "ankle displacement = compliance F up the pylon, F the socket's load",
            add_socket_compliance,
            _PISTONING_COMPLIANCE,
        ),
        _make_form(
            "damped",
            "ankle displacement = d up the pylon, time dd/dt = compliance F - d",
            add_damped_socket,
            _PISTONING_COMPLIANCE,
            _SOCKET_TIME_CONSTANT,
        ),
    ),
)
_TILT_COMPLIANCE = EffectParameter(
    key="compliance_deg_per_n_m",
    neutral=0.0,
    lower=0.0,
    upper=0.3,
    typical=0.03,
    source=f"assumed: 3 degrees under 100 N.m; {_SOCKET_SOURCE}",
)
_TILT_HEIGHT = EffectParameter(
    key="height_mm",
    neutral=None,
    lower=100.0,
    upper=600.0,
    typical=330.0,
    source="assumed: the middle of a socket, 0.1 m below the knee",
)
SOCKET_TILT = Effect(
    name="socket_tilt",
    description=(
        "The limb rotates in its socket under load. It is visible if `ankle_x`, `ankle_z` and `shank_angle` are "
        "derived from the limb above the socket and `ankle_angle` is measured on the prosthesis; exclude it if all "
        "markers are on the prosthesis."
    ),
    kind="body",
    forms=(
        _make_form(
            "elastic",
            "pylon lean = limb lean + compliance M, M the moment about height above the ankle",
            add_socket_tilt,
            _TILT_COMPLIANCE,
            _TILT_HEIGHT,
        ),
        _make_form(
            "damped",
            "pylon lean = limb lean + e, time de/dt = compliance M - e, M the moment about height above the ankle",
            add_damped_socket_tilt,
            _TILT_COMPLIANCE,
            _TILT_HEIGHT,
            _SOCKET_TIME_CONSTANT,
        ),
    ),
)
