"""A person of an assessment: the controllers that walked as this person, and their texts."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from klute_sim.api.gait import GaitRun
from klute_sim.baselines import assessment, table
from klute_sim.baselines.library import Baseline
from klute_sim.gait.metrics import AnkleMetrics, compute_reference_metrics
from klute_sim.gait.subject import Subject

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True)
class AssessedController:
    """A device under a controller, walking as one person, and what it lacks."""

    baseline: Baseline
    """Device and controller."""
    run: GaitRun | None
    """Simulated gait; None: the simulation failed."""
    quantities: tuple[assessment.AssessedQuantity, ...]
    """Quantities with their criteria; empty after a failure."""
    shortfalls: tuple[str, ...]
    """One sentence per shortfall."""

    @property
    def name(self) -> str:
        """Name of the baseline, or of the user's device and controller."""
        return self.baseline.name

    @property
    def air_g(self) -> float | None:
        """Air drawn from the supply in a stride [g]; None after a failure."""
        return None if self.run is None else self.run.gait_metrics.mean(lambda s: s.air_g)

    @property
    def strides_per_tank(self) -> float | None:
        """Number of strides that a tank allows; None for a gait without air, or after a failure."""
        return table.compute_strides_per_tank(self.air_g)


@dataclass(frozen=True)
class AssessedPerson:
    """One person and every controller that walked as this person."""

    subject: Subject
    """Person who walks."""
    controllers: tuple[AssessedController, ...]
    """Controllers in the order of the table."""

    @property
    def name(self) -> str:
        """Name of the reference."""
        return self.subject.reference.name

    @cached_property
    def person_ankle(self) -> AnkleMetrics | None:
        """Metrics of the person's own ankle; None when every simulation failed."""
        runs = (controller.run for controller in self.controllers)
        return next((compute_reference_metrics(run.recording) for run in runs if run is not None), None)

    @property
    def ranked(self) -> list[AssessedController]:
        """Controllers by the number of shortfalls, then by air; failures last."""
        return sorted(self.controllers, key=lambda c: (c.run is None, len(c.shortfalls), c.air_g or 0.0))

    @property
    def serving(self) -> list[AssessedController]:
        """Controllers without a shortfall, the one with the least air first."""
        return [controller for controller in self.ranked if not controller.shortfalls]

    def get_label(self, controller: AssessedController) -> str:
        """Return the name of ``controller``, marked as shipped where the user's own ones stand beside it."""
        has_user_pairs = any(not c.baseline.is_shipped for c in self.controllers)
        return f"shipped: {controller.name}" if has_user_pairs and controller.baseline.is_shipped else controller.name

    def format_verdict(self) -> str:
        """Return the verdict in one sentence."""
        if self.serving:
            names = ", ".join(f"{self.get_label(c)} ({_format_air(c)})" for c in self.serving)
            return f"{self.name}: served by {names}."
        best = self.ranked[0]
        if best.run is None:
            return f"{self.name}: no gait could be simulated."
        number = len(best.shortfalls)
        return f"{self.name}: not served; fewest shortfalls ({number}): {self.get_label(best)} ({_format_air(best)})."

    def build_table(self) -> "Table":
        """Return the table of the controllers beside the own ankle; a star marks a shortfall."""

        from klute_sim.terminal_table import create_table

        result = create_table(title=self.name)
        result.add_column("", overflow="fold")
        cells = {controller.name: format_cells(controller) for controller in self.controllers}
        # In a narrow terminal, a column in which every controller meets an absolute limit of zero says nothing.
        shown = [
            index
            for index, criterion in enumerate(assessment.CRITERIA)
            if criterion.maximum != 0.0 or any(row[index][1] for row in cells.values())
        ]
        for title in (*(assessment.CRITERIA[index].title for index in shown), "air\ng", "strides\n/tank"):
            result.add_column(title, justify="right", no_wrap=True)
        ankle_cells = self.format_ankle_cells()
        result.add_row("own ankle", *(ankle_cells[index] for index in shown), "", "", style="dim")
        for controller in self.controllers:
            row = [cells[controller.name][index] for index in shown]
            texts = [f"{text}*" if is_short else text for text, is_short in row]
            result.add_row(self.get_label(controller), *texts, *format_air_cells(controller))
        return result

    def format_ankle_cells(self) -> list[str]:
        """Return the values of the own ankle as text, one for each criterion."""
        ankle = self.person_ankle
        return [
            "-"
            if ankle is None or criterion.get_person_value is None
            else format(criterion.get_person_value(ankle), criterion.format_spec)
            for criterion in assessment.CRITERIA
        ]


def format_cells(controller: AssessedController) -> list[tuple[str, bool]]:
    """Return text and whether it falls short of each quantity of ``controller``; "-" after a failure."""
    if not controller.quantities:
        return [("-", True)] * len(assessment.CRITERIA)
    return [
        (
            "-" if quantity.value is None else format(quantity.value, quantity.criterion.format_spec),
            bool(quantity.shortfall),
        )
        for quantity in controller.quantities
    ]


def format_air_cells(controller: AssessedController) -> tuple[str, str]:
    """Return air per stride and strides per tank as text; "-" where there is none."""
    air, strides = controller.air_g, controller.strides_per_tank
    return "-" if air is None else f"{air:.2f}", "-" if strides is None else f"{strides:.0f}"


def _format_air(controller: AssessedController) -> str:
    strides = controller.strides_per_tank
    if strides is None:
        return "no air"
    return f"{controller.air_g:.2f} g of air per stride, {strides:.0f} strides per tank"


def summarize_person(person: AssessedPerson) -> dict[str, Any]:
    """Return ``person`` in JSON types."""
    return {
        "reference": person.name,
        "subject": person.subject.describe(),
        "verdict": person.format_verdict(),
        "served_by": [controller.name for controller in person.serving],
        "fewest_shortfalls": person.ranked[0].name,
        "controllers": [_summarize_controller(controller) for controller in person.controllers],
    }


def _summarize_controller(controller: AssessedController) -> dict[str, Any]:
    return {
        "name": controller.name,
        "shipped": controller.baseline.is_shipped,
        "device": controller.baseline.device.name,
        "spring_foot_nm_per_deg": controller.baseline.foot_stiffness,
        "quantities": [
            {
                "name": quantity.criterion.name,
                "unit": quantity.criterion.unit,
                "value": quantity.value,
                "own": quantity.person_value,
                "shortfall": quantity.shortfall,
            }
            for quantity in controller.quantities
        ],
        "trips": None if controller.run is None else controller.run.gait_metrics.has_swing_contact,
        "air_per_stride_g": controller.air_g,
        "strides_per_tank": controller.strides_per_tank,
        "shortfalls": list(controller.shortfalls),
    }


def build_page_entry(person: AssessedPerson) -> dict[str, Any]:
    """Return ``person`` as text for the page."""
    return {
        "name": person.name,
        "verdict": person.format_verdict(),
        "sentences": [person.subject.format_sentence(), *person.subject.remarks],
        "own_cells": person.format_ankle_cells(),
        "controllers": [
            {
                "name": person.get_label(controller),
                "cells": format_cells(controller),
                "air": format_air_cells(controller),
                "shortfalls": controller.shortfalls,
            }
            for controller in person.controllers
        ],
    }
