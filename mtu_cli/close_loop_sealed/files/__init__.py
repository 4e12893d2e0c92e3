"""Part of the loop, unchanged until it is rebuilt."""
