"""The gait run of the Python API says what differs from the request."""

import pytest

import klute_sim as ks


def test_step_that_does_not_divide_the_stride_is_reported() -> None:
    run = ks.simulate_gait(strides=1, time_step=7e-4)
    assert run.recording.provenance["options"]["stride_time_s"] == pytest.approx(1571 * 7e-4)
    assert run.warnings == (
        "A stride takes 1.0997 s instead of the 1.1 s of the reference, because it has a whole number of time steps of "
        "0.7 ms; a step that divides it keeps it.",
    )


@pytest.mark.parametrize("options", [{"time_step": 1e-3}, {"time_step": 7e-4, "speed": 1.2}])
def test_step_that_divides_the_stride_or_a_given_speed_needs_no_remark(options: dict[str, float]) -> None:
    assert ks.simulate_gait(strides=1, **options).warnings == ()  # type: ignore[arg-type]
