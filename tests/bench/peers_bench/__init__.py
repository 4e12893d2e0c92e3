"""The right angle of one part by `mtu` and by other packages: `python -m peers_bench`.

Every package gets the same inputs: 14 points, each with an error in x and in y of its own, 28
normals a trial. Each form of a package is a process of its own (`worker`), which waits for its
turn; rounds go through all of them in order, so that a busy machine disturbs all alike, and a
ratio is the median over the rounds of the ratio within a round.
"""
