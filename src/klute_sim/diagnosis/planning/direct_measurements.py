"""Direct measurements that separate equivalent models: a tape, calipers or a known weight in place of another run.

Where no experiment separates a wrong number from an effect, the number itself can be measured. Each equivalent model
expects a value of it, and the others expect the declared one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, is_model_number
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import LENGTH_ZERO
from klute_sim.units import split_unit

DECISIVE_RATIO = 4.0
"""Smallest distance of the value without a name from the values with it, over the accuracy, that is worth a measurement
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
    # A reading to a twentieth of a turn has a standard deviation of 0.014 turns, and a muscle has 1.5 to 2 turns.
    "muscle.turns_per_m": MeasurementMethod(
        "Count the turns of a thread over the whole muscle at rest to a twentieth, and divide by its length in metres",
        0.0,
        1e-2,
    ),
    "muscle.bladder_radius_mm": MeasurementMethod("Measure half the outer diameter of the bladder with calipers", 0.05),
    "muscle.bladder_thickness_mm": MeasurementMethod("Measure the wall of the bladder with calipers", 0.03),
    LENGTH_ZERO: MeasurementMethod(
        "Measure the muscle in the machine with calipers, and take what the machine shows above that", 0.1
    ),
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
    ("rod_side_area", "rod_diameter_mm"): MeasurementMethod(
        "Measure the rod of the damper with calipers, and take 0 if it passes through both ends", 0.05
    ),
    ("tendon_slack", "slack_mm"): MeasurementMethod(
        "Measure with a steel rule how far the tendon can be pulled by hand before it is taut", 0.3
    ),
    ("pulley_error", "gain"): MeasurementMethod("Measure the pulley with calipers, relative to the model", 5e-3),
    ("gravity_tilt", "tilt_deg"): MeasurementMethod("Put a spirit level on the frame", 0.1),
    ("moment_arm_error", "gain"): MeasurementMethod(
        "Measure the moment arm with a steel rule, relative to the model", 0.02
    ),
    ("return_spring_error", "gain"): MeasurementMethod(
        "Load the return spring with known weights, and divide its stiffness by that of the model", 0.02
    ),
    ("return_spring_error", "shift_deg"): MeasurementMethod(
        "Measure with a protractor how much further in dorsiflexion the unloaded ankle rests than the return spring "
        "of the model",
        0.3,
    ),
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


CHANNEL_ZEROS: Mapping[str, MeasurementMethod] = {
    "force": MeasurementMethod("Unload the cell of '{}' and read it", 0.5),
    "pressure": MeasurementMethod("Vent the muscle and read '{}'", 0.01),
    **dict.fromkeys(
        ("angle", "ankle_angle"),
        MeasurementMethod("Compare the reading of '{}' with a protractor or an inclinometer", 0.2),
    ),
}
"""Quantity of a channel -> how to read the zero of its instrument; accuracies in N, bar and degrees (assumed)."""


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
    interval: tuple[float, float]
    """Its 95 % confidence interval, in ``unit``."""
    otherwise: float
    """Value without it, in ``unit``."""
    unit: str
    """Unit; '' for a ratio."""

    @property
    def accuracy(self) -> float:
        """Accuracy of the measurement, in the unit."""
        return self.method.compute_accuracy(self.otherwise)

    @property
    def is_decisive(self) -> bool:
        """Whether the measurement tells all values of the interval from the value without the name."""
        low, high = self.interval
        return max(low - self.otherwise, self.otherwise - high) >= DECISIVE_RATIO * self.accuracy

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``verdict.json``."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = self.interval
        confirming = " to ".join(dict.fromkeys([f"{low:.4g}", f"{high:.4g}"]))
        sentence = (
            f"{self.method.instruction}: {confirming}{unit} confirms {self.name}, {self.otherwise:.4g}{unit} refutes "
            f"it (an accuracy of {self.accuracy:.2g}{unit} is assumed)."
        )
        return {
            "name": self.name,
            "quantity": self.quantity,
            "expected": self.expected,
            "low": low,
            "high": high,
            "otherwise": self.otherwise,
            "accuracy": self.accuracy,
            "unit": self.unit,
            "sentence": sentence,
        }


def list_direct_measurements(
    fits: Sequence[Fit], compute_interval: Callable[[Fit, int], tuple[float, float]]
) -> list[DirectMeasurement]:
    """Return the decisive direct measurements of what some of the equivalent ``fits`` contain and others do not.

    ``compute_interval`` returns the 95 % interval of the parameter of a fit at an index, in its unit.
    """
    sets = [{term.identity for term in fit.hypothesis.terms} for fit in fits]
    shared = set.intersection(*sets) if sets else set()
    measurements: dict[str, DirectMeasurement] = {}
    for fit in fits:
        for index, term in enumerate(fit.hypothesis.terms):
            if term.identity not in shared:
                for measurement in _iterate_measurements(fit, index, term, compute_interval):
                    if measurement.is_decisive:
                        measurements.setdefault(measurement.name, measurement)
    return list(measurements.values())


def _iterate_measurements(
    fit: Fit, index: int, term: EffectTerm, compute_interval: Callable[[Fit, int], tuple[float, float]]
) -> Iterator[DirectMeasurement]:
    values = fit.values
    for k, parameter in enumerate(fit.hypothesis.parameters):
        method, unit = _find_method(term, parameter.name) if parameter.term_index == index else (None, "")
        if method is None or parameter.is_logarithmic:
            continue
        name, key, otherwise = term.qualified_name, parameter.name, parameter.initial
        point = DirectMeasurement(name, key, method, values[k], (values[k], values[k]), otherwise, unit)
        # Where even the fitted value does not decide, no interval is worth its simulations.
        yield point._replace(interval=compute_interval(fit, k)) if point.is_decisive else point


def _find_method(term: EffectTerm, key: str) -> tuple[MeasurementMethod | None, str]:
    """Return how to measure the parameter ``key`` of ``term``, None if it cannot be, and its unit."""
    if term.number is not None:
        if is_model_number(term.number):
            return MODEL_NUMBER_METHODS.get(term.number.rpartition(".")[2], (None, ""))
        return NUMBER_METHODS.get(term.number.rpartition(DEVICE_SEPARATOR)[2]), split_unit(term.number)[1]
    unit = split_unit(key)[1]
    if term.channel is None:
        return EFFECT_METHODS.get((term.effect, key)), unit
    quantity = next((q for q in CHANNEL_STANDARDS if term.channel == q or term.channel.startswith(f"{q}_")), None)
    if term.effect == "sensor_offset" and quantity is not None and quantity in CHANNEL_ZEROS:
        method = CHANNEL_ZEROS[quantity]
        return method._replace(instruction=method.instruction.format(term.channel)), CHANNEL_UNITS[term.channel][0]
    if term.effect != "sensor_gain" or quantity is None:
        return None, unit
    instruction = f"Compare the reading of '{term.channel}' with {CHANNEL_STANDARDS[quantity]}"
    return MeasurementMethod(instruction, GAIN_ACCURACY), unit
