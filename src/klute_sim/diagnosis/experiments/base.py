"""The interface of an experiment: a measured trial with its inputs on the simulation's time grid.

Each rig prescribes its own inputs; see :mod:`~klute_sim.diagnosis.experiments.bench` and
:mod:`~klute_sim.diagnosis.experiments.gait`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from klute_sim.datasets.mechanism_channels import DISPLAY_UNITS, parse_channel
from klute_sim.datasets.trial import SensorLimits, TimeSeries, Trial, Use
from klute_sim.datasets.unit_conversion import get_conversion_factor
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.diagnosis.experiments.channel_filter import Filters
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_SAMPLING_INTERVAL = 2e-3
"""Sampling interval [s] to which faster measured channels are decimated by whole factors: 1200 Hz become 600 Hz. Noise
stays correlated for longer than this, and a million samples would fill the memory."""
WARM_UP_FRACTION, MAX_WARM_UP_TIME = 0.1, 0.5
"""Fraction of a trial, and longest time [s], that is simulated but not compared. The internal state of friction before
the trial is unknown; the first movements erase it."""
MIN_SERIES_SAMPLES = 2
"""Smallest number of samples of a channel that is compared: fewer have no sampling interval."""
PRESSURE_PERTURBATION = 2e3
"""Change of the commanded pressure [Pa] that measures the sensitivity to pressure noise."""


class ChannelUnits(Mapping[str, tuple[str, float]]):
    """Channel -> unit for display, and that unit in SI; those of a mechanism follow from the names of its channels."""

    _RIG_CHANNELS: ClassVar = {
        **{"force": ("N", 1.0), "pressure": ("bar", BAR), "muscle_length": ("mm", 1e-3)},
        **{"ankle_angle": ("deg", np.pi / 180.0), "ankle_moment": ("N*m", 1.0)},
    }

    def __getitem__(self, channel: str) -> tuple[str, float]:
        """Return the unit of ``channel``."""
        if channel in self._RIG_CHANNELS:
            return self._RIG_CHANNELS[channel]
        try:
            si_unit = parse_channel(channel).si_unit
        except InputError:
            raise KeyError(channel) from None
        unit = DISPLAY_UNITS[si_unit]
        return unit, get_conversion_factor(unit, si_unit) or 1.0

    def __iter__(self) -> Iterator[str]:
        """Iterate over the channels of bench and gait."""
        return iter(self._RIG_CHANNELS)

    def __len__(self) -> int:
        """Return the number of channels of bench and gait."""
        return len(self._RIG_CHANNELS)


CHANNEL_UNITS = ChannelUnits()
"""Channel -> unit for display, and that unit in SI."""


class SupportsQuantize(Protocol):
    """A display or converter that quantizes a channel."""

    def quantize(self, value: Array) -> Array:
        """Return the mean reading for ``value`` [SI]."""


class SensorModel(NamedTuple):
    """An instrument effect on one channel."""

    channel: str
    """Measured channel."""
    effect: str
    """Name of the effect in the catalogue."""
    form: str
    """Name of its form."""
    parameters: tuple[float, ...]
    """Parameters of the form in SI units, as the named tuple that its law takes."""


class BodyEdit(NamedTuple):
    """A form of a body effect."""

    effect: str
    """Name of the effect in the catalogue."""
    form: str
    """Name of the form."""
    parameters: tuple[tuple[str, float], ...]
    """Key and value of each parameter, in the unit of the key."""


class SimulationSetup(NamedTuple):
    """Everything a simulation of an experiment needs: the device, its body and its sensors."""

    parameters: DeviceParameters
    """Device parameters."""
    sensors: tuple[SensorModel, ...] = ()
    """Instrument effects; a channel without one is read without error."""
    body_edits: tuple[BodyEdit, ...] = ()
    """Effects of the body added to those of the device file."""
    registration: tuple[float, ...] = ()
    """Errors of the registration (:class:`~klute_sim.diagnosis.experiments.registration.Registration`); empty for
    none."""
    devices: tuple[DeviceParameters, ...] = ()
    """Parameters of all devices of a mechanism, in its order; empty: the nominal ones."""
    model_numbers: tuple[tuple[str, float], ...] = ()
    """Numbers of the model that differ from those of the trial."""
    model_effects: tuple[ModelEffect, ...] = ()
    """Effects of joints, pulleys and gravity of a mechanism."""


class NumberChange(NamedTuple):
    """A fitted number of a model."""

    declared: float
    """Value that the dataset declares."""
    value: float
    """Fitted value."""


class DeviceResponse(NamedTuple):
    """Simulated response of the device in one trial, one value per time step."""

    time: Array
    """Time in the trial [s]."""
    tension: Array
    """Tension of the muscle-tendon unit [N]."""
    pressure: Array
    """Gauge pressure in the muscle [Pa]."""
    muscle_length: Array
    """Muscle length [m]."""
    ankle_angle: Array | None = None
    """Ankle angle, dorsiflexion positive [rad]; None on a rig without an ankle."""
    ankle_moment: Array | None = None
    """Ankle moment, plantarflexor positive [N.m]; None on a rig without an ankle."""
    channels: Mapping[str, Array] | None = None
    """Measured channels of a mechanism [SI], whose first device has the fields above; None on another rig."""

    def read_channel(self, channel: str) -> Array:
        """Return ``channel`` [SI]."""
        if self.channels is not None:
            return self.channels[channel]
        values: Array = getattr(self, RESPONSE_FIELDS[channel])
        return values


RESPONSE_FIELDS = {
    **{"force": "tension", "pressure": "pressure", "muscle_length": "muscle_length"},
    **{"ankle_angle": "ankle_angle", "ankle_moment": "ankle_moment"},
}
"""Measured channel -> field of :class:`DeviceResponse`."""


class PrescribedInput(NamedTuple):
    """The mechanical input that a rig prescribes, for figures and for the localization of misfit."""

    label: str
    """Axis label with the unit."""
    si_factor: float
    """The label's unit in SI."""
    values: Array
    """Values [SI], one per time step."""
    stationary_rate: float
    """Rate [SI/s] below which the input counts as stationary."""
    direction_labels: tuple[str, str, str]
    """Words for a falling, a stationary and a rising input."""


@dataclass(frozen=True, eq=False)
class Experiment(ABC):
    """A trial with its inputs on the simulation's time grid."""

    name: str
    """Name of the trial."""
    group: str
    """Group of repeats that the trial belongs to."""
    use: Use
    """Use of the trial in the diagnosis."""
    device: Device
    """Device of the trial."""
    start_time: float
    """Time of the first sample [s]."""
    dt: float
    """Time step of the inputs [s]."""
    command: Array
    """Commanded pressure [Pa], one value per time step."""
    measured: Mapping[str, TimeSeries]
    """Channel -> compared samples; missing samples and samples outside the prescribed interval are removed."""
    noise_scale: Mapping[str, Array] = field(default_factory=dict)
    """Channel -> standard deviation of the noise at each sample over its mean; 1 for channels that are not listed."""
    input_error_scale: Mapping[str, Array] = field(default_factory=dict)
    """Channel -> factor, at least 1 at each sample, by which it counts less because the inputs between their samples
    are unknown. Repeats share this error, so it is no noise. 1 for channels that are not listed."""
    input_noise_share: Mapping[str, Array] = field(default_factory=dict)
    """Channel -> share of the variance of its noise that is noise of the mechanical input, at each sample; 0 for
    channels that are not listed."""
    trusted: frozenset[str] = frozenset()
    """Channels whose instrument is known to be correct."""
    quantizers: Mapping[str, SupportsQuantize] = field(default_factory=dict)
    """Channel -> quantizer of its display."""
    filters: Filters = field(default_factory=dict)
    """Channel -> filter that it went through."""
    limits: Mapping[str, SensorLimits] = field(default_factory=dict)
    """Channel -> limits of its sensor [SI]; its samples are no further than these."""
    specimen: str = ""
    """Specimen of the device that was measured."""
    devices: Mapping[str, Device] = field(default_factory=dict)
    """Tendon -> device of a mechanism; empty on a rig with one device."""
    has_zero_order_hold: bool = False
    """Whether each command is held until the next sample (zero-order hold); otherwise it is interpolated linearly."""
    command_interval: float = 0.0
    """Sampling interval of the command [s]; 0 where it is known when the command acts."""
    has_logged_updates: bool = False
    """Whether the log shows that commands are held; otherwise a zero-order hold is an assumption."""
    has_stepped_command: bool = False
    """Whether each command that changes does so in steps, between which it is constant."""
    initial_friction: float = 0.0
    """Friction with which a trial on a bench begins, over all that the device can hold: 1 after it was lengthened, -1
    after it was shortened, 0 for none."""
    noisy_variants: "tuple[Experiment, ...]" = ()
    """For each prescribed channel whose stated noise is not all white: the trial with this channel off by one standard
    deviation of the rest."""

    @property
    def zero_order_hold_noisy_variants(self) -> "tuple[Experiment, ...]":
        """The :attr:`noisy_variants` with a zero-order hold of the commands."""
        return tuple(variant.zero_order_hold_variant or variant for variant in self.noisy_variants)

    @property
    def duration(self) -> float:
        """Duration of the trial [s]."""
        return len(self.command) * self.dt

    @property
    @abstractmethod
    def coarse_variant(self) -> "Experiment":
        """The same trial with fewer, longer time steps; the trial itself where its time step is long already."""

    def select_variant(self, setup: SimulationSetup) -> "Experiment":
        """Return the same trial with the time step that the devices of ``setup`` require."""
        return self

    def is_extrapolated(self, setup: SimulationSetup) -> bool:
        """Return whether the response to ``setup`` is extrapolated to a vanishing time step."""
        return self.coarse_variant is not self

    @property
    def parts(self) -> Mapping[str, Sequence[str]]:
        """Kind of part -> names of the parts of a mechanism that may have effects; empty on another rig."""
        return {}

    @property
    def preparation_variants(self) -> "tuple[Experiment, ...]":
        """The same trial under equally valid preparations of its inputs; empty where inputs need no preparation."""
        return ()

    @property
    def simulation_error(self) -> float:
        """RMS error of the simulation that all repeats share, over the noise [1]; 0 where negligible."""
        return 0.0

    @property
    def registration_deviations(self) -> Mapping[str, float]:
        """Name -> standard deviation of each number of the set-up that every fit estimates; empty without any."""
        return {}

    @property
    def input_variants(self) -> "tuple[tuple[Experiment, ...], ...]":
        """For each input with samples far apart: the trial with other interpolations of this input."""
        return ()

    @property
    def zero_order_hold_variant(self) -> "Experiment | None":
        """The same trial with a zero-order hold of the commands; None where that changes nothing."""
        return None

    @property
    @abstractmethod
    def prescribed_input(self) -> PrescribedInput:
        """The mechanical input beside the pressure."""

    @property
    @abstractmethod
    def has_body(self) -> bool:
        """Whether effects of the body influence the measured channels."""

    @property
    @abstractmethod
    def informative_channels(self) -> tuple[str, ...]:
        """Channels that depend on the tension; a diagnosis needs at least one of them."""

    @property
    def pressure_range(self) -> float:
        """Largest range of a pressure command [Pa]."""
        return float(np.ptp(self.command))

    @property
    @abstractmethod
    def length_range(self) -> float | None:
        """Range of the mechanical input, converted to a length of the muscle-tendon unit [m]; None if unknown."""

    @abstractmethod
    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """Simulate the device of ``setup`` at this experiment's time step; sensors are ignored."""

    @abstractmethod
    def perturb_inputs(self, delay: Callable[[Array], Array]) -> "tuple[Experiment, Experiment, Experiment]":
        """Return the experiment with perturbed pressure, with perturbed mechanical input, and with a delayed command.

        ``delay`` maps the command to the delayed command.
        """

    @abstractmethod
    def compute_covariates(self) -> dict[str, Array]:
        """Return the quantities that may explain a misfit, one value per time step."""

    def correct_model_numbers(self, changes: Mapping[str, NumberChange]) -> dict[str, float]:
        """Return the numbers of the trial's model under ``changes``; empty on a rig without a model of its own."""
        return {}

    def with_repeats(self, repeats: "Sequence[Experiment]") -> "Experiment":
        """Return the experiment with the properties that it shares with its ``repeats``, which include itself."""
        return self

    def align_time(self, elapsed: Array) -> Array:
        """Map the time since the start [s] to the time axis [s] that all repeats of this trial share."""
        return elapsed

    def smooth(self, values: Array) -> Array:
        """Return the moving average of ``values`` (one per time step) over a twentieth of a second."""
        width = max(1, round(0.05 * len(values) / self.duration))
        return np.convolve(values, np.ones(width) / width, mode="same")


def select_samples(
    trial: Trial,
    start_time: float,
    end_time: float,
    last_time: float,
    *,
    max_warm_up_fraction: float = WARM_UP_FRACTION,
    max_warm_up_time: float = MAX_WARM_UP_TIME,
) -> dict[str, TimeSeries]:
    """Return the samples of ``trial`` to compare with a simulation from ``start_time`` to ``end_time`` [s].

    Samples are finite, later than the warm-up, not later than ``last_time`` [s], and decimated as
    :data:`MIN_SAMPLING_INTERVAL` says. A channel without at least two such samples is left out.
    """
    first_time = start_time + min(max_warm_up_fraction * (end_time - start_time), max_warm_up_time)
    measured = {}
    for name, series in trial.measured.items():
        is_compared = np.isfinite(series.value) & (series.time > first_time) & (series.time <= last_time)
        if is_compared.sum() < MIN_SERIES_SAMPLES:
            continue
        compared = TimeSeries(series.time[is_compared], series.value[is_compared])
        if name in trial.limits:
            compared = compared._replace(value=np.clip(compared.value, *trial.limits[name]))
        factor = max(1, int(MIN_SAMPLING_INTERVAL / compared.sampling_interval + 1e-6))
        measured[name] = TimeSeries(compared.time[::factor], compared.value[::factor])
    return measured


def censor_reading(reading: Array, measured: Array, limits: SensorLimits) -> Array:
    """Return the simulated ``reading`` [SI] to compare with ``measured`` samples of a sensor with ``limits``.

    A sample at a limit says only that the value is at the limit or beyond it (censored data). A simulated value beyond
    the limit agrees with it; one on the other side differs by its distance to the limit.
    """
    reading = np.where(measured >= limits.high, np.minimum(reading, limits.high), reading)
    return np.where(measured <= limits.low, np.maximum(reading, limits.low), reading)
