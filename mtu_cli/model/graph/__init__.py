"""The measurement graph as a model: places, transitions, firing order, all trials at once.

Stryczek, "A Bipartite Graph for Estimating Measurement Uncertainty on Five-Axis Machining
Centres". What a place holds, for m trials: a coordinate or constant (m,), a point or vector
(3, m), a line or plane (2, 3, m) of a point and a unit vector, a frame (4, 3, m) of its origin
and its axes. Lengths in mm, angles in rad.
"""
