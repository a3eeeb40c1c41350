"""Effects of the body that the device is built into: of ankle, foot and return spring. They show on a walk only.

Each changes the numbers of :class:`klute_sim.laws.foot.Foot`, which are the MJCF's: what a replay then does, MuJoCo
does with the model edited likewise (:func:`klute_sim.gait.body.into`).
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws.foot import Foot

MIN_KEEL_TIME_CONSTANT = 1e-3
"""Time in which a foot that bends comes to rest [s] (assumed): far below what a walk shows, and long enough for MuJoCo
to step over, however stiff the foot."""


def add_ankle_friction(p: FloatSequence, foot: Foot) -> Foot:
    """Coulomb friction of the ankle, ``own[0]`` [N.m] more."""
    return foot._replace(ankle_friction=foot.ankle_friction + p[0])


def add_ankle_damping(p: FloatSequence, foot: Foot) -> Foot:
    """Viscous damping of the ankle, ``own[0]`` [N.m.s/rad] more."""
    return foot._replace(ankle_damping=foot.ankle_damping + p[0])


def add_friction_and_damping(p: FloatSequence, foot: Foot) -> Foot:
    """Both."""
    return add_ankle_damping(p[1:], add_ankle_friction(p, foot))


def scale_spring_stiffness(p: FloatSequence, foot: Foot) -> Foot:
    """A return spring of ``own[0]`` times the stiffness."""
    return foot._replace(spring_stiffness=p[0] * foot.spring_stiffness)


def shift_spring_rest_angle(p: FloatSequence, foot: Foot) -> Foot:
    """A return spring that is slack ``own[0]`` [rad] further in dorsiflexion."""
    return foot._replace(spring_rest_angle=foot.spring_rest_angle - p[0])


def add_bumper(p: FloatSequence, foot: Foot) -> Foot:
    """A bumper of stiffness ``own[0]`` [N.m/rad] from ``own[1]`` [rad] of dorsiflexion on."""
    return foot._replace(bumper_stiffness=foot.bumper_stiffness + p[0], bumper_onset_angle=p[1])


def scale_insertion(p: FloatSequence, foot: Foot) -> Foot:
    """The tendon inserted ``own[0]`` times as far from the ankle."""
    return foot._replace(insertion_x=p[0] * foot.insertion_x, insertion_z=p[0] * foot.insertion_z)


def scale_mass(p: FloatSequence, foot: Foot) -> Foot:
    """A foot of ``own[0]`` times the mass, shaped alike."""
    more = (p[0] - 1.0) * foot.mass
    return foot._replace(mass=p[0] * foot.mass, inertia=p[0] * foot.inertia, distal_mass=foot.distal_mass + more)


def add_keel_compliance(p: FloatSequence, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], at once."""
    return _add_compliance(foot, p[0], MIN_KEEL_TIME_CONSTANT, 0.0)


def add_viscous_keel(p: FloatSequence, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], but takes ``own[1]`` [s] to."""
    return _add_compliance(foot, p[0], max(p[1], MIN_KEEL_TIME_CONSTANT), 0.0)


def add_friction_keel(p: FloatSequence, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], but holds ``own[1]`` [N.m] back, whichever way it goes."""
    return _add_compliance(foot, p[0], MIN_KEEL_TIME_CONSTANT, p[1])


def _add_compliance(foot: Foot, compliance: float, time_constant: float, friction_moment: float) -> Foot:
    """Bending by ``compliance`` [rad/(N.m)] more; what is lost in it is in proportion to its share."""
    if compliance == 0.0:
        return foot
    whole = foot.keel_compliance + compliance
    slow = (foot.keel_compliance * foot.keel_time_constant + compliance * time_constant) / whole
    return foot._replace(
        keel_compliance=whole,
        keel_time_constant=slow,
        keel_friction_angle=foot.keel_friction_angle + compliance * friction_moment,
    )


def add_socket_compliance(p: FloatSequence, foot: Foot) -> Foot:
    """A socket that gives by ``own[0]`` [m/N] more along the pylon."""
    return foot._replace(socket_compliance=foot.socket_compliance + p[0])


def _make_form(name: str, equation: str, law: Any, *parameters: EffectParameter) -> EffectForm:
    return EffectForm(name=name, equation=equation, parameters=parameters, laws={"foot": law})


_JOINT_SOURCE = "assumed: no friction of this ankle is printed; a tenth of its peak moment would be a seized bearing"
_FRICTION_MOMENT = EffectParameter(
    key="moment_n_m", neutral=0.0, lower=0.0, upper=15.0, typical=2.0, source=_JOINT_SOURCE
)
_DAMPING = EffectParameter(key="damping_n_m_s", neutral=0.0, lower=0.0, upper=10.0, typical=1.0, source=_JOINT_SOURCE)

ANKLE_FRICTION = Effect(
    name="ankle_friction",
    description="The ankle's bearing rubs, or its bushes are viscous.",
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
    description="The ankle's return spring is stiffer or softer than it is taken to be, or slack elsewhere.",
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
_BUMPER_SOURCE = "assumed: rubber bumpers of prosthetic ankles give several degrees under body weight"
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
    description="The tendon is inserted nearer to the ankle's axis, or further from it, than drawn.",
    kind="body",
    forms=(
        _make_form(
            "insertion",
            "insertion = gain (drawn insertion)",
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
    description="The foot is heavier or lighter than it is taken to be: a shoe, for one.",
    kind="body",
    forms=(
        _make_form(
            "mass",
            "m and I = gain (drawn ones)",
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
        "The foot is not rigid: beyond the ankle's hinge it bends under its load. It shows where `ankle_angle` is that "
        "of the foot, from markers on it; an encoder on the hinge does not see it, and then this is to be left out."
    ),
    kind="body",
    forms=(
        _make_form(
            "linear",
            "angle = hinge + compliance M, M the moment that crosses the hinge",
            add_keel_compliance,
            _COMPLIANCE,
        ),
    ),
)
FOOT_HYSTERESIS = Effect(
    name="foot_hysteresis",
    description=(
        "The foot bends under its load and comes back late, or not all the way: it gives back less than it took. It "
        "shows where `ankle_angle` is that of the foot, not of an encoder on the hinge."
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
                source="assumed: a tenth or so of the time in which the foot is loaded",
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
                source="assumed: 3 % of the peak moment; a measured foot's loops are 0.3 to 3 N.m wide each way",
            ),
        ),
    ),
)
SOCKET_PISTONING = Effect(
    name="socket_pistoning",
    description=(
        "The limb sinks into its socket under load. It shows where `ankle_x` and `ankle_z` were reckoned from the "
        "limb, above the socket; markers on the prosthesis itself do not see it, and then this is to be left out."
    ),
    kind="body",
    forms=(
        _make_form(
            "axial",
            "the ankle is compliance F up the pylon from where a rigid shank has it, F the socket's load",
            add_socket_compliance,
            EffectParameter(
                key="compliance_mm_per_kn",
                neutral=0.0,
                lower=0.0,
                upper=60.0,
                typical=10.0,
                source="assumed: 8 mm under body weight; up to 30 mm were measured (doi 10.1177/0309364615610660)",
            ),
        ),
    ),
)
