"""Pages from templates: names in data are escaped, and what a template asks for has to be there."""

from typing import Any


def render_template(template: str, **context: Any) -> str:
    """The page that ``template`` of this package makes of ``content``. Jinja2 is imported when a page is made."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("klute_sim.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context)
