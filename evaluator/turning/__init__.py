"""Poses → phases, turning circle and minimum turning radius, each with an interval."""
