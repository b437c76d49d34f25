"""The results of a diagnosis as files: diagnosis.json, and a robot file with the effect."""
