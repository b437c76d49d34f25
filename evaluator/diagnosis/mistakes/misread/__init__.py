"""Runs that were recorded rightly and are read wrongly: hypotheses on what their files should say."""
