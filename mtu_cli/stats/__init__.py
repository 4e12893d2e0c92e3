"""Numbers in, numbers out: estimation, propagation and Monte Carlo; knows no machine."""
