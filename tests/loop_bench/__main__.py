"""Draws what is missing and prints the table; see `records`."""

from loop_bench.records import main

if __name__ == "__main__":
    main()
