"""Base of all sections of a device file: keys end with their unit, and unknown keys are errors."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from klute_sim.units import to_si

Positive = Annotated[FiniteFloat, Field(gt=0)]
NonNegative = Annotated[FiniteFloat, Field(ge=0)]


class DeviceFileSection(BaseModel):
    """Base of all sections."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def get_si(self, key: str) -> float:
        """Return the value of ``key`` in SI units."""
        return to_si(key, float(getattr(self, key)))
