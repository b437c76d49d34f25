"""Commented files that `turnscope new` lays out."""
