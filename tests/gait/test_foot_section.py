"""Feet in the model: bench tests measure what the section states, effects act on top, and every foot walks."""

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.device.device import load_device, parse_device
from klute_sim.device.schema.foot import FootSection, list_feet
from klute_sim.errors import InputError
from klute_sim.gait.body import read_foot
from klute_sim.gait.foot_bench import compute_loss, press_foot
from klute_sim.gait.foot_section import KEEL_CYCLE_TIME, bend_keel, get_hinge
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.laws.loading_cycle import CyclicStiffness, part_of_spring_and_dashpot

PLAIN = load_device("klute-1-1-4-pair")
ELASTIC_FEET = [name for name in list_feet() if name != "rigid"]
ALL_FEET = [*list_feet(), *(f"{name}+shoe" for name in list_feet())]
MAX_LOAD_ERROR_BW = 0.04
"""Largest load error in stance of any foot in the default walk [body weights]."""


def get_section(name: str) -> FootSection:
    section = PLAIN.with_foot(name).spec.foot
    assert section is not None
    return section


@pytest.mark.parametrize("shoe", [pytest.param("", marks=pytest.mark.slow), "+shoe"])
@pytest.mark.parametrize("name", ELASTIC_FEET)
def test_bench_measures_what_the_section_states(name: str, shoe: str) -> None:
    section = get_section(name + shoe)
    stated = {"heel": section.get_heel(CyclicStiffness(1.0, 0.0)), "forefoot": section.get_forefoot()}
    for part, expected in stated.items():
        assert expected is not None
        measured = press_foot(PLAIN.with_foot(name + shoe), part)
        assert measured.stiffness == pytest.approx(expected.stiffness, rel=0.05), part
        assert measured.loss == pytest.approx(expected.loss, abs=0.05), part


def test_lever_of_the_presets_is_that_of_the_sole() -> None:
    lever = press_foot(PLAIN.with_foot("dynamic-response-high"), "forefoot").lever
    assert lever == pytest.approx(0.130, abs=0.002)


@pytest.mark.parametrize("lever_mm", [80.0, 150.0])
def test_another_lever_changes_the_hinge_and_not_the_measured_stiffness(lever_mm: float) -> None:
    device = PLAIN.with_foot("dynamic-response-medium").with_changes({"foot.keel_lever_mm": lever_mm})
    assert press_foot(device, "forefoot").stiffness == pytest.approx(52e3, rel=0.05)
    hinges = [get_hinge(spec) for spec in (device.spec.foot, get_section("dynamic-response-medium")) if spec]
    assert hinges[0] is not None
    assert hinges[1] is not None
    assert hinges[0].stiffness / hinges[1].stiffness == pytest.approx((lever_mm / 130.0) ** 2, rel=0.1)


@pytest.mark.parametrize("lever_mm", [80.0, 150.0])
@pytest.mark.parametrize(("stiffness", "loss"), [(10.0, 2.0), (10.0, 80.0), (300.0, 2.0)])
def test_ends_of_the_ranges_stay_finite_and_passive(lever_mm: float, stiffness: float, loss: float) -> None:
    changes = {"heel_stiffness_n_per_mm": 10.0, "heel_loss_pct": loss, "keel_loss_pct": loss}
    changes |= {"forefoot_stiffness_n_per_mm": stiffness, "keel_lever_mm": lever_mm}
    device = PLAIN.with_foot("sach").with_changes({f"foot.{key}": value for key, value in changes.items()})
    for part in ("heel", "forefoot"):
        result = press_foot(device, part)
        assert np.isfinite(result.stiffness)
        assert 0.0 < result.loss < 0.9


def test_slower_cycles_lose_less() -> None:
    """The dashpot states its loss for one duration only (docs/devices.md)."""
    device = PLAIN.with_foot("dynamic-response-low")
    losses = [press_foot(device, "forefoot", cycle_time=factor * KEEL_CYCLE_TIME).loss for factor in (1.0, 2.0)]
    assert 0.5 * losses[0] < losses[1] < 0.8 * losses[0]


def test_loss_of_an_ellipse_is_its_area_over_the_loading_curve() -> None:
    angle = 2.0 * np.pi * np.arange(1000) / 1000
    assert compute_loss(np.cos(angle), np.cos(angle)) == pytest.approx(0.0, abs=1e-9)
    lag = 0.3
    expected = np.pi * np.sin(lag) / (2.0 + 0.5 * np.pi * np.sin(lag))
    assert compute_loss(np.cos(angle), np.cos(angle - lag)) == pytest.approx(expected, abs=1e-3)


def test_rigid_keel_is_refused_by_its_bench_test() -> None:
    with pytest.raises(InputError, match="the keel of device 'klute-1-1-4-pair' is rigid"):
        press_foot(PLAIN, "forefoot")
    with pytest.raises(InputError, match="part of the foot is 'toe'; allowed: heel, forefoot"):
        press_foot(PLAIN, "toe")


def test_model_and_replay_have_the_keel_of_the_section() -> None:
    section, original = get_section("dynamic-response-low"), build_device_foot(PLAIN)
    foot = build_device_foot(PLAIN.with_foot("dynamic-response-low"))
    assert foot == pytest.approx(bend_keel(section, original), rel=1e-9)
    spring = 1.0 / foot.keel_compliance
    measured = part_of_spring_and_dashpot(spring, foot.keel_time_constant * spring, KEEL_CYCLE_TIME)
    assert measured == pytest.approx(get_hinge(section), rel=1e-6)


def test_effect_acts_on_top_of_the_foot() -> None:
    device, compliance = PLAIN.with_foot("dynamic-response-medium"), 0.05
    softer = device.with_effect("foot_stiffness", compliance_deg_per_n_m=compliance)
    feet = [build_device_foot(d) for d in (device, softer)]
    assert feet[1].keel_compliance - feet[0].keel_compliance == pytest.approx(np.radians(compliance))
    assert press_foot(softer, "forefoot").stiffness < 0.7 * press_foot(device, "forefoot").stiffness


def test_bumper_and_other_effects_go_with_a_foot() -> None:
    device = PLAIN.with_foot("sach").with_effect("end_stop", stiffness_n_m_per_deg=4.0, begin_deg=7.0)
    foot = build_device_foot(device)
    assert foot.bumper_stiffness == pytest.approx(np.degrees(4.0))
    assert press_foot(device, "heel").stiffness == pytest.approx(27e3, rel=0.05)


def test_rigid_foot_is_the_model_of_the_file() -> None:
    text = PLAIN.content.decode()
    models = [
        build_gait_model(parse_device(content.encode(), "x"), mass=75.0, stature=1.75, dt=5e-4)
        for content in (text, f"{text}\n[foot]\n", f'{text}\n[foot]\npreset = "rigid"\nshoe = false\n')
    ]
    for model in models[1:]:
        assert read_foot(model) == read_foot(models[0])
        for name in ("geom_solref", "geom_solimp", "geom_priority", "jnt_stiffness", "dof_damping", "body_mass"):
            assert np.array_equal(getattr(model, name), getattr(models[0], name)), name


def test_heel_stiffer_than_its_keel_is_refused() -> None:
    changes = {"foot.heel_stiffness_n_per_mm": 300.0, "foot.forefoot_stiffness_n_per_mm": 10.0}
    device = PLAIN.with_foot("sach").with_changes(changes)
    with pytest.raises(InputError, match="allowed: a softer heel or a stiffer forefoot"):
        build_gait_model(device, mass=75.0, stature=1.75, dt=5e-4)


def check_walk(run: ks.GaitRun) -> None:
    assert run.summary["grf_vertical_tracking_rms_bw"] <= MAX_LOAD_ERROR_BW
    assert not run.summary["contact_lost_in_stance"]
    assert not run.summary["touches_in_swing"]


@pytest.mark.slow
def test_elastic_foot_walks_and_says_so() -> None:
    run = ks.simulate_gait(foot="dynamic-response-medium+shoe", strides=2, time_step=1e-3)
    check_walk(run)
    assert run.summary["foot"] == "dynamic-response-medium+shoe"
    assert "foot.keel_loss_pct" in run.summary["assumptions"]
    assert "shoe" in run.summary["assumptions"]
    assert "Foot: dynamic-response-medium+shoe" in str(run)


@pytest.mark.slow
def test_softer_keels_take_more_from_the_push_off() -> None:
    """The walk that was tuned for a rigid keel loses moment on a soft one, and a shoe costs work."""
    names = ("dynamic-response-low", "dynamic-response-high", "dynamic-response-high+shoe")
    runs = [ks.simulate_gait(foot=name, strides=2, time_step=1e-3) for name in names]
    moments = [run.metrics["ankle_moment_peak_nm_per_kg"] or 0.0 for run in runs]
    work = [run.metrics["ankle_work_net_j_per_kg"] or 0.0 for run in runs]
    assert moments[0] < moments[1] - 0.05
    assert work[2] < work[1] - 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL_FEET)
def test_every_foot_carries_the_load_at_any_step(name: str) -> None:
    runs = [ks.simulate_gait(foot=name, strides=3, time_step=step) for step in (5e-4, 2.5e-4)]
    for run in runs:
        check_walk(run)
    peaks = [run.metrics["ankle_moment_peak_nm_per_kg"] or 0.0 for run in runs]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.02)
