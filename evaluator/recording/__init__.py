"""Pictures of a recording with their exact presentation times, whatever FFmpeg decodes."""

from evaluator.recording.frame import Frame
from evaluator.recording.open import open_recording
from evaluator.recording.timing import TimingReport
from evaluator.recording.video import Recording

__all__ = ["Frame", "Recording", "TimingReport", "open_recording"]
