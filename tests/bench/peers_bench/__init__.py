"""The right angle of one part by `mtu` and by other packages: `python -m peers_bench`.

Each package works in a process of its own, one at a time and in turn, and what is printed are
ratios within a round: they hold on a busy machine, seconds do not. Nothing is timed before all
have answered the same; what is not installed is listed as such.
"""
