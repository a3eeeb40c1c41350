"""Design variables of the controlled joint: gains of the PID controller, and optionally numbers of the device."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.envs.joint_pid import DEFAULT_GAINS, MAX_GAIN, PidController
from klute_sim.errors import InputError
from klute_sim.parameter_sweep.joint_plan import check_gain_names
from klute_sim.parameters import Parameter
from klute_sim.tuning.design_variables import build_device_variables, change_device, check_device_keys
from klute_sim.types import Array

GAIN_SCALE, MAX_GAIN_RATIO = 0.3, 30.0
"""Search scale of the logarithm of a gain, and largest ratio to its initial value."""
MEAN_SCALE, MAX_MEAN = 0.1, 0.9
"""Search scale and largest size of the mean action."""


@dataclass(frozen=True)
class GainSpace:
    """A device, gains, and the design variables that change them."""

    device: Device
    """Device on both tendons at the start of the search."""
    gains: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_GAINS))
    """Argument of the PID controller -> value at the start of the search; all of them."""
    gain_keys: tuple[str, ...] = tuple(DEFAULT_GAINS)
    """Tuned arguments of the PID controller."""
    device_keys: tuple[str, ...] = ()
    """Tuned numbers of the device (``section.key``)."""

    def __post_init__(self) -> None:
        """Raise InputError when a gain is out of range or cannot be tuned, or the device takes no pressures."""
        check_gain_names(dict.fromkeys((*self.gains, *self.gain_keys)))
        PidController(**self.gains)
        for key in self.gain_keys:
            if key != "mean" and not self.gains[key] > 0.0:
                raise InputError(f"the gain {key} is {self.gains[key]:g}; a tuned gain must be above 0 at the start")
        check_accepts_pressure(self.device, "the controlled joint")
        check_device_keys(self.device, self.device_keys)

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables: gains, then numbers of the device."""
        return (*map(self._build_variable, self.gain_keys), *build_device_variables(self.device, self.device_keys))

    def _build_variable(self, key: str) -> Parameter:
        initial = self.gains[key]
        if key == "mean":
            return Parameter(name=key, initial=initial, scale=MEAN_SCALE, lower=-MAX_MEAN, upper=MAX_MEAN)
        return Parameter(
            name=key,
            initial=initial,
            scale=GAIN_SCALE,
            lower=initial / MAX_GAIN_RATIO,
            upper=min(initial * MAX_GAIN_RATIO, MAX_GAIN),
            is_logarithmic=True,
        )

    def decode(self, x: Sequence[float] | Array) -> tuple[Device, dict[str, float]]:
        """Return the device and the gains at the normalized point ``x``.

        Raises InputError when the numbers make no valid device.
        """
        values = [variable.denormalize(float(place)) for variable, place in zip(self.variables, x, strict=True)]
        n_gains = len(self.gain_keys)
        changes = {key: float(f"{value:.6g}") for key, value in zip(self.gain_keys, values[:n_gains], strict=True)}
        return change_device(self.device, self.device_keys, values[n_gains:]), {**self.gains, **changes}
