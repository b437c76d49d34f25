"""How long a test waits for another process or thread before it calls it broken."""

# No claim about speed: a fresh machine under load took 160 s for the first image of a live camera, as that compiles.
HANGS_S = 300.0
