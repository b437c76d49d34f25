"""One step of a fit: the optimum of its linearization, and the line search toward it."""
