"""Scene, optics and sensor → video with exact truth."""

from simulator.rendering.clip import RenderedFrame, render_clip, render_frames, set_stage, truth_of
from simulator.rendering.gauge_image import GaugePose, gauge_truth, render_gauge, render_gauge_image
from simulator.rendering.scene import GaugeScene, Scene, load_scene
from simulator.rendering.video import check_container

__all__ = [
    "GaugePose",
    "GaugeScene",
    "RenderedFrame",
    "Scene",
    "check_container",
    "gauge_truth",
    "load_scene",
    "render_clip",
    "render_frames",
    "render_gauge",
    "render_gauge_image",
    "set_stage",
    "truth_of",
]
