"""Forces on the robot and the derivative of its velocity: body, wheels, axles, motors, added terms."""
