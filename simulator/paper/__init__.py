"""The published figures and numbers, recomputed with the shipped robots.

machines: the simulated machines of Sections 2 and 4; tables: the data of every figure; numbers: published | ours;
readings: ways to read Eqs. (3) to (8), and the five published radii that each of them gives.
"""
