"""A third world: logs of wheeled skid-steered robots with four driven wheels, written apart from turnscope."""
