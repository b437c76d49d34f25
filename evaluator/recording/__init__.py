"""Frames of a recording with their exact presentation times, whatever FFmpeg decodes."""

from evaluator.recording.fields import Fields
from evaluator.recording.frame import Frame
from evaluator.recording.images import ImageSequence
from evaluator.recording.open import has_no_clock, open_recording
from evaluator.recording.timing import TimingReport
from evaluator.recording.video import Recording

Source = Recording | ImageSequence

__all__ = ["Fields", "Frame", "ImageSequence", "Recording", "Source", "TimingReport", "has_no_clock", "open_recording"]
