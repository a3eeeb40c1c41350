"""Content of the blocks: what a dataset hides has the stated size and an influence."""

import numpy as np
import pytest
from benchmarks.hidden_effects import device, imperfect, inputs, plan, simulate

NOTHING = simulate.Hidden()


@pytest.mark.slow
def test_error_of_a_law_is_the_stated_fraction_of_the_range_of_the_force() -> None:
    law = device.build_neutral_law(device.load_device())
    programs = inputs.generate_programs(np.random.default_rng(7))[:2]
    signals = [simulate.simulate_measurements(program, law, NOTHING) for program in programs]
    error = imperfect.draw_law_error(np.random.default_rng(3))
    scaled = imperfect.scale_law_error(error, programs, signals)
    same = {**scaled, "gains": {"A": 1.0}}
    changed = [imperfect.add_law_error(row, program, same, "A") for row, program in zip(signals, programs, strict=True)]
    before, after = (np.concatenate([row["force"] for row in rows]) for rows in (signals, changed))
    assert scaled["rms_n"] == pytest.approx(error["fraction"] * imperfect.measure_range(before))
    is_pulling = (before > 0.0) & (after > 0.0)
    assert np.sqrt(np.mean((after - before)[is_pulling] ** 2)) == pytest.approx(scaled["rms_n"], rel=0.03)
    assert np.array_equal(after[before == 0.0], before[before == 0.0])


def test_faint_effects_outside_the_catalogue_have_both_sizes_of_each_kind() -> None:
    specs = plan.plan_datasets("faint_outside", plan.BLOCK_SIZES["faint_outside"], 1)
    for kind in ("strangers", "effects"):
        assert {effect["wanted"] for spec in specs for effect in spec.get(kind, ())} == {2.0, 0.7}


def test_wrong_temperature_of_the_gas_is_behind_a_valve() -> None:
    for spec in plan.plan_datasets("wrong_number", plan.BLOCK_SIZES["wrong_number"], 1):
        is_temperature = spec["numbers"][0]["number"] == "supply.gas_temperature_c"
        assert ("known" in spec) == is_temperature
