"""The command line: load, run, emit, once for all commands."""
