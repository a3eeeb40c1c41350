"""Direct measurements that separate equivalent models: a tape, calipers or a known weight in place of another run.

Where no experiment separates a wrong number from an effect, the number itself can be measured. Each equivalent model
expects a value of it, and the others expect the declared one.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.datasets.mechanism import is_model_number
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.effects.effect import EffectParameter
from klute_sim.units import split_unit

DECISIVE_RATIO = 4.0
"""Smallest difference between the expected values, in standard errors of the comparison, that is worth a measurement
(assumed)."""


class MeasurementMethod(NamedTuple):
    """How a quantity is measured directly; the accuracies are standard deviations, and assumed."""

    instruction: str
    """What to do, as a command."""
    absolute: float = 0.0
    """Part of the accuracy that does not depend on the value, in the unit of the quantity."""
    relative: float = 0.0
    """Part of the accuracy in proportion to the value."""

    def compute_accuracy(self, value: float) -> float:
        """Return the accuracy at ``value``, in its unit; both parts add."""
        return self.absolute + self.relative * abs(value)


_PIN_GAUGE = MeasurementMethod("Measure the orifice with pin gauges", 0.01)
NUMBER_METHODS: Mapping[str, MeasurementMethod] = {
    "muscle.resting_length_mm": MeasurementMethod("Measure the muscle at rest between its crimped ends", 0.3),
    "muscle.braid_length_ratio": MeasurementMethod(
        "Uncoil a thread of the braid and measure its length per length of muscle", 0.0, 2e-3
    ),
    "muscle.turns_per_m": MeasurementMethod("Count the turns of a thread over the whole muscle", 0.0, 5e-3),
    "muscle.bladder_radius_mm": MeasurementMethod("Measure the bladder with calipers", 0.05),
    "muscle.bladder_thickness_mm": MeasurementMethod("Measure the wall of the bladder with calipers", 0.03),
    "damper.bore_mm": MeasurementMethod("Measure the bore with an internal micrometer", 0.01),
    "damper.orifice_concentric_mm": _PIN_GAUGE,
    "damper.orifice_eccentric_mm": _PIN_GAUGE,
    "damper.oil_density_kg_m3": MeasurementMethod("Weigh a known volume of the oil", 0.0, 2e-3),
    "tendon.slack_length_mm": MeasurementMethod("Measure the tendon, just taut, with a steel rule", 0.3),
    "tendon.engagement_mm": MeasurementMethod(
        "Measure with a gauge the stretch at which the second spring engages", 0.1
    ),
    "mounting.neutral_muscle_ratio": MeasurementMethod(
        "Measure the muscle with the ankle at neutral and the tendon just taut, over its resting length", 1.5e-3
    ),
    "supply.gas_temperature_c": MeasurementMethod("Read a thermometer in the supply", 0.5),
    "supply.dead_volume_cm3": MeasurementMethod("Fill tubes and fittings with water, and weigh it", 0.0, 0.01),
    "supply.pressure_bar": MeasurementMethod("Read a reference gauge at the supply", 0.0, 3e-3),
}
"""``section.key`` of the device file -> how to measure it."""
_STEEL_RULE = MeasurementMethod("Measure the position with a steel rule", 5e-4)
MODEL_NUMBER_METHODS: Mapping[str, tuple[MeasurementMethod, str]] = {
    "mass": (MeasurementMethod("Weigh the part", 0.0, 2e-3), "kg"),
    **dict.fromkeys(("pos_x", "pos_y", "pos_z"), (_STEEL_RULE, "m")),
}
"""Number of an MJCF model -> how to measure it, and its unit."""
EFFECT_METHODS: Mapping[tuple[str, str], MeasurementMethod] = {
    ("oil_temperature", "temperature_c"): MeasurementMethod("Read a thermometer in the oil", 1.0),
    ("hose", "length_m"): MeasurementMethod("Measure the hose between regulator and muscle with a tape", 0.02, 0.01),
    ("rod_side_area", "rod_diameter_mm"): MeasurementMethod("Measure the rod of the damper with calipers", 0.05),
    ("tendon_slack", "slack_mm"): MeasurementMethod(
        "Measure with a steel rule how far the tendon can be pulled by hand before it is taut", 0.3
    ),
    ("pulley_error", "gain"): MeasurementMethod("Measure the pulley with calipers, relative to the model", 5e-3),
    ("gravity_tilt", "tilt_deg"): MeasurementMethod("Put a spirit level on the frame", 0.1),
    ("moment_arm_error", "gain"): MeasurementMethod(
        "Measure the moment arm with a steel rule, relative to the model", 0.02
    ),
    ("return_spring_error", "gain"): MeasurementMethod("Load the return spring with known weights", 0.02),
    ("return_spring_error", "shift_deg"): MeasurementMethod("Measure the resting angle with a protractor", 0.3),
}
"""(effect, key of its parameter) -> how to measure it."""
_ANGLE_STANDARD = "a protractor or an inclinometer"
CHANNEL_STANDARDS: Mapping[str, str] = {
    "force": "a known weight",
    "pressure": "a reference gauge",
    "muscle_length": "gauge blocks",
    "position": "gauge blocks",
    "angle": _ANGLE_STANDARD,
    "ankle_angle": _ANGLE_STANDARD,
}
"""Quantity of a channel -> what its instrument is compared with."""
GAIN_ACCURACY = 5e-3
"""Accuracy of the gain of an instrument compared with a standard (assumed)."""


class DirectMeasurement(NamedTuple):
    """A quantity that one model expects to be other than declared, and how to measure it."""

    name: str
    """Effect or number, as ``--exclude`` takes it."""
    quantity: str
    """Key of the number or of the effect's parameter."""
    method: MeasurementMethod
    """How to measure it."""
    expected: float
    """Value with this name in the model, in ``unit``."""
    otherwise: float
    """Value without it, in ``unit``."""
    unit: str
    """Unit; '' for a ratio."""
    standard_error: float
    """Standard error of the expected value in the fit, in the unit."""

    @property
    def accuracy(self) -> float:
        """Accuracy of the measurement, in the unit."""
        return self.method.compute_accuracy(self.otherwise)

    @property
    def is_decisive(self) -> bool:
        """Whether the measurement tells both values apart, although the fit does not know the expected one exactly."""
        return abs(self.expected - self.otherwise) >= DECISIVE_RATIO * math.hypot(self.accuracy, self.standard_error)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``verdict.json``."""
        unit = f" {self.unit}" if self.unit else ""
        sentence = (
            f"{self.method.instruction}: {self.expected:.4g}{unit} confirms {self.name}, {self.otherwise:.4g}{unit} "
            f"refutes it (an accuracy of {self.accuracy:.2g}{unit} is assumed)."
        )
        return {
            "name": self.name,
            "quantity": self.quantity,
            "expected": self.expected,
            "otherwise": self.otherwise,
            "accuracy": self.accuracy,
            "unit": self.unit,
            "sentence": sentence,
        }


def list_direct_measurements(fits: Sequence[Fit]) -> list[DirectMeasurement]:
    """Return the decisive direct measurements of what some of the equivalent ``fits`` contain and others do not."""
    sets = [{term.identity for term in fit.hypothesis.terms} for fit in fits]
    shared = set.intersection(*sets) if sets else set()
    found: dict[str, DirectMeasurement] = {}
    for fit in fits:
        for index, term in enumerate(fit.hypothesis.terms):
            if term.identity not in shared:
                for measurement in _iterate_measurements(fit, index, term):
                    if measurement.is_decisive:
                        found.setdefault(measurement.name, measurement)
    return list(found.values())


def _iterate_measurements(fit: Fit, index: int, term: EffectTerm) -> Iterator[DirectMeasurement]:
    covariance = np.linalg.pinv(fit.jacobian.T @ fit.jacobian)
    standard_errors = np.sqrt(np.maximum(0.0, np.diag(covariance)))
    values = {
        parameter.name: (parameter.initial, value, abs(parameter.denormalize(x + error) - value))
        for parameter, value, x, error in zip(
            fit.hypothesis.parameters, fit.values, fit.x.tolist(), standard_errors.tolist(), strict=True
        )
        if parameter.term_index == index
    }
    if term.number is not None:
        if is_model_number(term.number):
            method, unit = MODEL_NUMBER_METHODS.get(term.number.rpartition(".")[2], (None, ""))
        else:
            method, unit = NUMBER_METHODS.get(term.number), split_unit(term.number)[1]
        if method is not None:
            declared, expected, error = values[term.number]
            yield DirectMeasurement(term.qualified_name, term.number, method, expected, declared, unit, error)
        return
    for parameter in term.parameters:
        method = _find_method(term, parameter)
        if method is not None and parameter.neutral is not None:
            name, key, unit = term.qualified_name, parameter.key, split_unit(parameter.key)[1]
            _, expected, error = values[key]
            yield DirectMeasurement(name, key, method, expected, parameter.neutral, unit, error)


def _find_method(term: EffectTerm, parameter: EffectParameter) -> MeasurementMethod | None:
    if term.channel is None:
        return EFFECT_METHODS.get((term.effect, parameter.key))
    quantity = next((q for q in CHANNEL_STANDARDS if term.channel == q or term.channel.startswith(f"{q}_")), None)
    if term.effect != "sensor_gain" or quantity is None:
        return None
    instruction = f"Compare the reading of '{term.channel}' with {CHANNEL_STANDARDS[quantity]}"
    return MeasurementMethod(instruction, GAIN_ACCURACY)
