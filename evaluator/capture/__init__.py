"""From a camera at the bench to a video file: nothing lost, true times, and when the motors were told to start."""
