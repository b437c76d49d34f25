"""A skid-steered robot that nobody here drove: how well its motion is predicted from its commands."""
