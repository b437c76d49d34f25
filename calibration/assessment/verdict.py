"""The verdict on a calibration, as computed by quality.py and stored in camera.json."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

Level = Literal["sound", "limited", "ill-conditioned"]


class Verdict(BaseModel):
    """level: "sound", "limited" (good on one plane, larger stated uncertainty elsewhere) or "ill-conditioned".

    summary: the verdict in one sentence. reasons: why not sound. next_steps: what to do. notes: remarks that need
    no action. scale_sigma: relative standard uncertainty of lengths, and so of turning radii, at mark height;
    plate_scale_sigma: on the plate itself. coverage: share of the image that dots cover.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    level: Level
    summary: str
    reasons: tuple[str, ...]
    next_steps: tuple[str, ...]
    notes: tuple[str, ...]
    mark_height_mm: float
    scale_sigma: float
    plate_scale_sigma: float
    tilt_spread_deg: float  # largest angle between two images
    coverage: float
