"""Structure-aware fuzzing: valid files, spoilt, must end in results or in one sentence."""
