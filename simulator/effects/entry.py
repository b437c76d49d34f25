"""An [[effect]] of robot.toml as it is written: an id and parameters, which the effect catalogue checks."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class EffectEntry(BaseModel):
    """One [[effect]]: its id, and whatever else the file says of it."""

    model_config = ConfigDict(extra="allow", frozen=True)
    id: str

    @property
    def given(self) -> dict[str, Any]:
        """The parameters that the entry gives, by name, as they were written."""
        return self.model_extra or {}
