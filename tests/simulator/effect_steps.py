"""What the steps of the parameters of all effects do to the marks of the paper's robot, simulated."""

from __future__ import annotations

# By how much ten steps of each parameter move the marks in a turn of 3 s, µm RMS; of a clock its times, ms. A step is
# visible in the marks of a good camera after some turns, and small: friction gradients act some millimetres away, and
# what slides hardly slides here.
MOVED = {
    "drive-speed-mismatch": (34.7,),
    "drive-speed-scale": (66.4,),
    "motor-droop": (236,),
    "command-lag": (99.7, 94.6),
    "speed-limit": (155, 306, 73),
    "acceleration-limit": (85.2, 20.0, 21.6),
    "friction-across": (23.2,),
    "sliding-friction": (0.096,),
    "speed-ripple": (56.5, 73.9),
    "dead-band": (2160,),
    "speed-drift": (19.9,),
    "magnet-imbalance": (8.0,),
    "magnet-strength": (34.6, 34.1),
    "friction-level": (16.1,),
    "wheel-toe": (71.1, 35.5),
    "rolling-drag": (3.2,),
    "scrub-torque": (102,),
    "axle-compliance": (11.3,),
    "mass-offset": (21.3, 1.15),
    "plate-tilt": (6.36, 11.5),
    "tether-pull": (14.2, 35.5),
    "tether-spring": (7.86, 13.8, 28.6),
    "viscous-drag": (5.13, 2.66),
    "friction-gradient": (0.932, 4.06),
    "friction-grain": (13.7, 3.57),
    "stray-magnet": (12.8, 8.31, 4.31, 4.82),
    "mark-offset": (141, 141, 59.2),
    "plane-scale": (115,),
    "time-base": (87.5,),
    "camera-tilt": (6.48, 7.39, 4.08),
    "rolling-shutter": (2.06, 2.14),
}
