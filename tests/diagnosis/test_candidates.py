"""Which effects may be added to a fit: each once for a device, and only to a device that may lack it."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import SPECIMEN_NUMBERS, list_tendon_error_candidates
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.diagnosis.selection import candidates
from klute_sim.diagnosis.selection.candidates import (
    is_same_cause,
    list_device_terms,
    list_further_terms,
    select_quantizers,
)
from klute_sim.effects import catalogue
from klute_sim.errors import InputError

PAIR = load_device("klute-3-4-pair")
SLACK = "tendon.slack_length_mm"
FOR_ALL, SHAPED = EffectTerm("seal_friction", "coulomb"), EffectTerm("seal_friction", "stribeck")
FLEXOR, EXTENSOR = (EffectTerm("seal_friction", "coulomb", tendon=tendon) for tendon in ("flexor", "extensor"))
GAINS = [EffectTerm("sensor_gain", "linear", channel) for channel in ("force", "pressure")]


def make_fit(*terms: EffectTerm) -> Fit:
    hypothesis = Hypothesis(PAIR, (), (("force", 3.0), ("pressure", 1e3)), terms)
    x = hypothesis.initial_point()
    return Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, [])


@pytest.mark.parametrize(
    ("used", "further"),
    [(FOR_ALL, GAINS), (SHAPED, GAINS), (FLEXOR, [EXTENSOR, *GAINS]), (GAINS[0], [FLEXOR, EXTENSOR, SHAPED, GAINS[1]])],
)
def test_effect_of_all_tendons_is_not_added_to_one_of_them(used: EffectTerm, further: list[EffectTerm]) -> None:
    """The file of a device holds one form of an effect."""
    assert list_further_terms([FLEXOR, EXTENSOR, SHAPED, *GAINS], make_fit(used)) == further


def test_number_of_all_devices_is_not_corrected_in_one_of_them() -> None:
    """Of both devices and of one, the two corrections would share what one of them says."""
    of_all, of_flexor, of_extensor, other = (
        EffectTerm("number_error", "value", number=key)
        for key in (SLACK, f"flexor/{SLACK}", f"extensor/{SLACK}", "flexor/muscle.c10_kpa")
    )
    assert is_same_cause(of_all, of_flexor)
    assert is_same_cause(of_flexor, of_all)
    assert is_same_cause(of_flexor, of_flexor)
    assert not is_same_cause(of_flexor, of_extensor)
    assert not is_same_cause(of_all, other)


def test_numbers_of_single_devices_are_candidates_where_there_are_several() -> None:
    devices = {"flexor": PAIR, "extensor": PAIR.with_changes({SLACK: 101.0})}
    numbers = list_tendon_error_candidates(devices, {f"flexor/{SLACK}"})
    assert numbers[f"extensor/{SLACK}"] == 101.0
    assert f"flexor/{SLACK}" not in numbers
    assert len(numbers) == 2 * len(SPECIMEN_NUMBERS) - 1
    assert list_tendon_error_candidates({"flexor": PAIR}, ()) == {}


def test_effect_is_no_candidate_for_a_tendon_whose_device_cannot_lack_it() -> None:
    leaking = parse_device(PAIR.content + b"\n[effects.leak]\nconductance_dm3_per_s_bar = 0.01\n", "leaking")
    leak = catalogue.get_effects()["leak"]
    for_all, flexor, extensor = (
        EffectTerm("leak", "orifice"),
        *(EffectTerm("leak", "orifice", tendon=tendon) for tendon in ("flexor", "extensor")),
    )
    assert list_device_terms(leak, PAIR, {"flexor": PAIR, "extensor": PAIR}) == [for_all, flexor, extensor]
    assert list_device_terms(leak, PAIR, {"flexor": leaking, "extensor": PAIR}) == [extensor]
    assert list_device_terms(leak, leaking, {"flexor": PAIR, "extensor": leaking}) == [flexor]
    assert list_device_terms(leak, PAIR, {"only": leaking}) == []
    assert list_device_terms(leak, PAIR, {}) == [for_all]
    assert list_device_terms(leak, leaking, {}) == []


@pytest.mark.parametrize(
    ("only", "exclude", "named"),
    [
        ((), (), ["force", "pressure"]),
        ((), ("quantisation",), []),
        ((), ("quantisation@force",), ["pressure"]),
        (("seal_friction",), (), []),
        (("seal_friction", "quantisation@force"), (), ["force"]),
    ],
)
def test_quantized_channels_are_named_as_any_other_candidate(
    only: tuple[str, ...], exclude: tuple[str, ...], named: list[str]
) -> None:
    quantizers = dict.fromkeys(("force", "pressure"), Quantizer(1.0, 0.01, 0.0, 0.1))
    assert list(select_quantizers(quantizers, only, exclude)) == named


def test_candidates_that_are_judged_apart_may_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Quantisation and the number of one specimen, as verdict.json names them."""
    monkeypatch.setattr(candidates, "_list_all_terms", lambda *_: [FOR_ALL])
    own = {"a": PAIR, "b": PAIR.with_changes({"tendon.slack_length_mm": 101.0})}
    experiments = [SimpleNamespace(specimen=name, device=device) for name, device in own.items()]
    data = cast(Any, SimpleNamespace(noise={"force": None}, experiments=experiments))
    dataset = cast(Any, SimpleNamespace(rig="bench", device=PAIR))
    names = ("quantisation@force", "number_error@tendon.slack_length_mm@b")
    for name in names:
        assert candidates.list_candidate_terms(data, dataset, exclude=(name,)) == [FOR_ALL]
        assert candidates.list_candidate_terms(data, dataset, only=(name,)) == []
    for name in ("quantisation@pressure", "number_error@tendon.slack_length_mm@c"):
        with pytest.raises(InputError, match="no candidate"):
            candidates.list_candidate_terms(data, dataset, exclude=(name,))


@pytest.mark.parametrize(("flexor_leaks", "extensor_leaks"), [(True, False), (False, True), (True, True)])
def test_effect_may_be_tested_where_one_device_lacks_it(flexor_leaks: bool, extensor_leaks: bool) -> None:
    leaking = parse_device(PAIR.content + b"\n[effects.leak]\nconductance_dm3_per_s_bar = 0.01\n", "leaking")
    devices = {"flexor": leaking if flexor_leaks else PAIR, "extensor": leaking if extensor_leaks else PAIR}
    mechanism = SimpleNamespace(devices=devices)
    options = {"rig": "mjcf", "device": devices["flexor"], "model_values": {}, "uncertainties": {}}
    dataset = cast(Any, SimpleNamespace(**options, mechanism=mechanism))
    if flexor_leaks and extensor_leaks:
        with pytest.raises(InputError, match="has effect 'leak' already"):
            candidates.check_effect_names(dataset, ("leak",), ())
    else:
        candidates.check_effect_names(dataset, ("leak",), ())
