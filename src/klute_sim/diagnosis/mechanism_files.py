"""Files of a diagnosed mechanism: the device of each tendon, and the MJCF model with its fitted numbers."""

from klute_sim.datasets.mechanism_channels import name_files
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.plant.mjcf.model_effects import apply_model_effects
from klute_sim.plant.mjcf.model_export import build_model_files
from klute_sim.plant.mjcf.model_numbers import set_model_numbers


def build_mechanism_files(diagnosis: Diagnosis) -> dict[str, bytes]:
    """Return name -> content of ``device-TENDON.toml`` and of the model's files as the recommended fit has them.

    Empty on another rig and without a fit. Numbers that single trials change keep the values of the dataset.
    """
    mechanism = diagnosis.dataset.mechanism
    if mechanism is None or diagnosis.final_fit is None:
        return {}
    fit = diagnosis.recommended_fit
    source = diagnosis.dataset.folder.resolve().name
    stems = name_files(mechanism.devices)
    files = {
        f"device-{stems[tendon]}.toml": device.content
        if diagnosis.is_declared_best
        else augment_device(fit, source, device, tendon).content
        for tendon, device in mechanism.devices.items()
    }
    spec = mechanism.file.make_spec()
    set_model_numbers(spec, {**mechanism.numbers, **fit.hypothesis.collect_model_numbers(fit.values)})
    (setup,) = fit.hypothesis.build_setups(fit.x, diagnosis.experiments[:1])
    apply_model_effects(spec, setup.model_effects)
    return {**files, **build_model_files(mechanism.file, spec)}
