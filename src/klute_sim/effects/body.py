"""Effects of the body that the device is built into: of ankle, foot and return spring. They show on a walk only.

Each changes the numbers of :class:`klute_sim.laws.foot.Foot`, which are the MJCF's: what a replay then does, MuJoCo
does with the model edited likewise (:func:`klute_sim.rigs.gait.body.into`).
"""

from typing import Any

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws.foot import Foot

SETTLES = 1e-3
"""Time in which a foot that bends comes to rest [s] (assumed): far below what a walk shows, and long enough for MuJoCo
to step over, however stiff the foot."""


def rubbing(own: Numbers, foot: Foot) -> Foot:
    """Coulomb friction of the ankle, ``own[0]`` [N.m] more."""
    return foot._replace(friction=foot.friction + own[0])


def damped(own: Numbers, foot: Foot) -> Foot:
    """Viscous damping of the ankle, ``own[0]`` [N.m.s/rad] more."""
    return foot._replace(damping=foot.damping + own[0])


def rubbing_and_damped(own: Numbers, foot: Foot) -> Foot:
    """Both."""
    return damped(own[1:], rubbing(own, foot))


def stiffer(own: Numbers, foot: Foot) -> Foot:
    """A return spring of ``own[0]`` times the stiffness."""
    return foot._replace(stiffness=own[0] * foot.stiffness)


def shifted(own: Numbers, foot: Foot) -> Foot:
    """A return spring that is slack ``own[0]`` [rad] further in dorsiflexion."""
    return foot._replace(rest=foot.rest - own[0])


def bumped(own: Numbers, foot: Foot) -> Foot:
    """A bumper of stiffness ``own[0]`` [N.m/rad] from ``own[1]`` [rad] of dorsiflexion on."""
    return foot._replace(bumper=foot.bumper + own[0], bumper_at=own[1])


def levered(own: Numbers, foot: Foot) -> Foot:
    """The tendon inserted ``own[0]`` times as far from the ankle."""
    return foot._replace(insertion_x=own[0] * foot.insertion_x, insertion_z=own[0] * foot.insertion_z)


def heavier(own: Numbers, foot: Foot) -> Foot:
    """A foot of ``own[0]`` times the mass, shaped alike."""
    more = (own[0] - 1.0) * foot.mass
    return foot._replace(mass=own[0] * foot.mass, inertia=own[0] * foot.inertia, carried=foot.carried + more)


def yielding(own: Numbers, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], at once."""
    return _softer(foot, own[0], SETTLES, 0.0)


def creeping(own: Numbers, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], but takes ``own[1]`` [s] to."""
    return _softer(foot, own[0], max(own[1], SETTLES), 0.0)


def rubbed(own: Numbers, foot: Foot) -> Foot:
    """A foot that bends by ``own[0]`` [rad/(N.m)], but holds ``own[1]`` [N.m] back, whichever way it goes."""
    return _softer(foot, own[0], SETTLES, own[1])


def _softer(foot: Foot, compliance: float, time: float, moment: float) -> Foot:
    """Bending by ``compliance`` [rad/(N.m)] more; what is lost in it is in proportion to its share."""
    if compliance == 0.0:
        return foot
    whole = foot.keel + compliance
    slow = (foot.keel * foot.keel_time + compliance * time) / whole
    return foot._replace(keel=whole, keel_time=slow, keel_held=foot.keel_held + compliance * moment)


def sunk(own: Numbers, foot: Foot) -> Foot:
    """A socket that gives by ``own[0]`` [m/N] more along the pylon."""
    return foot._replace(socket=foot.socket + own[0])


def _form(name: str, equation: str, law: Any, *parameters: Parameter) -> Form:
    return Form(name=name, equation=equation, parameters=parameters, laws={"foot": law})


_JOINT = "assumed: no friction of this ankle is printed; a tenth of its peak moment would be a seized bearing"
_MOMENT = Parameter(key="moment_n_m", neutral=0.0, low=0.0, high=15.0, typical=2.0, source=_JOINT)
_DAMPING = Parameter(key="damping_n_m_s", neutral=0.0, low=0.0, high=10.0, typical=1.0, source=_JOINT)

FRICTION = Effect(
    name="ankle_friction",
    sentence="The ankle's bearing rubs, or its bushes are viscous.",
    kind="body",
    forms=(
        _form("coulomb", "M = -moment sign(dq/dt)", rubbing, _MOMENT),
        _form("viscous", "M = -damping dq/dt", damped, _DAMPING),
        _form("both", "M = -moment sign(dq/dt) - damping dq/dt", rubbing_and_damped, _MOMENT, _DAMPING),
    ),
)
_SPRING = "assumed: the return spring of models/ankle.xml is assumed itself"
SPRING = Effect(
    name="return_spring_error",
    sentence="The ankle's return spring is stiffer or softer than it is taken to be, or slack elsewhere.",
    kind="body",
    forms=(
        _form(
            "stiffness",
            "M = -gain k (q - q0)",
            stiffer,
            Parameter(key="gain", neutral=1.0, low=0.3, high=3.0, typical=1.1, source=_SPRING),
        ),
        _form(
            "rest",
            "M = -k (q - q0 + shift)",
            shifted,
            Parameter(key="shift_deg", neutral=0.0, low=-15.0, high=15.0, typical=1.0, source=_SPRING),
        ),
    ),
)
_BUMPER = "assumed: rubber bumpers of prosthetic ankles give several degrees under body weight"
STOP = Effect(
    name="end_stop",
    sentence="A bumper limits dorsiflexion before the end stop does.",
    kind="body",
    forms=(
        _form(
            "bumper",
            "M = stiffness max(0, dorsiflexion - begin)",
            bumped,
            Parameter(key="stiffness_n_m_per_deg", neutral=0.0, low=0.0, high=100.0, typical=4.0, source=_BUMPER),
            Parameter(key="begin_deg", neutral=None, low=1.0, high=25.0, typical=7.0, source=_BUMPER),
        ),
    ),
)
ARM = Effect(
    name="moment_arm_error",
    sentence="The tendon is inserted nearer to the ankle's axis, or further from it, than drawn.",
    kind="body",
    forms=(
        _form(
            "insertion",
            "insertion = gain (drawn insertion)",
            levered,
            Parameter(
                key="gain",
                neutral=1.0,
                low=0.7,
                high=1.4,
                typical=1.05,
                source="assumed: 2.4 mm of 48; the Achilles tendon's own arm varies by 4.5 mm (Wolfram 2018)",
            ),
        ),
    ),
)
INERTIA = Effect(
    name="inertia_error",
    sentence="The foot is heavier or lighter than it is taken to be: a shoe, for one.",
    kind="body",
    forms=(
        _form(
            "mass",
            "m and I = gain (drawn ones)",
            heavier,
            Parameter(
                key="gain",
                neutral=1.0,
                low=0.4,
                high=3.0,
                typical=1.4,
                source="assumed: a shoe weighs 0.3 kg, the foot 0.8 kg",
            ),
        ),
    ),
)
_KEEL = "assumed: stiffer than the stiffest setting of a measured foot, 14.9 N.m/deg (docs/real-data.md)"
_COMPLIANCE = Parameter(key="compliance_deg_per_n_m", neutral=0.0, low=0.0, high=0.5, typical=0.05, source=_KEEL)
KEEL = Effect(
    name="foot_stiffness",
    sentence=(
        "The foot is not rigid: beyond the ankle's hinge it bends under its load. It shows where `ankle_angle` is that "
        "of the foot, from markers on it; an encoder on the hinge does not see it, and then this is to be left out."
    ),
    kind="body",
    forms=(
        _form(
            "linear",
            "angle = hinge + compliance M, M the moment that crosses the hinge",
            yielding,
            _COMPLIANCE,
        ),
    ),
)
LOSS = Effect(
    name="foot_hysteresis",
    sentence=(
        "The foot bends under its load and comes back late, or not all the way: it gives back less than it took. It "
        "shows where `ankle_angle` is that of the foot, not of an encoder on the hinge."
    ),
    kind="body",
    forms=(
        _form(
            "viscous",
            "angle = hinge + b, time db/dt = compliance M - b",
            creeping,
            _COMPLIANCE,
            Parameter(
                key="time_constant_s",
                neutral=None,
                low=0.002,
                high=2.0,
                typical=0.03,
                source="assumed: a tenth or so of the time in which the foot is loaded",
            ),
        ),
        _form(
            "coulomb",
            "angle = hinge + b, b follows compliance M, at most compliance moment behind",
            rubbed,
            _COMPLIANCE,
            Parameter(
                key="moment_n_m",
                neutral=None,
                low=0.1,
                high=30.0,
                typical=3.0,
                source="assumed: 3 % of the peak moment; a measured foot's loops are 0.3 to 3 N.m wide each way",
            ),
        ),
    ),
)
SOCKET = Effect(
    name="socket_pistoning",
    sentence=(
        "The limb sinks into its socket under load. It shows where `ankle_x` and `ankle_z` were reckoned from the "
        "limb, above the socket; markers on the prosthesis itself do not see it, and then this is to be left out."
    ),
    kind="body",
    forms=(
        _form(
            "axial",
            "the ankle is compliance F up the pylon from where a rigid shank has it, F the socket's load",
            sunk,
            Parameter(
                key="compliance_mm_per_kn",
                neutral=0.0,
                low=0.0,
                high=60.0,
                typical=10.0,
                source="assumed: 8 mm under body weight; up to 30 mm were measured (doi 10.1177/0309364615610660)",
            ),
        ),
    ),
)
