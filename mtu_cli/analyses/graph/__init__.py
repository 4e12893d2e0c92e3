"""The measurement graph's commands: check, simulate, sweep."""
