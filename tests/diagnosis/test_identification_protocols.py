"""Identification protocols keep the limits of every device and excite what they should."""

import math
from itertools import pairwise

import numpy as np
import pytest

from klute_sim.bench.protocols.excitation import ExcitationTrajectory, compute_limits
from klute_sim.bench.protocols.identification import SAMPLE_INTERVAL, IdentificationProtocol, Program
from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.bench.trajectory import sample_staircase
from klute_sim.device.device import Device, list_presets, load_device, parse_device
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.laws import damper
from klute_sim.laws.mckibben import lock_length
from klute_sim.units import BAR

TIME_STEP = 2.5e-4
PROTOCOLS = load_identification_protocols()
ALL_PRESETS = pytest.mark.parametrize("name", list_presets())
ALL_PROTOCOLS = pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=lambda p: p.name)


def change_preset(name: str, **numbers: float) -> Device:
    """A preset with other numbers."""
    lines = load_device(name).content.decode().splitlines()
    for key, value in numbers.items():
        (at,) = (k for k, line in enumerate(lines) if line.startswith(f"{key} ="))
        lines[at] = f"{key} = {value!r}"
    return parse_device("\n".join(lines).encode(), "change_preset")


OTHERS = (
    change_preset("klute-3-4-pair", resting_length_mm=1900.0),
    change_preset("klute-3-4", resting_length_mm=20.0),
    change_preset("klute-3-4-pair", pressure_bar=20.0),
    change_preset("klute-3-4-pair", pressure_bar=0.5, rate_bar_per_s=0.2),
    change_preset("klute-3-4-pair", braid_length_ratio=1.7, turns_per_m=34.2),  # locks close to its resting length
)


def check_limits(program: Program, device: Device) -> None:
    muscle, tendon, supply = device.parameters.muscle, device.parameters.tendon, device.parameters.supply
    time, length, command = program
    assert len(time) == len(length) == len(command)
    np.testing.assert_allclose(np.diff(time), 0.005, atol=1e-12)
    assert time[0] == 0.0
    assert np.isfinite(length).all()
    assert np.isfinite(command).all()
    assert 4.0 <= time[-1] <= 8.0
    assert length.max() <= tendon.slack_length + muscle.resting_length
    assert length.min() > tendon.slack_length + lock_length(muscle)
    assert command.min() >= 0.0
    assert command.max() <= 0.95 * supply.max_pressure
    still = time < 0.5 - 1e-9
    assert np.ptp(length[still]) == 0.0
    assert np.ptp(command[still]) == 0.0
    speed, acceleration = np.diff(length) / SAMPLE_INTERVAL, np.diff(length, 2) / SAMPLE_INTERVAL**2
    assert np.abs(speed).max() <= 0.35
    assert np.abs(acceleration).max() <= 10.0 + 1e-6
    assert speed.min() < -0.5 * speed.max() < 0.0  # both ways, and fast
    assert speed.max() > -0.5 * speed.min()
    assert abs(speed[-1]) < 1e-9  # at rest at the end
    assert np.ptp(command) > 0.2 * supply.max_pressure


@ALL_PRESETS
@ALL_PROTOCOLS
def test_limits(name: str, protocol: IdentificationProtocol) -> None:
    check_limits(protocol.build_program(load_device(name)), load_device(name))


@ALL_PROTOCOLS
def test_limits_of_unusual_devices(protocol: IdentificationProtocol) -> None:
    for device in OTHERS:
        check_limits(protocol.build_program(device), device)


def parse_part(text: str) -> Device:
    """A device without a muscle."""
    return parse_device(f'name = "part"\n{text}'.encode(), "part")


TENDON = "[tendon]\nslack_length_mm = 100\nstiffness_1_n_per_mm = {}\nstiffness_2_n_per_mm = {}\nengagement_mm = {}\n"
CYLINDER = "[cylinder]\nextended_length_mm = {}\nstroke_mm = {}\n"
DAMPER = "[damper]\nbore_mm = 20\norifice_concentric_mm = {}\norifice_eccentric_mm = 1.0\noil_density_kg_m3 = 900\n"


@pytest.mark.parametrize(
    ("numbers", "stretch"),
    [((60, 0, 40), 1000 / 60), ((60, 140, 5), 8.5), ((10, 20, 2), 4.0), ((10, 20, 0), 10.0), ((5000, 0, 100), 0.2)],
)
def test_tendon_alone_is_stretched_from_its_slack_length_as_far_as_it_may(
    numbers: tuple[float, ...], stretch: float
) -> None:
    device = parse_part(TENDON.format(*numbers))
    for name in ("ramps", "sines", "release", "hold", "slack", "mixed"):
        time, length, command = PROTOCOLS[name].build_program(device)
        assert (length[time < 0.5] == 0.1).all(), name
        assert length.min() == 0.1
        assert 0.65 * stretch < 1e3 * length.max() - 100.0 <= stretch + 1e-6, name
        assert not command.any()
    with pytest.raises(InputError, match=r"^protocol 'steps' steps the pressure, but 'part' has no \[supply\]"):
        PROTOCOLS["steps"].build_program(device)


@pytest.mark.parametrize(("extended", "stroke"), [(200, 100), (400, 5), (200, 30)])
@pytest.mark.parametrize("orifice", [5.0, 0.5])
def test_cylinder_alone_stays_between_its_stops_and_below_the_force_of_its_damper(
    extended: float, stroke: float, orifice: float
) -> None:
    device = parse_part(CYLINDER.format(extended, stroke) + DAMPER.format(orifice))
    for name in ("ramps", "sines", "release", "hold", "mixed"):
        _, length, _ = PROTOCOLS[name].build_program(device)
        assert extended - 0.9 * stroke - 1e-9 <= 1e3 * length.min()
        assert 1e3 * length.max() <= extended - 0.1 * stroke + 1e-9
        speed = np.abs(np.diff(length)).max() / SAMPLE_INTERVAL
        assert 0.0 < speed <= 0.3 + 1e-9
        assert max(abs(damper.force(device.parameters.damper, v)) for v in (speed, -speed)) <= 1000.0 + 1e-6
    with pytest.raises(InputError, match=r"^protocol 'slack' slackens a muscle or a tendon, but 'part' has neither"):
        PROTOCOLS["slack"].build_program(device)


@ALL_PRESETS
def test_pressures_are_below_and_above_two_bar(name: str) -> None:
    for protocol in PROTOCOLS.values():
        command = protocol.build_program(load_device(name)).command
        assert command.min() < 1.5 * BAR, protocol.name
        assert command.max() > 2.0 * BAR, protocol.name


def simulate_program(program: Program, device: Device) -> RolloutTrace:
    fine = TIME_STEP * np.arange(1, round(program.time[-1] / TIME_STEP) + 1)
    length, command = (np.interp(fine, program.time, x) for x in program[1:])
    start = compute_equilibrium_state(device.parameters, float(length[0]), float(command[0]))
    return simulate_rollouts(device.parameters, length, command, TIME_STEP, initial_state=start)


@pytest.mark.parametrize("name", [n for n in list_presets() if not load_device(n).parameters.tendon.is_rigid])
@ALL_PROTOCOLS
def test_muscle_stays_clear_of_stops_and_tendon_is_mostly_taut(name: str, protocol: IdentificationProtocol) -> None:
    device = load_device(name)
    muscle = device.parameters.muscle
    found = simulate_program(protocol.build_program(device), device)
    assert found.length.max() < muscle.resting_length
    assert found.length.min() > 1.05 * lock_length(muscle)
    loose = float(np.mean(found.tension <= 0.0))
    assert loose < 0.4
    if protocol.name == "slack":
        taut = found.tension > 0.0
        assert loose > 0.2
        assert np.count_nonzero(np.diff(taut.astype(int)) == 1) >= 2  # it becomes taut again, twice


@ALL_PRESETS
def test_protocols_start_at_rest(name: str) -> None:
    for protocol in PROTOCOLS.values():
        found = simulate_program(protocol.build_program(load_device(name)), load_device(name))
        early = found.tension[: round(0.49 / TIME_STEP)]
        assert np.ptp(early) < 1e-3 * max(1.0, np.abs(found.tension).max()), protocol.name


def list_pressure_levels(program: Program) -> np.ndarray:
    """Pressures [bar] that are stepped to."""
    return np.unique(np.round(program.command / BAR, 3))


def test_pressure_steps_are_at_three_lengths() -> None:
    _, length, command = PROTOCOLS["steps"].build_program(load_device("klute-3-4-pair"))
    jumps = np.flatnonzero(np.abs(np.diff(command)) > 0.5 * BAR)
    lengths = np.unique(np.round(1e3 * length[jumps], 1))
    assert len(lengths) == 3
    for one in lengths:
        levels = command[jumps + 1][np.round(1e3 * length[jumps], 1) == one]
        assert np.sum(levels < 2 * BAR) >= 2
        assert np.sum(levels > 2 * BAR) >= 2
    assert np.abs(np.diff(length))[jumps].max() == 0.0


def list_moves(program: Program) -> list[tuple[float, float, float]]:
    """(signed top speed [m/s], way [m], mean pressure [Pa]) of every move."""
    speed = np.diff(program.unit_length) / SAMPLE_INTERVAL
    sign = np.sign(np.where(np.abs(speed) < 1e-7, 0.0, speed))
    edges = np.flatnonzero(np.diff(np.concatenate([[0.0], sign, [0.0]])))
    found = []
    for a, b in pairwise(edges):
        if b > a and sign[a] != 0.0:
            top = float(speed[a:b][np.abs(speed[a:b]).argmax()])
            found.append((top, float(abs(speed[a:b].sum()) * SAMPLE_INTERVAL), float(program.command[a:b].mean())))
    return found


def test_ramps_go_both_ways_slow_and_fast() -> None:
    found = list_moves(PROTOCOLS["ramps"].build_program(load_device("klute-3-4-pair")))
    for sign in (-1, 1):
        speeds = sorted(sign * top for top, _, _ in found if sign * top > 0)
        assert len(speeds) == 5
        assert speeds[0] < 0.03
        assert speeds[-1] > 0.18
    assert len({round(pressure / BAR, 2) for _, _, pressure in found}) == 3


@ALL_PRESETS
def test_releases_are_quick(name: str) -> None:
    found = list_moves(PROTOCOLS["release"].build_program(load_device(name)))
    for sign in (-1, 1):
        assert max(sign * top for top, _, _ in found) > 0.28
    assert len({round(pressure / BAR, 2) for _, _, pressure in found}) == 3


def test_sines_have_four_frequencies() -> None:
    found = list_moves(PROTOCOLS["sines"].build_program(load_device("klute-3-4-pair")))
    assert len(found) == 2 * (1 + 2 + 4 + 6)
    assert all(way > 0.004 for _, way, _ in found)


def test_holds_last_seconds() -> None:
    _, length, command = PROTOCOLS["hold"].build_program(load_device("klute-3-4-pair"))
    still = np.concatenate([[0.0], np.abs(np.diff(length)) + np.abs(np.diff(command))]) < 1e-9
    runs = np.split(still, np.flatnonzero(~still))
    assert sum(len(r) * SAMPLE_INTERVAL > 1.9 for r in runs) >= 2


def test_mixed_steps_the_pressure_while_the_length_moves() -> None:
    device = load_device("klute-3-4-pair")
    program = PROTOCOLS["mixed"].build_program(device)
    speed = np.diff(program.unit_length) / SAMPLE_INTERVAL
    jumps = np.abs(np.diff(program.command)) > 0.2 * BAR
    assert np.sum(jumps & (np.abs(speed) > 0.01)) >= 8
    others = {
        float(x)
        for n, p in PROTOCOLS.items()
        if n not in ("mixed", "slack")
        for x in list_pressure_levels(p.build_program(device))
    }
    assert len({float(x) for x in list_pressure_levels(program)} - others) >= 3  # levels of its own
    assert len({round(abs(top), 2) for top, _, _ in list_moves(program)}) >= 6


def test_uses_and_revealed_effects_are_complete() -> None:
    assert {p.use for p in PROTOCOLS.values()} == {"fit", "validation", "test"}
    assert PROTOCOLS["mixed"].use == "test"
    named = {effect for p in PROTOCOLS.values() for effect in p.revealed_effects}
    assert named <= set(catalogue.get_effects())
    assert {n for n, e in catalogue.get_named_effects().items() if e.kind == "device"} <= named
    for name, protocol in PROTOCOLS.items():
        assert name == protocol.name
        assert protocol.description.endswith(".")


def test_muscle_that_cannot_contract_is_refused() -> None:
    ratio = 1.7316
    turns = 1e3 * math.sqrt(ratio**2 - 1) / (2 * math.pi * 6.4)
    device = change_preset("klute-3-4-pair", braid_length_ratio=ratio, turns_per_m=turns)
    with pytest.raises(InputError, match=r"^device 'klute-3-4-pair' cannot be tested: its muscle locks 0\.06\d* mm"):
        compute_limits(device)


def test_move_to_the_same_length_takes_no_time() -> None:
    trajectory = ExcitationTrajectory(0.3, 0.5).move(0.3, 0.1).hold(0.0512)
    time, length = trajectory.sample(SAMPLE_INTERVAL)
    program = Program(time, length, sample_staircase(time, ((0.0, 1e5), (0.52, 2e5))))
    assert program.time[-1] == pytest.approx(0.555)
    assert (program.unit_length == 0.3).all()
    assert program.command[103] == 1e5
    assert program.command[104] == 2e5


def test_move_is_exact() -> None:
    trajectory = ExcitationTrajectory(0.3, 0.5).move(0.31, 0.05, 2.0)
    assert trajectory.end_time == pytest.approx(0.5 + 0.01 / 0.05 + 0.05 / 2.0)
    time, length = trajectory.hold(0.1).sample(SAMPLE_INTERVAL)
    program = Program(time, length, sample_staircase(time, ((0.0, 0.0),)))
    assert program.unit_length[-1] == 0.31
    assert np.diff(program.unit_length).max() == pytest.approx(0.05 * SAMPLE_INTERVAL, rel=1e-9)
    assert program.unit_length[np.searchsorted(program.time, 0.6)] == pytest.approx(
        0.3 + 0.05 * (0.1 - 0.5 * 0.05 / 2.0), abs=1e-12
    )
