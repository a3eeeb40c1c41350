"""Tests of the walker's body: its data, the paths of its muscles, and its model in MuJoCo."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.files.toml import parse_toml
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.laws.muscle_tendon import MuscleTendon, tendon_strain
from klute_sim.plant import models
from klute_sim.walker.person import body as body_module
from klute_sim.walker.person import muscles
from klute_sim.walker.person.body import MUSCLES, load_body
from klute_sim.walker.person.build import Ground, Prosthesis, build_walker_model, get_contact

BODY = load_body()
ROWS = {name: muscles.unpack_muscle(tuple(row)) for name, row in zip(MUSCLES, BODY.muscle_rows.tolist(), strict=True)}
DEVICE = load_device("klute-1-1-4-pair")
ANGLES = st.tuples(st.floats(-0.5, 1.2), st.floats(0.05, 1.4), st.floats(-0.6, 0.4))


def test_every_number_has_a_source() -> None:
    sources, document = BODY.document.sources, BODY.document
    for name in MUSCLES:
        for key, value in getattr(document.muscles, name).model_dump().items():
            keys = list(value) if isinstance(value, dict) else [key] if value is not None else []
            assert all(f"muscles.{k}" in sources for k in keys), (name, keys)
    for title in ("nerves", "amputation"):
        assert all(f"{title}.{key}" in sources for key in getattr(document, title).model_dump())


@pytest.mark.parametrize("name", MUSCLES)
@given(angles=ANGLES)
def test_moment_arm_is_the_derivative_of_the_length(name: str, angles: tuple[float, float, float]) -> None:
    muscle, step = ROWS[name], 1e-6
    for k, path in enumerate((muscle.hip, muscle.knee, muscle.ankle)):
        lengths = []
        for sign in (1.0, -1.0):
            moved = list(angles)
            moved[k] += sign * step
            lengths.append(muscles.compute_unit_length(muscle, *moved))
        slope = (lengths[0] - lengths[1]) / (2.0 * step)
        assert muscles.compute_arm(path, angles[k]) == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("name", MUSCLES)
def test_reference_posture_has_optimal_fibers_and_a_slack_tendon(name: str) -> None:
    muscle = ROWS[name]
    posture = [path.reference for path in (muscle.hip, muscle.knee, muscle.ankle)]
    length = muscles.compute_unit_length(muscle, *posture)
    assert tendon_strain(muscle.unit, 1.0, length) == pytest.approx(0.0, abs=1e-12)


def test_division_by_rho_keeps_the_published_normalized_length() -> None:
    """Published: l_fiber = l_opt + rho r dphi with a rigid tendon; in lengths of l_opt it is the same here."""
    published, soleus = BODY.document.muscles.soleus, ROWS["soleus"]
    assert published.ankle is not None
    for angle in (-0.5, -0.1, 0.2):
        excursion = muscles.compute_excursion(soleus.ankle, angle)
        fiber = (muscles.compute_unit_length(soleus, 0.0, 0.0, angle) - soleus.unit.slack_length) / (
            soleus.unit.optimal_length
        )
        assert fiber == pytest.approx(1.0 + published.rho * excursion / published.optimal_length_m)


def test_muscles_pull_the_way_their_names_say() -> None:
    """A positive arm lengthens with flexion or dorsiflexion, so the muscle extends or plantarflexes."""
    posture = {"hip": 0.3, "knee": 0.4, "ankle": 0.0}
    signs = {
        ("glutei", "hip"): 1, ("hip_flexors", "hip"): -1, ("hamstrings", "hip"): 1, ("hamstrings", "knee"): -1,
        ("vasti", "knee"): 1, ("gastrocnemius", "knee"): -1, ("gastrocnemius", "ankle"): 1, ("soleus", "ankle"): 1,
        ("tibialis_anterior", "ankle"): -1,
    }  # fmt: skip
    for name, muscle in ROWS.items():
        for joint, angle in posture.items():
            arm = muscles.compute_arm(getattr(muscle, joint), angle)
            assert np.sign(arm) == signs.get((name, joint), 0), (name, joint)
    assert isinstance(ROWS["soleus"].unit, MuscleTendon)


def test_missing_limb_is_missing() -> None:
    intact = build_walker_model(BODY, None)
    amputee = build_walker_model(BODY, Prosthesis(device=DEVICE))
    assert float(intact.body_mass.sum()) == pytest.approx(75.0)
    lost = float(intact.body_subtreemass[intact.body("shank_right").id])
    gained = float(amputee.body_subtreemass[amputee.body("shank_right").id])
    assert float(amputee.body_mass.sum()) == pytest.approx(75.0 - lost + gained)
    assert gained == pytest.approx(1.5 + 1.9)
    assert (intact.nq, amputee.nq) == (9, 10)


def test_all_soles_and_all_ground_share_one_contact() -> None:
    model = build_walker_model(BODY, Prosthesis(device=DEVICE), ground=Ground(unevenness=0.01, seed=3))
    touching = [g for g in range(model.ngeom) if model.geom_contype[g]]
    for array in (model.geom_solref, model.geom_solimp, model.geom_friction, model.geom_priority):
        assert (array[touching] == array[touching[0]]).all()
    assert get_contact(model) == get_contact(build_walker_model(BODY, None))
    heights = [model.geom_pos[g, 2] + 0.1 for g in touching if model.geom(g).name.startswith("block")]
    assert 0.0 <= min(heights) < max(heights) <= 0.01


def test_alignment_turns_the_prosthesis_and_the_spring_foot_replaces_the_device() -> None:
    soft = Prosthesis(device=DEVICE, spring_foot=SpringFoot(stiffness=math.degrees(8.0)), alignment=0.05)
    assert soft.get_alignment() == 0.05
    model = build_walker_model(BODY, soft)
    assert float(model.joint("prosthesis_ankle").stiffness[0]) == pytest.approx(math.degrees(8.0))
    assert Prosthesis(device=DEVICE).get_alignment() == 0.0


def test_refusals_name_the_range() -> None:
    with pytest.raises(InputError, match="slope is 11; allowed"):
        Ground(slope=math.radians(11.0))
    with pytest.raises(InputError, match="unevenness is 60; allowed: 0 to 50 mm"):
        Ground(unevenness=0.06)
    with pytest.raises(InputError, match="time step is 2 ms"):
        build_walker_model(BODY, None, dt=2e-3)


def test_digest_follows_numbers_and_neither_comments_nor_sources() -> None:
    path = body_module.__file__.replace("body.py", "body.toml")
    with open(path, "rb") as file:
        content = parse_toml(file.read(), path)
    document, segments = BODY.document, "<a><!-- one --> <b/></a>"
    digest = body_module._hash_numbers(document, segments)
    assert digest == body_module._hash_numbers(document.model_copy(update={"sources": {}}), "<a> <b/></a>")
    content["nerves"]["hip_delay_ms"] = 6.0
    other = body_module.BodyDocument.model_validate(content)
    assert digest != body_module._hash_numbers(other, segments)
    assert replace(BODY, digest=digest).digest == digest


def test_digest_follows_what_moves_and_not_what_is_seen() -> None:
    document = BODY.document
    segments = (models.get_models_folder() / body_module.SEGMENT_FILE).read_text("utf-8")
    assert body_module._hash_numbers(document, segments) == BODY.digest
    for seen, other in (
        ("fovy=", "ipd="),
        ('<geom name="head"', '<geom name="hat"'),
        ('rgba="0.3', 'rgba="0.9'),
        (' pos="0 0 -0.926"', ' pos="0 0 -0.9"'),  # the floor of built models is at 0
        ('qpos="0 -0.046', 'qpos="0 0'),
    ):
        assert seen in segments
        assert body_module._hash_numbers(document, segments.replace(seen, other)) == BODY.digest
    for moves, other in (
        ('mass="50.15625"', 'mass="50"'),
        ('size="0.022"', 'size="0.02"'),
        ('"0.3 0.95', '"0.9 0.95'),
        ('size="200', 'size="9'),
    ):
        assert moves in segments
        assert body_module._hash_numbers(document, segments.replace(moves, other)) != BODY.digest
