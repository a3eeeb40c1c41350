"""Sources that were copied from a preset while the number beside them was changed."""

from klute_sim.device.device import list_presets, load_device
from klute_sim.device.schema.document import DeviceSpec


def find_outdated_sources(spec: DeviceSpec) -> dict[str, float]:
    """Return the keys of ``spec`` whose source is that of another value in a preset, with this value.

    The preset is the one from which most sources were copied. Assumptions are left out: another value is assumed, too,
    until the file says otherwise.
    """
    presets = [load_device(name).spec for name in list_presets()]
    copied = {
        preset.name: {key for key, source in preset.sources.items() if spec.sources.get(key) == source}
        for preset in presets
    }
    original = max(presets, key=lambda preset: len(copied[preset.name]))
    assumptions = spec.collect_assumptions()
    values, original_values = spec.collect_values(), original.collect_values()
    candidates = copied[original.name] & values.keys() & original_values.keys()
    return {
        key: original_values[key]
        for key in values
        if key in candidates and key not in assumptions and values[key] != original_values[key]
    }
