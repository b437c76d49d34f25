"""Files that people write, changed by a front end: comments stay, and nobody overwrites what another has written."""
