"""HTML pages from Jinja2 templates; values are escaped, and undefined variables are errors."""

from typing import Any


def render_template(template: str, **context: Any) -> str:
    """Return the page that ``template`` of this package renders from ``context``."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("klute_sim.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context)
