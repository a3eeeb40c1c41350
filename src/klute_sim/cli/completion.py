"""Tab completion of names: devices, effects, protocols and scenes; the shell completes files beside them."""

from collections.abc import Iterable

import click
from click.shell_completion import CompletionItem


def complete_device(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the presets that begin with ``incomplete``, and files."""
    from klute_sim.device.device import list_presets

    return _match(list_presets(), incomplete, with_files=True)


def complete_effect(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the effects that begin with ``incomplete``."""
    from klute_sim.effects.catalogue import get_effects

    return _match(get_effects(), incomplete)


def complete_protocol(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the protocols of the package that begin with ``incomplete``, and files."""
    from klute_sim.bench.protocols.library import list_protocols

    return _match(list_protocols(), incomplete, with_files=True)


def complete_identification_protocol(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Return the protocols of a measurement plan that begin with ``incomplete``."""
    from klute_sim.bench.protocols.library import load_identification_protocols

    return _match(load_identification_protocols(), incomplete)


def complete_scene(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the scenes of ``klute-sim play`` that begin with ``incomplete``."""
    from klute_sim.play.controls import SCENES

    return _match(SCENES, incomplete)


def _match(names: Iterable[str], incomplete: str, *, with_files: bool = False) -> list[CompletionItem]:
    items = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [*items, CompletionItem(incomplete, type="file")] if with_files else items
